"""Batched HMC against posteriors that are known and against NUTS."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from regional_lv.inference import hmc, sampling
from regional_lv.inference.hmc import sample_batch
from regional_lv.inference.likelihood import Likelihood, Noise
from regional_lv.inference.nuts import Settings, Target, sample_in_step, verdict
from regional_lv.inference.shell import Shell
from regional_lv.inference.surrogate import OwnMean, Polynomial, Surrogate
from tests.inference.test_likelihood import linear


def cases(spread: float, noise: Noise | None = None, freedom: float = np.inf):
    """Three cases of a linear emulator, observed without error, and their likelihoods."""
    emulator = linear(spread, freedom=freedom)
    truth = torch.stack([torch.full((10,), c, dtype=torch.float64) for c in (1.5, 2.0, 4.8)])
    noise = Noise.none(emulator) if noise is None else noise
    common = Likelihood(emulator, emulator.base, noise)
    return emulator, truth, [common.at(y) for y in emulator.predict(truth).mean]


def run(likelihoods, truth, settings, seeds, attempt="hmc"):
    groups = len(likelihoods[0].noise.groups)
    log_sigma = torch.full((len(likelihoods), groups), -1.5, dtype=torch.float64)
    return sample_batch(likelihoods, truth, log_sigma, settings, seeds, attempt)


@pytest.mark.parametrize(
    ("attempt", "kept"), [("hmc", 350), ("careful hmc", 250), ("patient hmc", 250)]
)
def test_gaussian_posteriors_side_by_side(attempt, kept):
    emulator, truth, likelihoods = cases(0.02)
    settings = Settings(warmup=80, draws=kept, ess_min=kept / 2, rhat_max=1.05)
    draws = run(likelihoods, truth, settings, [1, 2, 3], attempt)
    a = emulator.slopes
    expected = torch.linalg.inv(a.T @ torch.linalg.solve(emulator.matrix, a)).numpy()
    sd = np.sqrt(expected.diagonal())
    for one, known in zip(draws, truth.numpy(), strict=True):
        theta = one.theta.reshape(-1, 10)
        assert not one.diverging.any()
        assert one.acceptance_rate.mean() > 0.6
        assert verdict(one, settings) == "passed"
        assert np.abs((theta.mean(0) - known) / sd).max() < 4 / np.sqrt(kept)
        np.testing.assert_allclose(
            np.cov(theta, rowvar=False) / np.outer(sd, sd),
            expected / np.outer(sd, sd),
            atol=6 / np.sqrt(kept),
        )


@pytest.mark.parametrize("attempt", hmc.ATTEMPTS[:2])
def test_errors_with_a_t_tell_their_size(attempt):
    """Given the errors that no theta explains, a linear emulator's posterior is a t with a scale of
    their size (Ding 2016, doi 10.1080/00031305.2016.1164756)."""
    emulator = linear(0.01, freedom=6.0)
    truth = torch.full((1, 10), 2.0, dtype=torch.float64)
    a, outputs = emulator.slopes, len(emulator.base)
    factor = torch.linalg.cholesky(emulator.matrix)
    basis, _ = torch.linalg.qr(torch.linalg.solve_triangular(factor, a, upper=False))
    error = torch.as_tensor(np.random.default_rng(2).normal(size=outputs))
    # Of no theta, and of four times the usual size.
    error = 4.0 * (error - basis @ (basis.T @ error))
    y = emulator.predict(truth[0]).mean + factor @ error
    likelihood = Likelihood(emulator, y, Noise.none(emulator))
    (draws,) = run([likelihood], truth, Settings(warmup=80, draws=500), [3], attempt)
    given = torch.linalg.inv(a.T @ torch.linalg.solve(emulator.matrix, a)).diagonal().sqrt()
    freedom = 6.0 + outputs - 10
    scale = ((6.0 + error.square().sum()) / freedom).sqrt()
    expected = given * scale * np.sqrt(freedom / (freedom - 2))
    assert scale > 1.4
    theta = torch.as_tensor(draws.theta).reshape(-1, 10)
    assert draws.acceptance_rate.mean() > 0.8
    assert ((theta.mean(0) - truth[0]) / expected).abs().max() < 0.15
    torch.testing.assert_close(theta.std(0), expected, rtol=0.1, atol=0.0)


def test_draws_are_of_the_exact_density_however_rough_the_first_surrogate():
    """Trajectories follow a mean that is wrong by up to the noise; the finer look puts it right."""
    emulator, sd = linear(0.05), 0.3
    rough = copy.copy(emulator)
    rough.base = emulator.base + 0.8 * sd * torch.linspace(-1, 1, len(emulator.base)).double()
    emulator.__class__ = type("Rough", (type(emulator),), {"rough": rough})
    truth = torch.full((1, 10), 2.5, dtype=torch.float64)
    noise = Noise.known(torch.full_like(emulator.output_sd, sd))
    likelihood = Likelihood(emulator, emulator.predict(truth[0]).mean, noise)
    information = likelihood.information(truth[0], torch.zeros(0)) / truth[0] ** 2
    expected = torch.linalg.inv(information).diagonal().sqrt()
    seen = {}
    for one in (likelihood, Likelihood(rough, likelihood.y, noise)):
        (draws,) = run([one], truth, Settings(warmup=80, draws=600), [3])
        seen[one is likelihood] = torch.as_tensor(draws.theta).reshape(-1, 10)
    away = {exact: ((t.mean(0) - truth[0]) / expected).abs().max() for exact, t in seen.items()}
    assert away[False] > 0.6  # what the rough one alone would give
    assert away[True] < 0.2
    torch.testing.assert_close(seen[True].std(0), expected, rtol=0.15, atol=0.0)


def test_nothing_diverges_near_a_bound():
    """With one stretched map for the whole box, every third seed diverged in the last case."""
    _, truth, likelihoods = cases(0.02)
    settings = Settings(warmup=80, draws=80)
    for seed in range(6):
        (draws,) = run(likelihoods[2:], truth[2:], settings, [seed])
        assert not draws.diverging.any()


def difference(a, b) -> tuple[float, float]:
    """Largest difference of means in sd, and of sds, relative."""
    a, b = (d.theta.reshape(-1, 10) for d in (a, b))
    means = np.abs((a.mean(0) - b.mean(0)) / b.std(0)).max()
    return float(means), float(np.abs(a.std(0) / b.std(0) - 1).max())


@pytest.mark.parametrize("kind", ["known", "inferred"])
def test_agrees_with_nuts_where_the_bounds_cut_the_posterior(kind):
    emulator = linear(0.2)
    sd = torch.full_like(emulator.output_sd, 0.2)
    noise = {"known": Noise.known(sd), "inferred": Noise.shared(emulator, 0.3)}[kind]
    _, truth, likelihoods = cases(0.2, noise)
    settings = Settings(warmup=100, draws=300, ess_min=120, rhat_max=1.05)
    (together,) = run(likelihoods[2:], truth[2:], settings, [3])
    log_sigma = torch.full((len(likelihoods[2].noise.groups),), -1.5, dtype=torch.float64)
    (alone,) = sample_in_step(likelihoods[2:], truth[2:], log_sigma[None], settings, [5], ["third"])
    assert alone.theta.max() > 4.9  # the upper bound is felt
    # Both means have Monte Carlo errors below 0.05 sd, and the largest of ten is looked at.
    means, sds = difference(together, alone)
    assert means < 0.35 and sds < 0.3
    if kind == "inferred":
        assert together.sigma.mean() == pytest.approx(alone.sigma.mean(), rel=0.15)


@pytest.mark.parametrize(("sampler", "kept"), [("hmc", 300), ("nuts", 250)])
def test_along_the_shell_of_an_exact_volume(sampler, kept):
    """Inferred noise leaves theta wide; an output that has none makes a thin curved shell of it.

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
    noise = Noise(torch.zeros_like(unit), {"even": unit * even, "odd": unit * ~even}, 1.0)
    deviates = torch.as_tensor(np.random.default_rng(4).normal(size=len(unit)))
    likelihood = Likelihood(emulator, emulator.predict(truth).mean + 0.3 * deviates * unit, noise)
    settings = {"warmup": 100, "draws": kept, "chains": 4, "ess_min": kept, "rhat_max": 1.03}
    how = sampling.Sampling(settings, {"starts": 4, "iterations": 100}, 1, "test")
    (maximum,) = how.find_maxima([likelihood])
    start = maximum.theta[0], maximum.log_sigma[0]
    prepared = hmc.prepare(Target.near(likelihood, *start), *start, 1)
    assert isinstance(prepared.surrogate, OwnMean) and isinstance(prepared.target.box, Shell)
    sampled = sampling.SAMPLERS[sampler]([likelihood], ["shell"], how)
    assert sampled.samplers == (sampler,)
    (draws,) = sampled.draws
    assert verdict(draws, how.settings) == "passed"

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
    shell = (a[0] @ covariance @ a[0]).sqrt()
    assert shell < 0.02 * (a[0].square() @ sd.square()).sqrt()  # thin it is
    torch.testing.assert_close(volume.std(), shell, rtol=0.1, atol=0.0)
    assert np.abs(draws.theta[..., 4:].reshape(-1, 6).mean(0) - 2.55).max() < 0.25


