"""Point estimates of the test set by one emulator, and what using that emulator costs."""

import json
import logging
import statistics
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd
import torch

from regional_lv import emulators
from regional_lv.emulators.base import Emulator
from regional_lv.emulators.training import read_simulations
from regional_lv.inference.noise import Noise
from regional_lv.paper.estimates import ESTIMATORS
from regional_lv.paper.estimates.least_squares import find_least_squares
from regional_lv.paper.sampler.likelihood import Likelihood
from regional_lv.paper.sampler.point import find_map
from regional_lv.seeds import derive
from regional_lv.study.progress import Progress

log = logging.getLogger(__name__)

Result = TypeVar("Result")

TIMING_REPEATS = 20
TIMING_BATCH = 100


def true_column(parameter: str) -> str:
    """Column of the true value beside the estimate's, which is named like the parameter."""
    return f"true_{parameter}"


def estimate_parameters(
    emulator_file: str | Path,
    test: str | Path,
    point: dict,
    adam_steps: int,
    hops: int,
    seed: int,
    estimates: str | Path,
) -> None:
    """Estimate theta of every simulation of a screened test table; write a table (Parquet).

    Two rows per simulation: estimator `least_squares` (on the predictive mean, outputs in training
    sd) and `weighted` (by the predictive covariance, its determinant included: the MAP under the
    uniform prior). Columns: sample, estimator, the P estimates (named like the parameters), their
    true values (`true_...`), mse (over the parameters), objective (sum of squares in training sd,
    or minus the log density), outside (the estimate lies where no training simulation is near),
    seconds (training for the case included, where an emulator is local). point: section `map` of
    the config.
    """
    emulator = emulators.load(emulator_file)
    parameters = list(emulator.parameters.names)
    theta, y, samples = read_simulations(test, emulator.parameters, emulator.outputs)
    name, done, tables = emulator.name, 0, []
    progress = Progress(f"{name}: point estimates", len(samples))
    started = time.monotonic()
    for local, observed in localised(emulator, torch.as_tensor(y)):
        rows = slice(done, done + len(observed))
        training = time.monotonic() - started
        found = {}
        found["least_squares"] = find_least_squares(
            local,
            observed,
            **point,
            adam_steps=adam_steps,
            hops=hops,
            seed=derive(seed, "least squares", name),
        )
        halfway = time.monotonic()
        likelihood = Likelihood(local, observed, Noise.none(local))
        maximum = find_map(likelihood, **point, seed=derive(seed, "map", name, "test"))
        found["weighted"] = maximum.theta, -maximum.log_density
        ended = time.monotonic()
        seconds = {"least_squares": halfway - started, "weighted": ended - halfway + training}
        for estimator in ESTIMATORS:
            estimate, objective = found[estimator]
            table = pd.DataFrame({"sample": samples[rows], "estimator": estimator})
            table[parameters] = estimate.numpy()
            table[[true_column(p) for p in parameters]] = theta[rows]
            table["mse"] = np.square(estimate.numpy() - theta[rows]).mean(axis=1)
            table["objective"] = objective.numpy()
            table["outside"] = emulator.outside(estimate).numpy()
            table["seconds"] = seconds[estimator] / len(table)
            tables.append(table)
        done = rows.stop
        progress.step(count=len(observed))
        started = time.monotonic()
    table = pd.concat(tables, ignore_index=True)
    table.to_parquet(estimates, index=False)
    for estimator, part in table.groupby("estimator"):
        log.info(
            "%s, %s: parameter MSE %.5f over %d cases, %d estimates outside the design",
            name,
            estimator,
            part["mse"].mean(),
            len(part),
            part["outside"].sum(),
        )


def localised(emulator: Emulator, y: torch.Tensor) -> Iterator[tuple[Emulator, torch.Tensor]]:
    """Emulators with the rows of `y` (C, D) that each is for, in order: one for all, or one for
    each where an emulator trains anew for every observation."""
    first = emulator.localise(y[0])
    if first is emulator:
        yield emulator, y
        return
    yield first, y[:1]
    for i in range(1, len(y)):
        yield emulator.localise(y[i]), y[i : i + 1]


def measure_cost(emulator_file: str | Path, test: str | Path, cost: str | Path) -> None:
    """Time an emulator on simulations of a screened table; write the medians (JSON).

    ms_localise: training for one observation (about 0 for global emulators); ms_prediction: mean
    and standard deviations at one theta; ms_gradient: log density and its gradient at one theta,
    as a sampler asks for it; ms_gradient_batched: the same per theta of a hundred at once;
    file_mb: size of the emulator's file.
    """
    emulator = emulators.load(emulator_file)
    theta, y, _ = read_simulations(test, emulator.parameters, emulator.outputs)
    at, observed = torch.as_tensor(theta[:1]), torch.as_tensor(y[0])
    localise, local = _milliseconds(lambda: emulator.localise(observed), repeats=3)
    likelihood = Likelihood(local, observed, Noise.none(local))
    result = {
        "ms_localise": localise,
        "ms_prediction": _milliseconds(lambda: _spread(local, at))[0],
        "ms_gradient": _milliseconds(lambda: _gradient(likelihood, at))[0],
        "ms_gradient_batched": _milliseconds(
            lambda: _gradient(likelihood, at.repeat(TIMING_BATCH, 1)), repeats=3
        )[0]
        / TIMING_BATCH,
        "file_mb": Path(emulator_file).stat().st_size / 2**20,
    }
    Path(cost).write_text(json.dumps(result, indent=2) + "\n")


def _spread(emulator: Emulator, theta: torch.Tensor) -> torch.Tensor:
    with torch.no_grad():
        return emulator.predict(theta).sd


def _gradient(likelihood: Likelihood, theta: torch.Tensor) -> torch.Tensor:
    theta = theta.clone().requires_grad_(True)
    return torch.autograd.grad(likelihood.log_density(theta).sum(), theta)[0]


def _milliseconds(
    function: Callable[[], Result], repeats: int = TIMING_REPEATS
) -> tuple[float, Result]:
    """Median time of a call (after a first one that does not count), and what it returned."""
    result, times = function(), []
    for _ in range(repeats):
        started = time.perf_counter()
        function()
        times.append(1e3 * (time.perf_counter() - started))
    return statistics.median(times), result
