"""From observations to posteriors, and to their files."""

import json
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import xarray as xr

from regional_lv import emulators
from regional_lv.inference.noise import Noise
from regional_lv.inference.posteriors import write
from regional_lv.measured import read_measured
from regional_lv.paper.sampler.by_importance import sample_by_importance
from regional_lv.paper.sampler.diagnostics import diagnose
from regional_lv.paper.sampler.draws import Draws, Settings
from regional_lv.paper.sampler.files import cases_of
from regional_lv.paper.sampler.likelihood import Likelihood
from regional_lv.paper.sampler.nuts import sample_by_nuts
from regional_lv.paper.sampler.point import PointEstimate, find_map
from regional_lv.seeds import derive
from regional_lv.study.progress import Progress

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Sampled:
    """Posteriors of some cases with the same outputs and the same kind of noise.

    likelihoods: one per case, of one observation (D,). theta_map: (C, P). truth: (C, P) or None.
    zones: the stiffened zone of each case of a scenario, or None. samplers: keys of `SAMPLERS`.
    """

    cases: tuple[str, ...]
    likelihoods: Sequence[Likelihood]
    theta_map: torch.Tensor
    draws: tuple[Draws, ...]
    samplers: tuple[str, ...]
    truth: np.ndarray | None = None
    zones: np.ndarray | None = None


@dataclass(frozen=True)
class Sampling:
    """How posteriors are sampled, and where their random numbers come from.

    nuts, point: sections `nuts` and `map` of the config. seed: the study's master seed; every case
    has its own, so that batches may be cut in any way. set_name: of the cases.
    """

    nuts: dict
    point: dict
    seed: int
    set_name: str

    @property
    def settings(self) -> Settings:
        return Settings.from_config(self.nuts)

    def find_maxima(self, likelihoods: Sequence[Likelihood]) -> list[PointEstimate]:
        """The maximum of each case; in one go where all share an emulator, which is several times
        as fast and leaves the last digits to the batch."""
        emulator = likelihoods[0].emulator
        seed = derive(self.seed, "map", emulator.name, self.set_name)
        starts, iterations = self.point["starts"], self.point["iterations"]
        if any(one.emulator is not emulator for one in likelihoods):
            return [find_map(one.at(one.y[None]), starts, iterations, seed) for one in likelihoods]
        every = likelihoods[0].at(torch.stack([one.y for one in likelihoods]))
        return find_map(every, starts, iterations, seed).each()

    def draw(
        self, sampler: str, likelihood: Likelihood, maximum: PointEstimate, case: str
    ) -> Draws:
        """The posterior of one case, by one of `SAMPLERS`."""
        return SAMPLERS[sampler](
            likelihood,
            maximum.theta[0],
            maximum.log_sigma[0],
            self.settings,
            derive(self.seed, sampler, likelihood.emulator.name, self.set_name, case),
        )


SAMPLERS = {"importance": sample_by_importance, "nuts": sample_by_nuts}
"""`test_posteriors.sampler` of the config -> how one posterior is sampled."""


def sample_cases(
    likelihoods: Sequence[Likelihood], cases: Sequence[str], how: Sampling, sampler: str
) -> Sampled:
    """Maximum, then draws of the posterior, of every case.

    sampler: one of `SAMPLERS`. What does not pass the convergence check is sampled by NUTS.
    """
    progress = Progress(f"{likelihoods[0].emulator.name}, {how.set_name}: posteriors", len(cases))
    maxima = how.find_maxima(likelihoods)
    # Errors along the Jacobian are as large as they are at the maximum.
    likelihoods = [one.near(best.theta[0]) for one, best in zip(likelihoods, maxima, strict=True)]
    every, samplers = [], []
    for likelihood, maximum, case in zip(likelihoods, maxima, cases, strict=True):
        used, draws = sampler, how.draw(sampler, likelihood, maximum, case)
        outcome = draws.verdict(how.settings)
        if outcome != "passed" and sampler != "nuts":
            log.warning("case %s/%s %s; sampled by NUTS", how.set_name, case, outcome)
            used, draws = "nuts", how.draw("nuts", likelihood, maximum, case)
            outcome = draws.verdict(how.settings)
        if outcome != "passed":
            log.warning("case %s/%s %s by NUTS", how.set_name, case, outcome)
        every.append(draws)
        samplers.append(used)
        progress.step(failed=outcome != "passed")
    theta = torch.cat([maximum.theta for maximum in maxima])
    return Sampled(tuple(cases), likelihoods, theta, tuple(every), tuple(samplers))


def sample_subject(
    emulator_file: str | Path,
    measured: str | Path,
    subject: str,
    sampler: str,
    nuts: dict,
    point: dict,
    noise_prior_scale: float,
    seed: int,
    posterior: str | Path,
    diagnostics: str | Path,
) -> None:
    """Sample the posterior of a measured file; write it (NetCDF) and its diagnostics (CSV).

    The emulator is reduced to the outputs that were measured. Where they come with a standard
    deviation, that is the noise; where they do not, the volume is known to `VOLUME_SHARE`, and one
    scale for each other quantity is inferred with a half-normal prior of scale `noise_prior_scale`
    (in training sd).

    Raises InputError if the measured file cannot be used.
    """
    likelihood = subject_likelihood(emulator_file, measured, noise_prior_scale)
    how = Sampling(nuts, point, seed, "subjects")
    sampled = sample_cases([likelihood], [subject], how, sampler)
    data = to_datatree(sampled, nuts)
    name = likelihood.emulator.name
    predictive = predict_observations(
        sampled, derive(seed, "predictive", name, "subjects", subject)
    )
    data["posterior_predictive"] = xr.DataTree(
        xr.Dataset(
            {"y": (("chain", "draw", "case", "output"), predictive[:, :, None])},
            coords=_coordinates(sampled),
        )
    )
    write(data, posterior)
    diagnose(cases_of(data)).to_csv(diagnostics, index=False)


