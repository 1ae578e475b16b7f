"""Both samplers against posteriors that are known, and against each other."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy import stats

from regional_lv.emulators.base import SeparablePrediction
from regional_lv.inference.noise import Noise
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.sampler import by_importance, sampling
from regional_lv.paper.sampler.approximation import approximate
from regional_lv.paper.sampler.draws import Settings
from regional_lv.paper.sampler.likelihood import Likelihood
from regional_lv.paper.sampler.sampling import SAMPLERS
from regional_lv.paper.sampler.target import Target
from tests.paper.test_likelihood import DIRECTIONS, LinearEmulator, inferred, linear

NONE = torch.zeros(0, dtype=torch.float64)


DEEP = pytest.mark.test_all("long chains; `make test` has those of a Gaussian posterior")

EITHER = pytest.mark.parametrize("sampler", SAMPLERS)
MOSTLY = pytest.mark.parametrize(
    "sampler", [pytest.param(name, marks=DEEP if name == "nuts" else []) for name in SAMPLERS]
)
"""NUTS in `make test-all` only."""

FIFTH_OF_A_ML, HALF_PERCENT = 0.005, 0.025
"""What a volume is known to, in training sd."""


def observed(spread: float, truth: float, noise: str = "none", freedom: float = np.inf):
    """A linear emulator, all factors at `truth`, and the likelihood of what it has there."""
    emulator = linear(spread, freedom=freedom)
    theta = torch.full((10,), truth, dtype=torch.float64)
    sd = torch.full_like(emulator.output_sd, 0.2)
    of = {
        "none": Noise.none(emulator),
        "known": Noise.known(sd),
        "inferred": Noise.shared(emulator, 0.3),
    }
    return emulator, theta, Likelihood(emulator, emulator.predict(theta).mean, of[noise])


def precision(emulator) -> torch.Tensor:
    a = emulator.slopes
    return a.T @ torch.linalg.solve(emulator.matrix, a)


def flat(draws) -> tuple[np.ndarray, np.ndarray]:
    count = draws.energy.size
    return tuple(x.reshape(count, x.shape[-1]) for x in (draws.theta, draws.sigma))


@EITHER
def test_gaussian_posterior(sampler):
    emulator, truth, likelihood = observed(0.02, 2.0)
    settings = Settings(warmup=100, draws=500)
    draws = SAMPLERS[sampler](likelihood, truth, NONE, settings, 7)
    assert draws.verdict(settings) == "passed"
    expected = torch.linalg.inv(precision(emulator)).numpy()
    sd = np.sqrt(expected.diagonal())
    assert sd.max() < 0.3  # the bounds at 0.1 and 5 do not matter
    theta, _ = flat(draws)
    assert np.abs((theta.mean(0) - truth.numpy()) / sd).max() < 0.15
    np.testing.assert_allclose(
        np.cov(theta, rowvar=False) / np.outer(sd, sd),
        expected / np.outer(sd, sd),
        atol=4 * np.sqrt(2 / draws.weighted_ess),
    )


@MOSTLY
def test_errors_with_a_t_tell_their_size(sampler):
    """Given the errors that no theta explains, a linear emulator's posterior is a t with a scale of
    their size (Ding 2016, doi 10.1080/00031305.2016.1164756)."""
    emulator, truth, likelihood = observed(0.01, 2.0, freedom=6.0)
    a, outputs = emulator.slopes, len(emulator.base)
    factor = torch.linalg.cholesky(emulator.matrix)
    basis, _ = torch.linalg.qr(torch.linalg.solve_triangular(factor, a, upper=False))
    error = torch.as_tensor(np.random.default_rng(2).normal(size=outputs))
    # Of no theta, and of four times the usual size.
    error = 4.0 * (error - basis @ (basis.T @ error))
    settings = Settings(warmup=100, draws=500)
    draws = SAMPLERS[sampler](
        likelihood.at(likelihood.y + factor @ error), truth, NONE, settings, 3
    )
    assert draws.verdict(settings) == "passed"
    freedom = 6.0 + outputs - 10
    scale = ((6.0 + error.square().sum()) / freedom).sqrt()
    given = torch.linalg.inv(precision(emulator)).diagonal().sqrt()
    expected = (given * scale * np.sqrt(freedom / (freedom - 2))).numpy()
    assert scale > 1.4
    theta, _ = flat(draws)
    assert np.abs((theta.mean(0) - truth.numpy()) / expected).max() < 0.15
    np.testing.assert_allclose(theta.std(0), expected, rtol=0.1)


@MOSTLY
def test_noise_scale_and_uniform_prior(sampler):
    """Means that do not depend on theta: theta keeps its prior, sigma has a posterior on a grid."""
    emulator = linear(1e-4)
    emulator.slopes = torch.zeros_like(emulator.slopes)
    residual = torch.as_tensor(np.random.default_rng(3).normal(size=len(emulator.outputs)))
    y = emulator.base + 0.5 * residual * emulator.output_sd
    y[0] = emulator.base[0]
    middle = torch.full((10,), 1.0, dtype=torch.float64)
    start = torch.full((3,), -0.5, dtype=torch.float64)
    likelihood = Likelihood(emulator, y, inferred(emulator, 0.6))
    settings = Settings(warmup=100, draws=600)
    draws = SAMPLERS[sampler](likelihood, middle, start, settings, 8)
    assert draws.verdict(settings) == "passed"
    theta, sigma = flat(draws)
    assert np.abs(theta.mean(0) - 2.55).max() < 0.15
    np.testing.assert_allclose(theta.std(0), 4.9 / np.sqrt(12), rtol=0.06)
    grid = np.linspace(1e-3, 4.0, 4000)
    for i, direction in enumerate(DIRECTIONS):
        here = [name.startswith(direction) for name in emulator.outputs]
        z = 0.5 * residual.numpy()[here]
        logs = stats.norm(0, grid[:, None]).logpdf(z).sum(1) + stats.halfnorm(0, 0.6).logpdf(grid)
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        mean = weights @ grid
        sd = np.sqrt(weights @ (grid - mean) ** 2)
        assert abs(sigma[:, i].mean() - mean) < 0.15 * sd
        assert sigma[:, i].std() == pytest.approx(sd, rel=0.12)


@DEEP
@pytest.mark.parametrize("noise", ["known", "inferred"])
def test_samplers_agree_where_the_bounds_cut_the_posterior(noise):
    _, truth, likelihood = observed(0.2, 4.8, noise)
    log_sigma = torch.full((len(likelihood.noise.groups),), -1.5, dtype=torch.float64)
    settings = Settings(warmup=100, draws=400)
    (a, sigma), (b, expected) = (
        flat(one(likelihood, truth, log_sigma, settings, 3)) for one in SAMPLERS.values()
    )
    assert a.max() > 4.9 and a.max() <= 5.0  # the upper bound is felt
    # Both means have Monte Carlo errors below 0.05 sd, and the largest of ten is looked at.
    assert np.abs((a.mean(0) - b.mean(0)) / b.std(0)).max() < 0.25
    np.testing.assert_allclose(a.std(0), b.std(0), rtol=0.2)
    if noise == "inferred":
        assert abs(sigma.mean() - expected.mean()) < 0.2 * expected.std()


class Ridges(LinearEmulator):
    """Linear in log theta: the first outputs are sums of log C_a and log C_b, mostly of one zone
    each, and the others say a little of the differences."""

    @classmethod
    def of(cls, zones: int) -> "Ridges":
        walls = {f"zone_{z + 1}": list(range(1 + z, 18, zones)) for z in range(zones)}
        like = linear(1e-3)
        like.parameters, like.__class__ = StiffnessInputs(walls), cls
        rng = np.random.default_rng(3)
        difference = np.kron(np.eye(zones), [1.0, -1.0])
        slopes = 0.3 * rng.normal(size=(len(like.base), zones)) @ difference
        share = np.full((zones, zones), 0.3) + 0.7 * np.eye(zones)
        slopes[:zones] = np.kron(share, [1.0, 1.0])
        like.slopes = torch.as_tensor(slopes)
        like.matrix = 1e-6 * torch.eye(len(like.base), dtype=torch.float64)
        return like

    def _predict(self, theta):
        mean = self.base + theta.log() @ self.slopes.T
        return SeparablePrediction(mean, super()._predict(theta).variance, self.matrix)


@pytest.mark.parametrize(("zones", "known"), [(1, FIFTH_OF_A_ML), (2, HALF_PERCENT)])
def test_along_the_ridges_of_well_known_outputs_beside_known_noise(zones, known):
    """One or two outputs with little noise among noisy ones: against quadrature along the ridges.
    The noise leaves their ends far apart."""
    emulator = Ridges.of(zones)
    truth = torch.tensor([0.9, 1.3, 1.1, 0.8][: 2 * zones], dtype=torch.float64)
    rng = np.random.default_rng(5)
    sd = 0.5 * emulator.output_sd
    y = emulator.predict_mean(truth) + sd * torch.as_tensor(rng.normal(size=len(sd)))
    y[:zones], sd[:zones] = emulator.predict_mean(truth)[:zones], known * emulator.output_sd[0]
    likelihood = Likelihood(emulator, y, Noise.known(sd))

    settings = {"warmup": 100, "draws": 500, "chains": 4, "rhat_max": 1.02, "ess_min": 400.0}
    how = sampling.Sampling(settings, {"starts": 4, "iterations": 100}, 1, "test")
    sampled = sampling.sample_cases([likelihood], ["ridge"], how, "importance")
    assert sampled.samplers == ("importance",)
    (draws,) = sampled.draws
    assert draws.verdict(how.settings) == "passed"

    # Sums of the logarithms are as good as known. Of the differences, theta's density is that of
    # theta itself.
    half = torch.linspace(-1.6, 1.6, 161, dtype=torch.float64)
    apart = torch.cartesian_prod(*[half] * zones).reshape(-1, zones, 1)
    x = truth.log().reshape(zones, 2).mean(1)[:, None] + apart * torch.tensor([1.0, -1.0])
    theta = x.exp().flatten(1)
    inside = ((theta >= emulator.lower) & (theta <= emulator.upper)).all(1)
    residual = (y - emulator.predict_mean(theta))[:, zones:] / sd[zones:]
    weight = torch.softmax(-0.5 * residual.square().sum(1) + torch.where(inside, 0, -math.inf), 0)
    mean = weight @ theta
    scatter = (weight @ (theta - mean).square()).sqrt()
    assert scatter.min() > 0.1  # far longer than wide
    found = draws.theta.reshape(-1, 2 * zones)
    assert np.abs((found.mean(0) - mean.numpy()) / scatter.numpy()).max() < 0.15
    np.testing.assert_allclose(found.std(0), scatter, rtol=0.1)


@MOSTLY
def test_across_the_layer_of_a_well_known_volume(sampler):
    """Inferred noise leaves theta wide; an output that has little makes a thin curved layer of it.

    A linear emulator whose data say nothing of six parameters: given the noise, the other four have
    a Gaussian posterior, so that only the two scales of the noise need a grid.
    """
    emulator = linear(0.003)
    emulator.slopes[:, 4:] = 0.0
    emulator.slopes[0] *= 10
    truth = torch.full((10,), 2.0, dtype=torch.float64)
    unit = emulator.output_sd.clone()
    unit[0] = 0.0
    even = torch.arange(len(unit)) % 2 == 0
    known = torch.where(unit == 0, FIFTH_OF_A_ML * emulator.output_sd, 0.0)
    noise = Noise(known, {"even": unit * even, "odd": unit * ~even}, 1.0)
    deviates = torch.as_tensor(np.random.default_rng(4).normal(size=len(unit)))
    likelihood = Likelihood(emulator, emulator.predict(truth).mean + 0.3 * deviates * unit, noise)
    settings = {"warmup": 150, "draws": 250, "chains": 4, "rhat_max": 1.03, "target_accept": 0.9}
    how = sampling.Sampling(settings, {"starts": 4, "iterations": 100}, 1, "test")
    sampled = sampling.sample_cases([likelihood], ["layer"], how, sampler)
    assert sampled.samplers == (sampler,)
    (draws,) = sampled.draws
    assert draws.verdict(how.settings) == "passed"

    a = emulator.slopes[:, :4]
    grid = torch.linspace(np.log(0.05), np.log(1.5), 60, dtype=torch.float64)
    logs = torch.cartesian_prod(grid, grid)
    precision = torch.linalg.inv(emulator.matrix + torch.diag_embed(noise.variance(logs)))
    information = a.T @ precision @ a
    residual = likelihood.y - emulator.base
    mean = torch.linalg.solve(information, a.T @ precision @ residual)
    left = residual - mean @ a.T
    density = 0.5 * (
        torch.logdet(precision)
        - torch.logdet(information)
        - (left[:, None] @ precision @ left[..., None]).flatten()
    )
    weight = torch.softmax(density + noise.log_prior(logs) + logs.sum(1), 0)
    expected = weight @ mean
    covariance = torch.linalg.inv(information) + (mean - expected)[..., None] * (
        mean - expected
    ).unsqueeze(-2)
    covariance = torch.einsum("g,gij->ij", weight, covariance)
    sd = covariance.diagonal().sqrt()
    theta = torch.as_tensor(draws.theta[..., :4]).flatten(0, 1)
    assert ((theta.mean(0) - expected) / sd).abs().max() < 0.2
    torch.testing.assert_close(theta.std(0), sd, rtol=0.15, atol=0.0)
    sigma = torch.as_tensor(draws.sigma).flatten(0, 1)
    torch.testing.assert_close(sigma.mean(0), weight @ logs.exp(), rtol=0.08, atol=0.0)
    volume = theta @ a[0]
    thickness = (a[0] @ covariance @ a[0]).sqrt()
    assert thickness < 0.03 * (a[0].square() @ sd.square()).sqrt()  # thin it is
    torch.testing.assert_close(volume.std(), thickness, rtol=0.1, atol=0.0)
    assert np.abs(draws.theta[..., 4:].reshape(-1, 6).mean(0) - 2.55).max() < 0.25


def test_a_wrong_surrogate_costs_draws_and_not_correctness(monkeypatch):
    """The exact density weights the draws of another case's posterior, one sd away."""
    emulator, truth, likelihood = observed(0.02, 2.0)
    covariance = torch.linalg.inv(precision(emulator))
    sd = covariance.diagonal().sqrt()
    elsewhere = likelihood.at(emulator.predict(truth + covariance[:, 0] / sd[0]).mean)

    def wrong(likelihood, *rest):
        for found in approximate(elsewhere, *rest):
            yield replace(found, target=Target(likelihood, found.target.transform))

    monkeypatch.setattr(by_importance, "approximate", wrong)
    settings = Settings(ess_min=50)
    draws = by_importance.sample_by_importance(likelihood, truth, NONE, settings, 4)
    assert draws.verdict(settings) == "passed" and draws.weighted_ess < 600
    theta, _ = flat(draws)
    assert np.abs((theta.mean(0) - truth.numpy()) / sd.numpy()).max() < 0.2
    np.testing.assert_allclose(theta.std(0), sd.numpy(), rtol=0.2)


