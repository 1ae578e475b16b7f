"""Posteriors of sets of simulated cases, whose truth is known."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import torch

from regional_lv import emulators
from regional_lv.channels import Channels
from regional_lv.emulators.base import Emulator
from regional_lv.emulators.training import read_simulations
from regional_lv.errors import InputError
from regional_lv.inference.noise import Noise
from regional_lv.inference.posteriors import write
from regional_lv.paper.emulators.dnn import DNN
from regional_lv.paper.sampler.likelihood import Likelihood
from regional_lv.paper.sampler.sampling import Sampling, sample_cases, to_datatree
from regional_lv.seeds import derive


def sample_set_batch(
    emulator_file: str | Path,
    simulations: str | Path,
    set_name: str,
    batch: int | str,
    batches: int,
    cases: int,
    noise: dict | None,
    sampler: str,
    nuts: dict,
    point: dict,
    seed: int,
    posteriors: str | Path,
) -> None:
    """Sample one of `batches` equal parts of the first `cases` rows of a screened table; write it
    (NetCDF).

    batch: its number, from 0; digits will do. noise: section `scenarios.noise`, to be added to the
    simulated outputs and known to the likelihood; None: the emulator's error is all there is.
    point: section `map` of the config. Raises InputError if there are fewer rows than batches.
    """
    emulator = emulators.load(emulator_file)
    theta, y, samples = read_simulations(simulations, emulator.parameters, emulator.outputs)
    count, number = min(cases, len(samples)), int(batch)
    chosen = slice(number * count // batches, (number + 1) * count // batches)
    if chosen.start == chosen.stop:
        raise InputError(
            f"{simulations}: {count} simulations converged, too few for {batches} batches of "
            "posteriors; simulate more, or raise nuts.cases_per_batch"
        )
    if noise is not None:
        y, sd = add_noise(y, emulator.channels, samples, noise, seed, set_name)
        measured = ~np.isnan(sd)
        emulator, y = emulator.select(list(np.array(emulator.outputs)[measured])), y[:, measured]
    likelihoods = likelihoods_of_set(emulator, torch.as_tensor(y[chosen]), noise)
    how = Sampling(nuts, point, seed, set_name)
    sampled = sample_cases(likelihoods, samples[chosen], how, sampler)
    zones = read_zones(simulations)
    sampled = replace(sampled, truth=theta[chosen], zones=None if zones is None else zones[chosen])
    write(to_datatree(sampled, nuts), posteriors)


def likelihoods_of_set(emulator: Emulator, y: torch.Tensor, noise: dict | None) -> list[Likelihood]:
    """One for each row of `y` (C, D), the measured outputs.

    noise: sd by quantity (`scenarios.noise`); None: the emulator's error is all there is.
    """
    if noise is None:
        emulator, kind = error_model(emulator)
        return make_likelihoods(emulator, y, kind)
    return make_likelihoods(emulator, y, Noise.known(noise_sd(emulator.channels, noise)))


def make_likelihoods(emulator: Emulator, y: torch.Tensor, noise: Noise) -> list[Likelihood]:
    """One likelihood for each row of `y` (C, D); a local emulator trains for each."""
    local = [emulator.localise(row) for row in y]
    if all(one is emulator for one in local):
        common = Likelihood(emulator, y[0], noise)
        return [common.at(row) for row in y]
    return [Likelihood(one, row, noise) for one, row in zip(local, y, strict=True)]


def noise_sd(channels: Channels, noise: dict) -> torch.Tensor:
    """(D,), NaN for what is not measured: quantities that `noise` has no sd for."""
    sd = np.array([noise.get(channel.quantity) for channel in channels], dtype=float)
    return torch.as_tensor(sd)


def read_zones(simulations: str | Path) -> np.ndarray | None:
    """The stiffened zone of each row of a scenario's table; None for other tables."""
    if "zone" not in pq.read_schema(simulations).names:
        return None
    return pd.read_parquet(simulations, columns=["zone"])["zone"].to_numpy()


def error_model(emulator: Emulator) -> tuple[Emulator, Noise]:
    """Emulator and noise for simulated data, where the emulator's error is all there is.

    A network with a setting `error_prior_scale` loses its own error and gets one of an unknown
    scale, the same for all outputs in standardised units.
    """
    if isinstance(emulator, DNN) and (scale := emulator.settings["error_prior_scale"]) is not None:
        return emulator.without_error(), Noise.shared(emulator, scale)
    return emulator, Noise.none(emulator)


def add_noise(
    y: np.ndarray,
    channels: Channels,
    samples: Sequence[str],
    noise: dict,
    seed: int,
    set_name: str,
) -> tuple[np.ndarray, np.ndarray]:
    """Outputs (N, D) with Gaussian noise, and its sd (D,), as in `noise_sd`.

    noise: sd by quantity. A quantity that has none, or null, is not measured and keeps its values.
    Each sample has its own random numbers.
    """
    sd = noise_sd(channels, noise).numpy()
    deviates = np.stack(
        [
            np.random.default_rng(derive(seed, "noise", set_name, sample)).normal(size=len(sd))
            for sample in samples
        ]
    )
    return y + np.nan_to_num(sd) * deviates, sd