def subject_likelihood(
    emulator_file: str | Path, measured: str | Path, noise_prior_scale: float
) -> Likelihood:
    """The likelihood of a measured file: the emulator for its channels, and their noise.

    A file without a volume causes a warning. Raises InputError if it cannot be used, or has
    a channel that the study does not observe.
    """
    emulator = emulators.load(emulator_file)
    table = read_measured(measured, emulator.channels, strain_exponent=None).set_index("output")
    names = [name for name in emulator.outputs if name in table.index]
    table, emulator = table.loc[names], emulator.select(names)
    y = torch.as_tensor(table["value"].to_numpy(float))
    emulator = emulator.localise(y)
    sd = table["sd"].to_numpy(float)
    return Likelihood(emulator, y, Noise.of_subject(emulator, y.numpy(), sd, noise_prior_scale))


def predict_observations(sampled: Sampled, seed: int) -> np.ndarray:
    """Posterior predictive (chain, draw, D) of the first case, natural units: emulator error and
    measurement noise included."""
    draws, likelihood = sampled.draws[0], sampled.likelihoods[0]
    generator = torch.Generator().manual_seed(seed)
    theta = torch.as_tensor(draws.theta).reshape(-1, draws.theta.shape[-1])
    log_sigma = torch.log(torch.as_tensor(draws.sigma)).reshape(len(theta), -1)
    parts = [
        likelihood.draw(t, s, generator)
        for t, s in zip(theta.split(256), log_sigma.split(256), strict=True)
    ]
    return torch.cat(parts).reshape(*draws.theta.shape[:2], -1).numpy()


# ------------------------------------------------------------------------------------- files


def _coordinates(sampled: Sampled) -> dict:
    chains, draws = sampled.draws[0].theta.shape[:2]
    return {
        "chain": np.arange(chains),
        "draw": np.arange(draws),
        "case": list(sampled.cases),
        "output": list(sampled.likelihoods[0].emulator.outputs),
    }


def to_datatree(sampled: Sampled, nuts: dict) -> xr.DataTree:
    """Groups as ArviZ names them: posterior, sample_stats, observed_data and constant_data.

    posterior: theta (chain, draw, case, parameter) and, if noise scales were inferred, sigma
    (chain, draw, case, direction) in training sd, a direction being a quantity; attributes
    emulator, parameters (JSON, `StiffnessInputs.spec`), rhat_max, ess_min. sample_stats:
    diverging, acceptance_rate, energy (potential), outside (no simulation of the training set is
    near; `Emulator.outside`) (chain, draw, case).
    observed_data: y (case, output). constant_data: theta_map, theta_true (if known), y_obs, zone
    (the stiffened one, of a scenario), sampler, pareto_k, weighted_ess, and seconds, the one number
    that differs between runs.
    """
    base, likelihood = _coordinates(sampled), sampled.likelihoods[0]
    sampling = {key: base[key] for key in ("chain", "draw", "case")}
    emulator, directions = likelihood.emulator, list(likelihood.noise.groups)
    parameter = {"parameter": list(emulator.parameters.names)}

    def stack(key: str) -> np.ndarray:
        return np.stack([getattr(draws, key) for draws in sampled.draws], axis=2)

    each = ("chain", "draw", "case")
    posterior = xr.Dataset(
        {"theta": ((*each, "parameter"), stack("theta"))},
        coords=sampling | parameter,
        attrs={
            "emulator": emulator.name,
            "parameters": json.dumps(emulator.parameters.spec()),
            "rhat_max": float(nuts["rhat_max"]),
            "ess_min": float(nuts["ess_min"]),
        },
    )
    if directions:
        posterior = posterior.assign_coords(direction=directions)
        posterior["sigma"] = ((*each, "direction"), stack("sigma"))
    stats = xr.Dataset(
        {key: (each, stack(key)) for key in ("diverging", "acceptance_rate", "energy")},
        coords=sampling,
    )
    outside = [
        one.emulator.outside(torch.as_tensor(draws.theta)).numpy()
        for one, draws in zip(sampled.likelihoods, sampled.draws, strict=True)
    ]
    stats["outside"] = (each, np.stack(outside, axis=2))
    y = (("case", "output"), torch.stack([one.y for one in sampled.likelihoods]).numpy())
    outputs = {key: base[key] for key in ("case", "output")}
    constant = xr.Dataset(
        {
            "theta_map": (("case", "parameter"), sampled.theta_map.numpy()),
            "y_obs": y,
            "seconds": ("case", np.array([d.seconds for d in sampled.draws])),
            "pareto_k": ("case", np.array([d.pareto_k for d in sampled.draws])),
            "weighted_ess": ("case", np.array([d.weighted_ess for d in sampled.draws])),
            "sampler": ("case", list(sampled.samplers)),
        },
        coords=outputs | parameter,
    )
    if sampled.truth is not None:
        constant["theta_true"] = (("case", "parameter"), sampled.truth)
    if sampled.zones is not None:
        constant["zone"] = ("case", list(sampled.zones))
    groups = {
        "posterior": posterior,
        "sample_stats": stats,
        "observed_data": xr.Dataset({"y": y}, coords=outputs),
        "constant_data": constant,
    }
    return xr.DataTree.from_dict(groups)
