"""What a finer mesh changes: the error of discretisation of the study's mesh, learnt.

An emulator of the study's mesh differs from a heart by more than what is wrong with its model. That
part can be computed: some simulations are made on a finer mesh as well, and the differences, which
are small and smooth, are a process of their own that is added (Kennedy and O'Hagan 2000, doi
10.1093/biomet/87.1.1, with a factor of one between the levels).
"""

import json
import logging
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from regional_lv.channels import Channels
from regional_lv.emulators import least_simulations, load
from regional_lv.emulators.gradient_gp import GradientGP
from regional_lv.emulators.joint_gp import JointGP
from regional_lv.emulators.training import read_sensitivities, read_simulations
from regional_lv.errors import InputError
from regional_lv.inputs.coordinates import Coordinates
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

Simulated = Sequence[np.ndarray]
"""Outputs (n, D) and sensitivities (n, D, P) of n simulations on one mesh."""

CALIBRATION = "variance_trend"
"""Of the differences: too few simulations tell of more than the size of the errors."""


def corrected(
    emulator: JointGP, theta: np.ndarray, coarse: Simulated, finer: Simulated, seed: int
) -> JointGP:
    """The emulator with what a finer mesh changes: of that mesh from then on.

    theta (n, P), and the same simulations on both meshes. Raises InputError for too few of them,
    numbers that are not finite, and what no volume or strain can be.
    """
    here = torch.as_tensor(theta)
    (v, slopes), (finer_v, finer_slopes) = (
        emulator.on_scale(here, *map(torch.as_tensor, simulated)) for simulated in (coarse, finer)
    )
    changes = finer_v - v, finer_slopes - slopes
    names = emulator.parameters, emulator.outputs
    return emulator.with_process(process_of(here, changes, *names, emulator.settings, seed))


def process_of(
    theta: torch.Tensor,
    differences: tuple[torch.Tensor, torch.Tensor],
    parameters: Coordinates,
    outputs: Sequence[str],
    settings: Mapping,
    seed: int,
) -> GradientGP:
    """The process of differences between two simulators, at theta (n, P): values (n, D) on the
    scale of an emulator with these `settings`, and derivatives (n, D, P)."""
    own = {"input_transform": settings["input_transform"], "calibration": CALIBRATION}
    given = (each.numpy() for each in (theta, *differences))
    return GradientGP(**own).fit(*given, parameters=parameters, outputs=outputs, seed=seed)


def train_finer(
    emulator_file: str | Path,
    coarse: Sequence[str | Path],
    finer: Sequence[str | Path],
    parameters: Coordinates,
    channels: Channels,
    seed: int,
    corrected_file: str | Path,
    report: str | Path,
) -> None:
    """Correct the emulator of a file by simulations on both meshes; write it and a report (JSON).

    coarse, finer: tables of simulations with sensitivities on the study's mesh and on the finer
    one; what converged in both counts. parameters: all inputs. seed: the study's.

    report: `simulations`, `seconds`, `fit`, what it says of itself, and by quantity, of log volume
    and log stretch, root mean squares over its channels of the differences' `mean` and `sd` and of
    their `left_out_error` (leave-one-out).

    Raises InputError for an emulator that is none of all inputs, or is corrected already, for
    samples whose inputs differ between the meshes, and for too few of them.
    """
    started, emulator = time.monotonic(), load(emulator_file)
    if not isinstance(emulator, JointGP) or len(emulator.processes) > 1:
        raise InputError(
            f"{emulator_file}: not an emulator over all inputs of the study's mesh alone; give the "
            "one that was trained on it"
        )
    tables = [_converged(paths) for paths in (coarse, finer)]
    samples = tables[0].index.intersection(tables[1].index).sort_values()
    needed = least_simulations(len(parameters), with_sensitivities=True)
    if len(samples) < needed:
        raise InputError(
            f"{finer[0]}: {len(samples)} simulations converged on both meshes, too few to learn "
            f"what the finer one changes; raise all_inputs.finer, to {needed} at least"
        )
    (theta, *of_coarse), (other, *of_finer) = (
        _simulated(table.loc[samples].reset_index(), paths[0], parameters, channels)
        for paths, table in zip((coarse, finer), tables, strict=True)
    )
    differ = ~np.isclose(theta, other, rtol=1e-9, atol=1e-12).all(axis=1)
    if differ.any():
        raise InputError(
            f"{finer[0]}: sample {samples[differ][0]} has other inputs than in {coarse[0]}; "
            "simulate the same design on both meshes"
        )
    found = corrected(emulator, theta, of_coarse, of_finer, derive(seed, "finer mesh"))
    found.save(corrected_file)
    content: dict = {"simulations": len(samples), "seconds": time.monotonic() - started}
    content |= {"fit": found.processes[-1].info, **_sizes(found)}
    Path(report).write_text(json.dumps(content, indent=2) + "\n")
    log.info("finer mesh: differences of %d simulations learnt", len(samples))


def _simulated(rows: pd.DataFrame, path: str | Path, parameters, channels):
    """Theta (n, P), outputs (n, D) and sensitivities (n, D, P) of a table read from `path`."""
    columns = path, parameters, channels.names, rows
    theta, y, _ = read_simulations(*columns)
    return theta, y, read_sensitivities(*columns)


def _sizes(emulator: JointGP) -> dict:
    """Of the differences that a corrected emulator has learnt, by quantity."""
    difference = emulator.processes[-1]
    columns = {
        "mean": difference.output_mean.numpy(),
        "sd": difference.output_sd.numpy(),
        "left_out_error": np.array(difference.info["loo_rmse"]),
    }
    quantities = np.array([channel.quantity for channel in emulator.channels])
    return {
        quantity: {
            name: float(np.sqrt(np.square(values[quantities == quantity]).mean()))
            for name, values in columns.items()
        }
        for quantity in dict.fromkeys(quantities.tolist())
    }


def _converged(paths: Sequence[str | Path]) -> pd.DataFrame:
    """Simulations that converged, by sample. Screened tables have no others."""
    table = pd.concat([pd.read_parquet(path) for path in paths], ignore_index=True)
    if "status" in table:
        table = table[table["status"] == "converged"]
    return table.drop_duplicates("sample").set_index("sample")
