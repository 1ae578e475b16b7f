"""What the workflow does with emulators: train one, and predict a table of simulations."""

import json
import logging
import resource
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import torch

from regional_lv.channels import Channels
from regional_lv.emulators import create, load
from regional_lv.emulators.base import Emulator
from regional_lv.emulators.gaussian import Z95
from regional_lv.errors import InputError
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.seeds import derive
from regional_lv.typed_tables import require_columns

log = logging.getLogger(__name__)

FEW = 6
"""Simulations for each parameter, below which emulators without sensitivities have intervals that
are too narrow: of exact_gp with ten parameters they cover 88 % with 40 and 40 % with 12."""


def read_simulations(
    path: str | Path,
    parameters: StiffnessInputs,
    outputs: Sequence[str],
    table: pd.DataFrame | None = None,
) -> tuple[np.ndarray, np.ndarray, pd.Index]:
    """Theta (N, P), outputs (N, D) and sample names of a screened table of simulations.

    table: what was read from `path` before. Raises InputError if a column is missing.
    """
    table = pd.read_parquet(path) if table is None else table
    names = ["sample", *parameters.names, *outputs]
    require_columns(path, table, names, "give a screened table of simulations")
    theta, y = (table[list(names)].to_numpy(float) for names in (parameters.names, outputs))
    return theta, y, pd.Index(table["sample"].astype(str))


def read_sensitivities(
    path: str | Path,
    parameters: StiffnessInputs,
    outputs: Sequence[str],
    table: pd.DataFrame | None = None,
) -> np.ndarray:
    """d(outputs)/d(theta) (N, D, P) of a screened table of simulations, in its order.

    outputs: all those of the table, at all loads. table: as of `read_simulations`. Raises
    InputError if there are none, or if a row has another number of them.
    """
    if table is None:
        there = {"sensitivity"}.intersection(pq.read_schema(path).names)
        table = pd.read_parquet(path, columns=[*there])
    remedy = "simulate with dolfinx, or choose an emulator that learns from values alone"
    require_columns(path, table, ["sensitivity"], remedy)
    shape, rows = (len(outputs), len(parameters)), table["sensitivity"]
    for i, row in enumerate(rows):
        if np.size(row) != shape[0] * shape[1]:
            raise InputError(
                f"{path}: row {i} has {np.size(row)} sensitivities; expected {shape[0]} x "
                f"{shape[1]}, row by row; simulate it again or remove it"
            )
    return np.stack([np.asarray(row, dtype=float).reshape(shape) for row in rows])


def train_emulator(
    name: str,
    settings: dict,
    train: str | Path,
    parameters: StiffnessInputs,
    channels: Channels,
    seed: int,
    emulator_file: str | Path,
    report: str | Path,
) -> None:
    """Fit one emulator to a screened table; write it and its report (JSON).

    seed: the study's master seed. Raises InputError for an unknown name or an unusable table.
    """
    columns = parameters, channels.names
    theta, y, _ = read_simulations(train, *columns)
    started = time.monotonic()
    emulator = create(name, settings)
    slopes = read_sensitivities(train, *columns) if emulator.learns_from_sensitivities else None
    few = FEW * len(parameters)
    if slopes is None and len(theta) < few:
        log.warning(
            "%s: %d simulations for %d parameters: its intervals are too narrow; simulate %d",
            name,
            len(theta),
            len(parameters),
            few,
        )
    emulator.fit(
        theta,
        y,
        slopes,
        parameters=parameters,
        outputs=channels.names,
        seed=derive(seed, "emulators", name),
    )
    seconds = time.monotonic() - started
    emulator.save(emulator_file)
    content = {
        "emulator": name,
        "settings": emulator.settings,
        "rows": len(theta),
        "seconds": seconds,
        # Of the whole process: kibibytes on Linux.
        "peak_memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    Path(report).write_text(json.dumps(content | emulator.info, indent=2) + "\n")


@torch.no_grad()
def predict_each(
    emulator: Emulator, theta: torch.Tensor, y: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Means and sds (N, D) at theta (N, P), each row by the emulator localised to that row's y
    (N, D)."""
    # One by one: a local emulator differs from case to case, and covariances of all take room.
    found = [emulator.localise(observed).predict(at) for at, observed in zip(theta, y, strict=True)]
    return torch.stack([each.mean for each in found]), torch.stack([each.sd for each in found])


def predict_test_set(
    emulator_file: str | Path, test: str | Path, predictions: str | Path, errors: str | Path
) -> None:
    """Predict a screened table; write predictions (Parquet) and errors per output (CSV).

    Local emulators are trained for each case, on the neighbours of its outputs. Predictions: case,
    output, truth, mean, sd (natural units). Errors: output, rmse, rmse_standardised (over the
    training sd), max_abs_error, coverage95, and a row `all` with the standardised numbers (root
    mean square, largest) over all outputs.
    """
    emulator = load(emulator_file)
    theta, y, samples = read_simulations(test, emulator.parameters, emulator.outputs)
    truth = torch.as_tensor(y)
    mean, sd = predict_each(emulator, torch.as_tensor(theta), truth)
    far = int(emulator.outside(torch.as_tensor(theta)).sum())
    if far:
        log.info("%s: %d of %d simulations lie outside the design", emulator.name, far, len(truth))
    long = pd.DataFrame(
        {
            "case": np.repeat(samples.to_numpy(), len(emulator.outputs)),
            "output": np.tile(emulator.outputs, len(samples)),
            "truth": truth.ravel().numpy(),
            "mean": mean.ravel().numpy(),
            "sd": sd.ravel().numpy(),
        }
    )
    long.to_parquet(predictions, index=False)
    error = mean - truth
    scaled = error / emulator.output_sd
    covered = (error.abs() <= Z95 * sd).double()
    table = pd.DataFrame(
        {
            "output": emulator.outputs,
            "rmse": error.square().mean(0).sqrt().numpy(),
            "rmse_standardised": scaled.square().mean(0).sqrt().numpy(),
            "max_abs_error": error.abs().amax(0).numpy(),
            "coverage95": covered.mean(0).numpy(),
        }
    )
    total = {
        "output": "all",
        "rmse": np.nan,
        "rmse_standardised": float(scaled.square().mean().sqrt()),
        "max_abs_error": np.nan,
        "coverage95": float(covered.mean()),
    }
    pd.concat([table, pd.DataFrame([total])], ignore_index=True).to_csv(errors, index=False)
    log.info(
        "%s: standardised root-mean-square error %.4f on %d simulations",
        emulator.name,
        total["rmse_standardised"],
        len(samples),
    )
