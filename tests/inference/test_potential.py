"""The posterior of many models: its densities, priors and derivatives."""

import numpy as np
import pytest
import torch
from scipy import integrate, stats

from regional_lv.inference.noise import Noise
from regional_lv.inference.potential import (
    Potential,
    _information_of_tails,
)
from regional_lv.inputs.closed_forms import HeavyTails
from regional_lv.inputs.scales import Linear, Logarithmic, Saturating
from regional_lv.inputs.space import Inputs, Role
from tests.inference.toys import Emulator, Toy, known_noise, toy_inputs

D = 6


def bent(x):
    """D smooth outputs of any number of inputs."""
    rng = np.random.default_rng(3)
    a, b = (torch.as_tensor(rng.normal(size=(x.shape[1], D))) for _ in range(2))
    return torch.sin(x @ a) + 0.3 * (x @ b).square()


def problem(noise="known", tails=False):
    members = [Toy("t0", 0.2, 5.0, scale=Logarithmic()), Toy("t1", -1.0, 2.0)]
    members += [Toy("m0", 4.0, 16.0, 8.0, Logarithmic()), Toy("c0", 0.0, 1.0, 0.0)]
    roles = {"m0": Role("measured", 2.0), "c0": Role("suspected")}
    if tails:
        members.append(HeavyTails({}))
        roles["heavy_tails"] = Role("suspected")
    inputs = Inputs({}, members, roles)
    rng = np.random.default_rng(4)
    half = torch.as_tensor(0.1 * rng.normal(size=(D, D)))
    units = torch.tensor([1.0, 1, 1, 0, 0, 0], dtype=torch.float64)
    sd = torch.full((D,), 0.2, dtype=torch.float64)
    kinds = {
        "known": Noise(sd),
        "inferred": Noise(0 * sd, {"a": units, "b": 2 * (1 - units)}, 0.7),
        "mixed": Noise(sd * (1 - units), {"a": units}, 0.7),
    }
    y = torch.as_tensor(rng.normal(size=D))
    potential = Potential(Emulator(bent, half @ half.mT), inputs, y, kinds[noise])
    share = torch.as_tensor(rng.uniform(0.2, 0.8, size=(3, len(potential.low))))
    x = potential.low + share * potential.width
    x[:, len(inputs) :] = torch.as_tensor(rng.normal(-1, 0.5, size=x[:, len(inputs) :].shape))
    return potential, x


@pytest.mark.parametrize("tails", [False, True])
@pytest.mark.parametrize("noise", ["known", "inferred", "mixed"])
def test_gradient_is_that_of_the_density(noise, tails):
    potential, x = problem(noise, tails)
    error = potential.settle(x, torch.zeros(len(x)).double())
    count = len(potential.inputs)
    at = x.clone().requires_grad_()
    value = potential.log_density(bent(at[:, :count]), at, error)
    (expected,) = torch.autograd.grad(value.sum(), at)
    found = potential.quadratic(*potential.linearise(x), x, error)
    torch.testing.assert_close(found.value, value.detach())
    torch.testing.assert_close(found.gradient, expected)
    torch.linalg.cholesky(found.curvature + 1e-9 * torch.eye(x.shape[1]))


def test_density_against_scipy():
    potential, x = problem()
    error = potential.settle(x, torch.zeros(len(x)).double())
    found = potential.log_density(potential.mean(x), x, error)
    covariance = (error[0] + 0.04 * torch.eye(D).double()).numpy()
    pressure = stats.truncnorm((4 - 8) / 2, (16 - 8) / 2, 8, 2)
    for value, row in zip(found, x, strict=True):
        mean = bent(row[None, :4])[0].numpy()
        expected = stats.multivariate_normal(mean, covariance).logpdf(potential.y.numpy())
        # In the logarithms of the pressure and of t0, which is uniform in its unit.
        expected += pressure.logpdf(np.exp(float(row[2]))) + float(row[2]) + float(row[0])
        assert float(value) == pytest.approx(expected, rel=1e-10)
    free = torch.stack([potential.free(), potential.free((3,))])
    widths = 5 - 0.2, 3.0, 1.0
    expected = [-np.log(widths[:2]).sum(), -np.log(widths).sum()]
    np.testing.assert_allclose(potential.log_uniform(free), expected)


def test_tails_against_scipy():
    potential, x = problem(tails=True)
    potential.emulated.error = torch.zeros(D, D).double()
    x[0, 4] = 0.0
    error = potential.settle(x, torch.zeros(len(x)).double())
    found = potential.log_density(potential.mean(x), x, error)
    for value, row in zip(found, x, strict=True):
        mean, inverse = bent(row[None, :5])[0].numpy(), float(row[4])
        noise = stats.t(1 / inverse, mean, 0.2) if inverse else stats.norm(mean, 0.2)
        expected = noise.logpdf(potential.y.numpy()).sum()
        expected += float(potential.measured.log_density(row[None])) + float(row[0])
        assert float(value) == pytest.approx(expected, rel=1e-3)


def test_weights_are_what_errors_pull_with():
    """Minus the slope of their log density over their size."""
    potential, x = problem(tails=True)
    potential.emulated.error = torch.zeros(D, D).double()
    error = potential.settle(x, torch.zeros(len(x)).double())
    residual = potential.y - potential.mean(x)
    found = potential.weights(x, residual, potential.whitening(x, error))
    for row, white, weight in zip(x, (residual / 0.2).numpy(), found.numpy(), strict=True):
        density, h = stats.t(1 / float(row[4])).logpdf, 1e-4
        slope = (density(white + h) - density(white - h)) / (2 * h)
        np.testing.assert_allclose(weight * white, -slope, rtol=2e-3)