@pytest.mark.parametrize("freedom", [np.inf, 5.0])
def test_gradient_of_the_polynomial_surrogate(freedom):
    _, truth, likelihoods = cases(0.1, freedom=freedom)
    none = torch.zeros(0, dtype=torch.float64)
    prepared = [
        hmc.prepare(Target.near(one, theta, none), theta, none, 1)
        for one, theta in zip(likelihoods, truth, strict=True)
    ]
    _, (surrogate, _) = hmc.together(prepared)
    assert isinstance(surrogate, Polynomial)
    centre = torch.stack([p.centre for p in prepared])[:, None]
    position = centre + 0.1 * torch.as_tensor(np.random.default_rng(1).normal(size=(3, 4, 10)))
    value, gradient = surrogate.with_gradient(position)
    expected, by_autograd = Surrogate.with_gradient(surrogate, position)
    torch.testing.assert_close(value, expected)
    torch.testing.assert_close(gradient, by_autograd)


def test_a_bad_surrogate_costs_draws_and_not_correctness():
    """The exact density decides: with the surrogate of another case the posterior is the same."""
    emulator, truth, likelihoods = cases(0.02)
    settings = Settings(warmup=80, draws=900)
    shifted = [likelihoods[0].at(likelihoods[0].y + 0.003)]
    original = hmc.prepare

    def wrong(target, *rest):
        prepared = original(target, *rest)
        other = original(Target(shifted[0], target.box), *rest)
        return replace(prepared, surrogate=other.surrogate)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hmc, "prepare", wrong)
        (draws,) = run(likelihoods[:1], truth[:1], settings, [4])
    assert 0.1 < draws.acceptance_rate.mean() < 0.9
    a = emulator.slopes
    sd = torch.linalg.inv(a.T @ torch.linalg.solve(emulator.matrix, a)).diagonal().sqrt().numpy()
    theta = draws.theta.reshape(-1, 10)
    assert np.abs((theta.mean(0) - truth[0].numpy()) / sd).max() < 0.25
    np.testing.assert_allclose(theta.std(0), sd, rtol=0.2)