def test_an_exact_surrogate_is_checked_at_some_draws(monkeypatch):
    """And what is not computed would have changed nothing."""
    _, truth, likelihood = observed(0.02, 2.0)
    evaluated, potential = [], Target.potential

    def counted(self, position, *variance):
        evaluated.append(0 if variance else len(position))
        return potential(self, position, *variance)

    monkeypatch.setattr(Target, "potential", counted)
    *_, found = approximate(likelihood, truth, NONE, torch.Generator().manual_seed(1))
    position = found.found.u[:2400]
    evaluated.clear()
    energy, lacking = found.exact(position)
    assert sum(evaluated) == 300
    exact = potential(found.target, position)
    torch.testing.assert_close(energy, exact, rtol=0.0, atol=0.02)
    weights = torch.softmax(lacking, 0), torch.softmax(energy + lacking - exact, 0)
    torch.testing.assert_close(*(w @ position for w in weights), rtol=0.0, atol=1e-3)


@EITHER
def test_same_seed_same_draws(sampler):
    _, truth, likelihood = observed(0.02, 2.0)
    first, again, other = (
        SAMPLERS[sampler](likelihood, truth, NONE, Settings(warmup=5, draws=20), seed).theta
        for seed in (7, 7, 8)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.allclose(first, other)


def test_nuts_leaves_the_global_random_numbers_alone():
    _, truth, likelihood = observed(0.02, 2.0)
    before = torch.get_rng_state()
    SAMPLERS["nuts"](likelihood, truth, NONE, Settings(warmup=5, draws=5), 1)
    assert torch.equal(before, torch.get_rng_state())


def test_potential_is_that_of_the_density():
    emulator = linear(0.5, 0.1)
    likelihood = Likelihood(emulator, emulator.base + 1.0, Noise.none(emulator))
    middle = torch.full((10,), 2.0, dtype=torch.float64)
    target = Target.near(likelihood, middle, NONE)
    a, b = (torch.as_tensor(np.random.default_rng(i).normal(0.7, 0.5, size=10)) for i in (1, 2))

    def log_density(position):
        theta, _ = target.constrain(position)
        jacobian = torch.autograd.functional.jacobian(lambda p: target.constrain(p)[0], position)
        return likelihood.log_density(theta) + torch.linalg.slogdet(jacobian)[1]

    difference = target.potential(a) - target.potential(b)
    assert float(difference) == pytest.approx(float(log_density(b) - log_density(a)))
    theta, log_sigma = target.constrain(a)
    torch.testing.assert_close(target.unconstrain(theta, log_sigma), a)


def test_what_importance_sampling_cannot_do_goes_to_nuts(caplog):
    _, _, likelihood = observed(0.1, 2.0)
    how = sampling.Sampling(
        {"warmup": 10, "draws": 10, "ess_min": 1e6}, {"starts": 2, "iterations": 40}, 1, "test"
    )
    sampled = sampling.sample_cases([likelihood] * 2, ["a", "b"], how, "importance")
    assert sampled.samplers == ("nuts",) * 2
    assert all("failed" in draws.verdict(how.settings) for draws in sampled.draws)
    assert "case test/a failed" in caplog.text and "sampled by NUTS" in caplog.text
