"""Simulations of the leading models: more data where it matters, and a test of stated errors.

The leading models are simulated at draws of their posterior. What is simulated is compared with
what the emulator said, and joins what it learns from; where it differs by more than the emulator
stated, the posterior is made again and simulated again.
"""

import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol, Self, TypeVar

import numpy as np
import pandas as pd
import torch

from regional_lv.inference import importance
from regional_lv.inference.averaging import Averaged
from regional_lv.inference.emulated import InputEmulator
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

LARGEST_ERROR = 1.5
"""Root mean square of simulated minus emulated, in stated sds, up to which the stated error holds:
the errors of one round go together, so that they are large or small by chance."""

NEGLIGIBLE = 0.25
"""The same in sds of the noise, up to which it does not matter."""

FEWEST = 2
"""Simulations of a set, with which it counts as confirmed."""


@dataclass(frozen=True)
class Settings:
    """Of the confirmation of a subject: models that are simulated in a round, at most; simulations
    of a round, shared out by the models' probabilities; rounds, at most."""

    sets: int
    simulations: int
    rounds: int


def plan(averaged: Averaged, settings: Settings, seed: int) -> pd.DataFrame:
    """What to simulate: the `set` (name of the model) and the simulated inputs, by name."""
    probability, leading = averaged.probability, averaged.leading[: settings.sets]
    total, parts = sum(probability[n] for n in leading), []
    points, hearts = averaged.potential.emulated, averaged.potential.observed.count
    for n in leading:
        share = probability[n] / total
        count = max(FEWEST, round(settings.simulations * share))
        generator = torch.Generator().manual_seed(derive(seed, "confirmation", averaged.names[n]))
        drawn = averaged.drawn[n]
        x = drawn.x[importance.resample(drawn.weight, count, generator)]
        values = points.simulated_at(x[:, : len(averaged.potential.inputs)])
        # Of several hearts, as many simulations as there are hearts.
        chosen = torch.randperm(len(values), generator=generator)[: max(count, hearts)]
        table = pd.DataFrame(values[chosen].numpy(), columns=list(points.simulated_names))
        table.insert(0, "set", averaged.names[n])
        parts.append(table)
    table = pd.concat(parts, ignore_index=True)
    table.insert(0, "sample", np.arange(len(table)))
    return table


@dataclass(frozen=True)
class Round:
    """What one round of simulations says.

    simulations: its rows that converged. failed: how many did not. errors, in_sds (n, D): simulated
    minus emulated, in units of the outputs and in the sds that the emulator stated before it knew
    of them.
    """

    simulations: pd.DataFrame
    failed: int
    errors: np.ndarray
    in_sds: np.ndarray

    @property
    def size(self) -> float:
        """Root mean square of all errors in stated sds."""
        return float(np.sqrt(np.square(self.in_sds).mean())) if self.in_sds.size else np.nan

    def agrees(self, noise_sd: np.ndarray) -> bool:
        """Whether errors are as small as stated, or do not matter beside the noise (D,)."""
        if not self.in_sds.size:
            return False
        beside = np.sqrt(np.square(self.errors / noise_sd).mean())
        return self.size <= LARGEST_ERROR or float(beside) <= NEGLIGIBLE


class Conditionable(InputEmulator, Protocol):
    """An emulator that further simulations join (`JointGP`)."""

    @property
    def of_study_mesh(self) -> Self: ...
    def errors_of(self, theta: torch.Tensor, y: torch.Tensor) -> torch.Tensor: ...
    def condition(
        self, theta: torch.Tensor, y: torch.Tensor, sensitivities: torch.Tensor
    ) -> Self: ...


EmulatorT = TypeVar("EmulatorT", bound=Conditionable)


def values_of(
    emulator: InputEmulator, simulations: pd.DataFrame
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Inputs theta (n, P), outputs y (n, D) and their derivatives (n, D, P), as the emulator has
    them, of simulations (`simulation.batches.tabulate`)."""
    theta, y = (
        torch.as_tensor(simulations[list(columns)].to_numpy(float))
        for columns in (emulator.coordinates.names, emulator.outputs)
    )
    slopes = np.stack([np.asarray(row, dtype=float) for row in simulations["sensitivity"]])
    return theta, y, torch.as_tensor(slopes).reshape(*y.shape, theta.shape[1])


def conditioned(
    emulator: EmulatorT, rounds: Sequence[pd.DataFrame], outputs: Sequence[str]
) -> tuple[EmulatorT, list[Round]]:
    """The emulator that knows the simulations of all rounds, and what each round says of the
    emulator that knew those before it, about the measured `outputs`, on the study's mesh."""
    found, names = [], list(emulator.coordinates.names)
    for table in rounds:
        good = table[table["status"] == "converged"]
        if good.empty:
            nothing = np.empty((0, len(outputs)))
            found.append(Round(good, len(table), nothing, nothing))
            continue
        theta, y = (
            torch.as_tensor(good[list(columns)].to_numpy(float)) for columns in (names, outputs)
        )
        own = emulator.of_study_mesh.select(outputs)
        errors = (y - own.predict_mean(theta)).numpy()
        found.append(Round(good, len(table) - len(good), errors, own.errors_of(theta, y).numpy()))
        emulator = emulator.condition(*values_of(emulator, good))
        log.info(
            "round %d: %d simulations; simulated minus emulated, in stated sds: %.2f",
            len(found),
            len(good),
            found[-1].size,
        )
    return emulator, found


class Simulate:
    """Simulates rows of a `plan`, and counts the CPU `seconds` that it takes.

    Parameters
    ----------
    mesh, physics, predictor: as for `batches.make_runner`; read when they are needed.
    """

    def __init__(self, mesh: str | Path, physics: Mapping, predictor: str | Path):
        self._given = mesh, physics, predictor
        self.seconds = 0.0

    def __call__(self, rows: pd.DataFrame) -> pd.DataFrame:
        """A table as of `batches.tabulate`."""
        from regional_lv.simulation.batches import run_all, tabulate  # DOLFINx loads for seconds

        started = time.process_time()
        thetas = rows[list(self._runner.coordinates.names)].to_numpy()
        made = tabulate(rows, run_all(self._runner, thetas, "confirmation"), self._runner.channels)
        self.seconds += time.process_time() - started
        return made

    @cached_property
    def _runner(self):
        from regional_lv.simulation.batches import make_runner

        return make_runner(*self._given)
