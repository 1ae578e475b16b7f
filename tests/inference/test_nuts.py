"""The sampler against posteriors that are known, and the files that it makes."""

from dataclasses import replace

import arviz as az
import numpy as np
import pandas as pd
import pytest
import torch
from scipy import stats

from regional_lv import emulators
from regional_lv.errors import InputError
from regional_lv.inference import sampling
from regional_lv.inference.likelihood import Likelihood, Noise
from regional_lv.inference.nuts import Settings, Target, sample_in_step
from regional_lv.inference.summaries import TABLES, summarise_posteriors
from tests.inference.conftest import PARAMETERS
from tests.inference.test_likelihood import DIRECTIONS, linear

NUTS = {
    "chains": 2,
    "warmup": 200,
    "draws": 300,
    "target_accept": 0.8,
    "max_tree_depth": 8,
    "rhat_max": 1.05,
    "ess_min": 50,
    "cases_per_batch": 2,
}
POINT = {"starts": 2, "iterations": 60}


def sample_one(likelihood, theta, log_sigma, settings, seed, name):
    (draws,) = sample_in_step([likelihood], theta[None], log_sigma[None], settings, [seed], [name])
    return draws


def test_gaussian_posterior():
    emulator = linear(0.02)
    truth = torch.linspace(2.0, 3.0, 10, dtype=torch.float64)
    y = emulator.predict(truth).mean
    likelihood = Likelihood(emulator, y, Noise.none(emulator))
    none = torch.zeros(0, dtype=torch.float64)
    settings = Settings(warmup=200, draws=600)
    draws = sample_one(likelihood, truth, none, settings, 7, "known")
    assert not draws.repeated and not draws.diverging.any()
    a = emulator.slopes
    expected = torch.linalg.inv(a.T @ torch.linalg.solve(emulator.matrix, a)).numpy()
    sd = np.sqrt(expected.diagonal())
    assert sd.max() < 0.3  # the bounds at 0.1 and 5 do not matter
    theta = draws.theta.reshape(-1, 10)
    assert np.abs((theta.mean(0) - truth.numpy()) / sd).max() < 0.15
    np.testing.assert_allclose(
        np.cov(theta, rowvar=False) / np.outer(sd, sd),
        expected / np.outer(sd, sd),
        atol=0.15,
    )