@pytest.mark.parametrize(
    ("scale", "low", "high"),
    [(Linear(), 5.0, 9.0), (Logarithmic(), 4.0, 16.0), (Saturating(2.0), 0.0, 9.0)],
)
def test_measured_prior_is_normalised(scale, low, high):
    mean, sd = 8.0, 2.0
    inputs = Inputs({}, [Toy("m", low, high, mean, scale)], {"m": Role("measured", sd)})
    potential = Potential(Emulator(bent, torch.eye(D)), inputs, torch.zeros(D), known_noise(D))

    def density(z):
        return float(potential.measured.log_density(torch.tensor([[z]], dtype=torch.float64)).exp())

    total, _ = integrate.quad(density, float(potential.low[0]), float(potential.high[0]))
    assert total == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize("nu", [2.5, 10.0, 200.0])
def test_information_of_tails(nu):
    def score(e, step=1e-4):
        inverse = 1 / nu
        ends = (stats.t(1 / (inverse + s * step * inverse)).logpdf(e) for s in (1, -1))
        return np.subtract(*ends) / (2 * step * inverse)

    expected, _ = integrate.quad(
        lambda e: score(e) ** 2 * stats.t(nu).pdf(e), -np.inf, np.inf, limit=500
    )
    found = float(_information_of_tails(torch.tensor([nu], dtype=torch.float64)))
    assert found == pytest.approx(expected, rel=1e-3)


def test_curvature_of_a_linear_problem_is_exact():
    potential, x = problem()
    slopes = torch.as_tensor(np.random.default_rng(5).normal(size=(D, 4)))
    potential.emulated.function = lambda x: x @ slopes.mT
    error = potential.settle(x[:1], torch.zeros(1).double())
    found = potential.quadratic(*potential.linearise(x[:1]), x[:1], error).curvature[0]

    def likelihood(at):  # the curvature of the prior about the logarithm is that of its centre
        mean = (at @ slopes.mT)[None]
        return potential.log_density(mean, x[:1], error)[0]

    hessian = -torch.autograd.functional.hessian(likelihood, x[0])
    hessian[2, 2] += (float(x[0, 2].exp()) / 2.0) ** 2
    torch.testing.assert_close(found, hessian)


def test_curvature_of_noise_scales():
    potential, x = problem("inferred")
    potential.emulated.error = torch.zeros(D, D).double()
    error = potential.settle(x, torch.zeros(len(x)).double())
    found = potential.quadratic(*potential.linearise(x), x, error).curvature[:, 4:, 4:]
    # Of a scale of n independent channels 2 n, and the half-normal prior's.
    expected = 2 * 3 + 2 * (x[:, 4:].exp() / 0.7).square()
    torch.testing.assert_close(found, torch.diag_embed(expected))


def test_departure_adds_to_the_error():
    inputs = toy_inputs(2)
    pattern = torch.diag(torch.arange(1.0, D + 1).double())
    emulator = Emulator(bent, torch.eye(D).double())
    potential = Potential(
        emulator, inputs, torch.zeros(D).double(), known_noise(D), departure=pattern
    )
    error = potential.settle(torch.zeros(2, 2).double(), torch.tensor([0.0, 3.0]).double())
    torch.testing.assert_close(error[0], emulator.error)
    torch.testing.assert_close(error[1], emulator.error + 9 * pattern)


def test_replicates_are_of_their_own_point():
    """Points that come often, in any order, over chunks that are smaller than their number."""
    potential, x = problem("mixed")
    potential.chunk = 2
    generator = torch.Generator().manual_seed(1)
    which = torch.randint(len(x), (12_000,), generator=generator)
    found = potential.replicates(x[which], torch.zeros(len(which)).double(), generator)
    mean, error = potential.predict(x, torch.zeros(len(x)).double())
    variance = potential.noise.variance(x[:, len(potential.inputs) :])
    for k in range(len(x)):
        own = found[which == k]
        covariance = error[0] + torch.diag(variance[k])
        near = 5 * (covariance.diagonal() / len(own)).sqrt()
        assert ((own.mean(0) - mean[k]).abs() < near).all()
        scale = covariance.diagonal().sqrt()
        away = (torch.cov(own.mT) - covariance) / torch.outer(scale, scale)
        assert away.abs().max() < 0.1


def test_replicates_have_the_tails_of_their_model():
    """Whitened, Student's t where the tails are heavy, and normal where they are not."""
    potential, x = problem("known", tails=True)
    x = x[:1].repeat(2, 1)
    x[:, potential.tails] = torch.tensor([0.0, 0.25]).double()
    generator = torch.Generator().manual_seed(2)
    found = potential.replicates(
        x.repeat_interleave(5000, 0), torch.zeros(10_000).double(), generator
    )
    mean, error = potential.predict(x, torch.zeros(2).double())
    missed = found - mean.repeat_interleave(5000, 0)
    white = potential._white(potential.whitening(x[:1], error), missed)
    normal, heavy = white.unflatten(0, (2, -1)).flatten(1).numpy()
    assert stats.kstest(normal, "norm").pvalue > 0.01
    assert stats.kstest(heavy, stats.t(4).cdf).pvalue > 0.01