def test_same_seeds_same_draws_and_others_differ():
    _, truth, likelihoods = cases(0.1)
    settings = Settings(warmup=40, draws=20)
    first, again, other = (
        run(likelihoods, truth, settings, seeds)[0].theta
        for seeds in ([1, 2, 3], [1, 2, 3], [4, 5, 6])
    )
    np.testing.assert_array_equal(first, again)
    assert not np.allclose(first, other)


def test_emulators_may_differ_between_cases():
    """Local emulators: every case has its own."""
    _, truth, likelihoods = cases(0.1)
    apart = [
        Likelihood(copy.copy(one.emulator), one.y, Noise.none(one.emulator)) for one in likelihoods
    ]
    settings = Settings(warmup=40, draws=20)
    for a, b in zip(
        run(likelihoods, truth, settings, [1, 2, 3]),
        run(apart, truth, settings, [1, 2, 3]),
        strict=True,
    ):
        np.testing.assert_allclose(a.theta, b.theta, rtol=1e-6)


def test_what_fails_its_gate_always_goes_to_nuts(monkeypatch, caplog):
    *_, likelihoods = cases(0.1)
    called = []

    def nuts(likelihoods, theta, log_sigma, settings, seeds, names):
        called.extend(names)
        return sample_in_step(likelihoods, theta, log_sigma, settings, seeds, names)

    monkeypatch.setattr(sampling, "sample_in_step", nuts)
    settings = {"warmup": 10, "draws": 10, "ess_min": 1e6}
    point = {"starts": 2, "iterations": 40}
    how = sampling.Sampling(settings, point, 1, "test")
    sampled = sampling.sample_together(likelihoods, ["a", "b", "c"], how)
    assert called == ["test/a", "test/b", "test/c"]
    assert sampled.samplers == ("nuts",) * 3
    assert all(draws.repeated for draws in sampled.draws)
    assert "batched HMC" in caplog.text


@pytest.mark.parametrize("name", ["hmc", "nuts"])
def test_samplers_of_the_config_are_registered(name):
    assert name in sampling.SAMPLERS