def test_same_seed_same_draws():
    emulator = linear(0.02)
    truth = torch.linspace(2.0, 3.0, 10, dtype=torch.float64)
    likelihood = Likelihood(emulator, emulator.predict(truth).mean, Noise.none(emulator))
    none, settings = torch.zeros(0, dtype=torch.float64), Settings(warmup=5, draws=5)
    first, again, other = (
        sample_one(likelihood, truth, none, settings, seed, "known").theta for seed in (7, 7, 8)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.allclose(first, other)


def test_cases_in_step_are_those_alone():
    emulator = linear(0.02)
    truths = [torch.linspace(low, 3.0, 10, dtype=torch.float64) for low in (1.0, 1.5, 2.0)]
    likelihoods = [
        Likelihood(emulator, emulator.predict(t).mean, Noise.none(emulator)) for t in truths
    ]
    none, settings = torch.zeros(0, dtype=torch.float64), Settings(warmup=10, draws=5)
    settings = replace(settings, ess_min=0, rhat_max=100)
    together = sample_in_step(
        likelihoods, torch.stack(truths), torch.stack([none] * 3), settings, [1, 2, 3], "abc"
    )
    for i, (likelihood, truth) in enumerate(zip(likelihoods, truths, strict=True)):
        alone = sample_one(likelihood, truth, none, settings, i + 1, "alone")
        np.testing.assert_allclose(together[i].theta, alone.theta, rtol=1e-5)
        np.testing.assert_allclose(together[i].acceptance_rate, alone.acceptance_rate, rtol=1e-4)


def test_noise_scale_and_uniform_prior():
    """Means that do not depend on theta: theta keeps its prior, sigma has a posterior on a grid."""
    emulator = linear(1e-4)
    emulator.slopes = torch.zeros_like(emulator.slopes)
    noise = Noise.inferred(emulator, 0.6)
    residual = torch.as_tensor(np.random.default_rng(3).normal(size=len(emulator.outputs)))
    y = emulator.base + 0.5 * residual * emulator.output_sd
    y[0] = emulator.base[0]
    middle = torch.full((10,), 1.0, dtype=torch.float64)
    start = torch.full((3,), -0.5, dtype=torch.float64)
    settings = Settings(warmup=200, draws=600)
    likelihood = Likelihood(emulator, y, noise)
    draws = sample_one(likelihood, middle, start, settings, 8, "noise")
    theta = draws.theta.reshape(-1, 10)
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
        sigma = draws.sigma[..., i].ravel()
        assert abs(sigma.mean() - mean) < 0.15 * sd
        assert sigma.std() == pytest.approx(sd, rel=0.12)


def test_potential_is_that_of_the_density():
    emulator = linear(0.5, 0.1)
    likelihood = Likelihood(emulator, emulator.base + 1.0, Noise.none(emulator))
    middle = torch.full((10,), 2.0, dtype=torch.float64)
    target = Target.near(likelihood, middle, torch.zeros(0, dtype=torch.float64))
    a, b = (torch.as_tensor(np.random.default_rng(i).normal(0.7, 0.5, size=10)) for i in (1, 2))

    def log_density(position):
        theta, _ = target.constrain(position)
        jacobian = torch.autograd.functional.jacobian(lambda p: target.constrain(p)[0], position)
        return likelihood.log_density(theta) + torch.linalg.slogdet(jacobian)[1]

    difference = target.potential(a) - target.potential(b)
    assert float(difference) == pytest.approx(float(log_density(b) - log_density(a)))
    theta, log_sigma = target.constrain(a)
    torch.testing.assert_close(target.unconstrain(theta, log_sigma), a)


def test_a_failed_posterior_is_sampled_again_and_kept(caplog):
    emulator = linear(0.02)
    truth = torch.full((10,), 2.0, dtype=torch.float64)
    likelihood = Likelihood(emulator, emulator.predict(truth).mean, Noise.none(emulator))
    settings = Settings(warmup=30, draws=20, ess_min=1e6)
    none = torch.zeros(0, dtype=torch.float64)
    draws = sample_one(likelihood, truth, none, settings, 9, "hopeless")
    assert draws.repeated and draws.theta.shape == (2, 20, 10)
    assert "sampled again" in caplog.text and "second time" in caplog.text


# ------------------------------------------------------------------------------------ files


def sample(study, path, batch, batches, cases=4, noise=None, sampler="nuts", nuts=NUTS):
    sampling.sample_set_batch(
        *(study / "emulator.pt", study / "test.parquet", "test", batch, batches, cases, noise),
        *(sampler, nuts, POINT, 1, path),
    )


def test_test_set(study):
    batches = [study / f"batch-{i}.nc" for i in range(2)]
    for i, path in enumerate(batches):
        sample(study, path, i, 2, cases=2)
    data = az.from_netcdf(batches[1])
    assert data.posterior["theta"].dims == ("chain", "draw", "case", "parameter")
    assert data.posterior["theta"].shape == (2, 300, 1, 10)
    assert data.posterior["case"].to_numpy().tolist() == ["5"]
    assert data.posterior["parameter"].to_numpy().tolist() == list(PARAMETERS.names)
    names = {"theta_map", "theta_true", "y_obs", "seconds", "repeated", "sampler"}
    assert set(data.constant_data) == names
    summarise_posteriors(batches, [study / f"{name}.csv" for name in TABLES])
    tables = {name: pd.read_csv(study / f"{name}.csv") for name in TABLES}
    assert len(tables["diagnostics"]) == len(tables["recovery"]) == 20
    assert (tables["diagnostics"]["sampler"] == "nuts").all()
    assert data.sample_stats["outside"].shape == (2, 300, 1)
    assert tables["diagnostics"]["outside"].between(0, 1).all()
    assert tables["coverage"]["parameter"].tolist() == [*PARAMETERS.names, "all"]
    assert tables["map_mse"]["case"].tolist() == [3, 5]
    assert tables["recovery"]["variance_ratio"].max() < 1
    assert tables["recovery"]["rank"].between(0, 600).all()
    assert tables["hpd"]["parameter"].tolist() == [*PARAMETERS.names, "all"]
    assert len(tables["correlations"]) == 100 and len(tables["zone_correlations"]) == 25
    with pytest.raises(InputError, match="too few for 9 batches"):
        sample(study, batches[0], 0, 9)


FEW = NUTS | {"warmup": 40, "draws": 20, "ess_min": 0, "rhat_max": 10.0}


def test_a_case_does_not_depend_on_its_batch(study):
    paths = study / "alone.nc", study / "both.nc"
    sample(study, paths[0], 1, 2, cases=2, nuts=FEW)
    sample(study, paths[1], 0, 1, cases=2, nuts=FEW)
    alone, both = (az.from_netcdf(p).posterior["theta"].sel(case="5").to_numpy() for p in paths)
    np.testing.assert_array_equal(alone, both)


def test_noisy_scenario(study):
    """Noise is added to what is measured, the rest is left out, and zones are handed on."""
    noise = {"volume": 2.0, "circumferential": 0.02, "radial": 0.05, "longitudinal": None}
    test = pd.read_parquet(study / "test.parquet")
    test.assign(zone="septal").to_parquet(study / "scenario.parquet")
    sampling.sample_set_batch(
        *(study / "emulator.pt", study / "scenario.parquet", "some-noisy", 0, 1, 2, noise),
        *("hmc", FEW, POINT, 1, study / "noisy.nc"),
    )
    data = az.from_netcdf(study / "noisy.nc")
    assert data.constant_data["zone"].to_numpy().tolist() == ["septal"] * 2
    outputs = data.observed_data["output"].to_numpy().tolist()
    assert len(outputs) == 35 and not [name for name in outputs if "longitudinal" in name]
    change = data.observed_data["y"].to_numpy() - test[outputs].to_numpy()[:2]
    assert 1e-3 < np.abs(change[:, 1:18]).mean() < 0.04 and np.abs(change[:, 0]).max() < 8
    spread = data.posterior["theta"].std(("chain", "draw"))
    sample(study, study / "exact.nc", 0, 1, cases=2, nuts=FEW, sampler="hmc")
    exact = az.from_netcdf(study / "exact.nc").posterior["theta"].std(("chain", "draw"))
    assert (spread / exact).mean() > 1.2  # the toy's are wide already: the box bounds both


@pytest.mark.parametrize("sampler", ["hmc", "nuts"])
@pytest.mark.parametrize("measured", ["subject.csv", "with_sd.csv"])
def test_subject(study, measured, sampler):
    files = study / f"{measured}.nc", study / f"{measured}.diagnostics.csv"
    sampling.sample_subject(
        study / "emulator.pt", study / measured, "someone", sampler, NUTS, POINT, 1.0, 1, *files
    )
    data, table = az.from_netcdf(files[0]), pd.read_csv(files[1])
    inferred = measured == "subject.csv"
    assert ("sigma" in data.posterior) == inferred
    if inferred:
        assert data.posterior["direction"].to_numpy().tolist() == ["circumferential", "radial"]
        assert data.posterior["sigma"].shape == (2, 300, 1, 2)
    assert len(table) == (12 if inferred else 10)
    assert (table["sampler"] == sampler).all()
    predicted = data.posterior_predictive["y"]
    assert predicted.shape == (2, 300, 1, 33)
    low, high = predicted.quantile([0.01, 0.99], ("chain", "draw"))
    observed = data.observed_data["y"]
    assert int(((observed < low) | (observed > high)).sum()) <= 3


def test_outputs_that_the_emulator_lacks(study):
    emulator = emulators.load(study / "emulator.pt").select(["volume_ml", "radial_01"])
    with pytest.raises(InputError, match="radial_02"):
        emulator.select(["radial_02"])
