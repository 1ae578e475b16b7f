"""From observations to posteriors: the test set in batches, subjects one by one."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import arviz as az
import numpy as np
import pandas as pd
import torch
import xarray as xr

from regional_lv import aha, emulators
from regional_lv.emulators.base import Emulator
from regional_lv.errors import InputError
from regional_lv.inference.diagnostics import diagnose
from regional_lv.inference.hmc import sample_batch
from regional_lv.inference.likelihood import Likelihood, Noise, draw_observations
from regional_lv.inference.nuts import Draws, Settings, sample_case, verdict
from regional_lv.inference.point import find_map
from regional_lv.measured import read_measured
from regional_lv.progress import Progress
from regional_lv.seeds import derive

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Sampled:
    """Posteriors of some cases with the same outputs and the same kind of noise.

    y: (C, D). theta_map: (C, 10). truth: (C, 10) or None.
    """

    cases: tuple[str, ...]
    y: torch.Tensor
    theta_map: torch.Tensor
    draws: tuple[Draws, ...]
    truth: np.ndarray | None = None


def sample_cases(
    likelihood: Likelihood,
    cases: Sequence[str],
    nuts: dict,
    starts: int,
    iterations: int,
    seed: int,
    set_name: str,
) -> Sampled:
    """MAP, then NUTS, of every observation in `likelihood.y` (C, D).

    nuts: section of the config (keys that are no setting of the sampler are ignored). seed: the
    study's master seed; every case has its own, so that batches may be cut in any way.
    """
    settings, name = Settings.from_config(nuts), likelihood.emulator.name
    progress = Progress(f"{name}, {set_name}: posteriors", len(cases))
    maxima, draws = [], []
    for i, case in enumerate(cases):
        # One by one: matrix products round differently in batches of another size, and a case
        # must not depend on the batch that it is in.
        point = find_map(
            likelihood.at(likelihood.y[i : i + 1]),
            starts,
            iterations,
            derive(seed, "map", name, set_name),
        )
        maxima.append(point.theta)
        draws.append(
            sample_case(
                likelihood.at(likelihood.y[i]),
                point.theta[0],
                point.log_sigma[0],
                settings,
                derive(seed, "nuts", name, set_name, case),
                f"{set_name}/{case}",
            )
        )
        progress.step()
    return Sampled(tuple(cases), likelihood.y, torch.cat(maxima), tuple(draws))


def sample_together(
    likelihood: Likelihood,
    cases: Sequence[str],
    nuts: dict,
    starts: int,
    iterations: int,
    seed: int,
    set_name: str,
) -> Sampled:
    """As `sample_cases`, all cases at once by batched HMC; NUTS for those that fail their gate.

    Numbers depend in their last digits on which cases share a batch.
    """
    settings, name = Settings.from_config(nuts), likelihood.emulator.name
    points = find_map(likelihood, starts, iterations, derive(seed, "map", name, set_name))
    seeds = [derive(seed, "hmc", name, set_name, case) for case in cases]
    draws = sample_batch(likelihood, points.theta, settings, seeds)
    progress = Progress(f"{name}, {set_name}: posteriors", len(cases))
    for i, case in enumerate(cases):
        outcome = verdict(draws[i], settings)
        if outcome != "passed":
            log.warning("case %s/%s %s by batched HMC; sampled by NUTS", set_name, case, outcome)
            draws[i] = sample_case(
                likelihood.at(likelihood.y[i]),
                points.theta[i],
                points.log_sigma[i],
                settings,
                derive(seed, "nuts", name, set_name, case),
                f"{set_name}/{case}",
            )
            outcome = verdict(draws[i], settings)
        progress.step(failed=outcome != "passed")
    return Sampled(tuple(cases), likelihood.y, points.theta, tuple(draws))


SAMPLERS = {"hmc": sample_together, "nuts": sample_cases}
"""`test_posteriors.sampler` of the config -> how a set of simulated cases is sampled."""


def sample_test_batch(
    emulator_file: str | Path,
    test: str | Path,
    first: int,
    last: int,
    sampler: str,
    nuts: dict,
    point: dict,
    seed: int,
    posteriors: str | Path,
) -> None:
    """Sample rows `first` to `last` - 1 of a screened test table; write them (NetCDF).

    Simulated data carry no noise: the likelihood has the emulator's error alone. point: section
    `map` of the config. Raises InputError if the table has none of these rows.
    """
    emulator = emulators.load(emulator_file)
    theta, y, samples = emulators.read_simulations(test)
    chosen = slice(first, min(last, len(samples)))
    if chosen.start >= chosen.stop:
        raise InputError(
            f"{test}: it has {len(samples)} simulations that converged, so that there is no row "
            f"{first}; lower test_posteriors.cases, or raise design.test"
        )
    at = [aha.OUTPUTS.index(name) for name in emulator.outputs]
    likelihood = Likelihood(emulator, torch.as_tensor(y[chosen][:, at]), Noise.none(emulator))
    sampled = SAMPLERS[sampler](
        likelihood, samples[chosen], nuts, point["starts"], point["iterations"], seed, "test"
    )
    sampled = Sampled(**{**sampled.__dict__, "truth": theta[chosen]})
    write(to_inference_data(sampled, likelihood, nuts), posteriors)


def sample_subject(
    emulator_file: str | Path,
    measured: str | Path,
    subject: str,
    nuts: dict,
    point: dict,
    noise_prior_scale: float,
    seed: int,
    posterior: str | Path,
    diagnostics: str | Path,
) -> None:
    """Sample the posterior of a measured file; write it (NetCDF) and its diagnostics (CSV).

    The emulator is reduced to the outputs that were measured. Where the strains come with a
    standard deviation, that is the noise; where they do not, one scale per direction is inferred
    with a half-normal prior of scale `noise_prior_scale` (in training sd).

    Raises InputError if the measured file cannot be used.
    """
    table = read_measured(measured).set_index("output")
    names = [name for name in aha.OUTPUTS if name in table.index]
    table = table.loc[names]
    emulator = emulators.load(emulator_file).select(names)
    y = torch.as_tensor(table["value"].to_numpy(float))
    noise = subject_noise(emulator, table["sd"], noise_prior_scale)
    likelihood = Likelihood(emulator, y[None], noise)
    sampled = sample_cases(
        likelihood, [subject], nuts, point["starts"], point["iterations"], seed, "subjects"
    )
    data = to_inference_data(sampled, likelihood, nuts)
    predictive = predict_observations(
        sampled, likelihood, derive(seed, "predictive", emulator.name, "subjects", subject)
    )
    data.add_groups(
        posterior_predictive=xr.Dataset(
            {"y": (("chain", "draw", "case", "output"), predictive[:, :, None])},
            coords=_coordinates(sampled, likelihood),
        )
    )
    write(data, posterior)
    diagnose(data).to_csv(diagnostics, index=False)


def subject_noise(emulator: Emulator, sd: pd.Series, prior_scale: float) -> Noise:
    """Known noise if the strains have an `sd`, inferred noise if they have none.

    sd: by output, natural units, NaN where not given; `read_measured` allows no mixture.
    """
    values = torch.as_tensor(sd.to_numpy(float))
    if sd[sd.index != "volume_ml"].notna().all():
        return Noise.known(values)
    return Noise.inferred(emulator, prior_scale, values)


def predict_observations(sampled: Sampled, likelihood: Likelihood, seed: int) -> np.ndarray:
    """Posterior predictive (chain, draw, D) of the first case, natural units: emulator error and
    measurement noise included."""
    draws = sampled.draws[0]
    generator = torch.Generator().manual_seed(seed)
    theta = torch.as_tensor(draws.theta).reshape(-1, draws.theta.shape[-1])
    log_sigma = torch.log(torch.as_tensor(draws.sigma)).reshape(len(theta), -1)
    parts = [
        draw_observations(likelihood.emulator, likelihood.noise, t, s, generator)
        for t, s in zip(theta.split(256), log_sigma.split(256), strict=True)
    ]
    return torch.cat(parts).reshape(*draws.theta.shape[:2], -1).numpy()


# ------------------------------------------------------------------------------------- files


def _coordinates(sampled: Sampled, likelihood: Likelihood) -> dict:
    chains, draws = sampled.draws[0].theta.shape[:2]
    return {
        "chain": np.arange(chains),
        "draw": np.arange(draws),
        "case": list(sampled.cases),
        "output": list(likelihood.emulator.outputs),
    }


def to_inference_data(sampled: Sampled, likelihood: Likelihood, nuts: dict) -> az.InferenceData:
    """ArviZ groups posterior, sample_stats, observed_data and constant_data.

    posterior: theta (chain, draw, case, parameter) and, if noise scales were inferred, sigma
    (chain, draw, case, direction) in training sd; attributes emulator, lower, upper, rhat_max,
    ess_min. sample_stats: diverging, acceptance_rate, energy (potential) (chain, draw, case).
    observed_data: y (case, output). constant_data: theta_map, theta_true (if known), y_obs, and
    what the sampling took: seconds (the one number that differs between runs) and repeated.
    """
    base = _coordinates(sampled, likelihood)
    sampling = {key: base[key] for key in ("chain", "draw", "case")}
    parameter, directions = {"parameter": list(aha.PARAMETERS)}, likelihood.noise.directions

    def stack(key: str) -> np.ndarray:
        return np.stack([getattr(draws, key) for draws in sampled.draws], axis=2)

    each = ("chain", "draw", "case")
    emulator = likelihood.emulator
    posterior = xr.Dataset(
        {"theta": ((*each, "parameter"), stack("theta"))},
        coords=sampling | parameter,
        attrs={
            "emulator": emulator.name,
            "lower": emulator.lower,
            "upper": emulator.upper,
            "rhat_max": float(nuts["rhat_max"]),
            "ess_min": float(nuts["ess_min"]),
        },
    )
    if directions:
        posterior = posterior.assign_coords(direction=list(directions))
        posterior["sigma"] = ((*each, "direction"), stack("sigma"))
    stats = xr.Dataset(
        {key: (each, stack(key)) for key in ("diverging", "acceptance_rate", "energy")},
        coords=sampling,
    )
    y = (("case", "output"), sampled.y.numpy())
    outputs = {key: base[key] for key in ("case", "output")}
    constant = xr.Dataset(
        {
            "theta_map": (("case", "parameter"), sampled.theta_map.numpy()),
            "y_obs": y,
            "seconds": ("case", np.array([d.seconds for d in sampled.draws])),
            "repeated": ("case", np.array([d.repeated for d in sampled.draws])),
        },
        coords=outputs | parameter,
    )
    if sampled.truth is not None:
        constant["theta_true"] = (("case", "parameter"), sampled.truth)
    return az.InferenceData(
        posterior=posterior,
        sample_stats=stats,
        observed_data=xr.Dataset({"y": y}, coords=outputs),
        constant_data=constant,
    )


def write(data: az.InferenceData, path: str | Path) -> None:
    """NetCDF, compressed; directories are made."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    data.to_netcdf(str(path), engine="h5netcdf")
