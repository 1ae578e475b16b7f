"""How far the 52 observables are from those of a finer mesh, across the box of parameters."""

from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.design import further_points
from regional_lv.mechanics.continuation import Effort, GrowingRunner, Solver
from regional_lv.mechanics.predictor import Known
from regional_lv.progress import Progress
from regional_lv.simulations import make_simulator

NATURAL, LOG = 15, 6  # points, in about the proportion of the study


def observe(mesh: Path, physics: dict, design: dict, seed: int, name: str) -> pd.DataFrame:
    """Observables of one mesh at points of the box and, last, at theta = 1.

    Columns: unknowns, mean_dilation, newton_steps, the parameters, `aha.OUTPUTS`; outputs are NaN
    where a run failed.
    """
    simulator = make_simulator(mesh, physics)
    solver, pressure = Solver(simulator, physics["solver"]), physics["loading"]["pressure_mmhg"]
    centre = np.full(len(aha.PARAMETERS), np.sqrt(design["lower"] * design["upper"]))
    state, known = solver.inflate(centre, pressure, Effort()), Known(simulator.size)
    known.add(centre, state.w, simulator.field_sensitivities(state.w))
    points = further_points(design, seed, "mesh study", NATURAL, LOG)
    thetas = np.vstack([points, np.ones(len(centre))])
    progress = Progress(f"mesh {name}", len(thetas))
    rows = [None] * len(thetas)
    for row, result in GrowingRunner(solver, known, pressure).run_all(thetas):
        dilation = np.nan if result.state is None else simulator.dilation(result.state.w)
        rows[row] = [simulator.size, dilation, result.newton_steps, *result.theta]
        rows[row] += result.observables.tolist()
        progress.step(failed=result.state is None)
    columns = ["unknowns", "mean_dilation", "newton_steps", *aha.PARAMETERS, *aha.OUTPUTS]
    return pd.DataFrame(rows, columns=columns)


def compare(meshes: dict[str, pd.DataFrame], reference: str) -> pd.DataFrame:
    """Errors of each mesh against the mesh `reference`, one row per mesh and point.

    Columns: mesh, unknowns, point (0, 1, ..., the last is theta = 1), volume_percent,
    max_strain (the largest error of the 51 strains) with its `channel`, mean_dilation.
    """
    exact = meshes[reference][list(aha.OUTPUTS)].to_numpy()
    parts = []
    for name, table in meshes.items():
        error = np.abs(table[list(aha.OUTPUTS)].to_numpy() - exact)
        strains = np.nan_to_num(error[:, 1:], nan=-1.0)
        parts.append(
            pd.DataFrame(
                {
                    "mesh": name,
                    "unknowns": table["unknowns"],
                    "point": np.arange(len(table)),
                    "volume_percent": 100 * error[:, 0] / exact[:, 0],
                    "max_strain": error[:, 1:].max(axis=1),
                    "channel": np.array(aha.OUTPUTS[1:])[strains.argmax(axis=1)],
                    "mean_dilation": table["mean_dilation"],
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


def summary(errors: pd.DataFrame) -> pd.DataFrame:
    """Per mesh: unknowns, points solved, median and worst error over the points, dilation."""
    solved = errors.dropna(subset=["max_strain"])
    groups = solved.groupby("mesh", sort=False)
    return groups.agg(
        unknowns=("unknowns", "first"),
        points=("point", "count"),
        volume_percent_worst=("volume_percent", "max"),
        max_strain_median=("max_strain", "median"),
        max_strain_worst=("max_strain", "max"),
        mean_dilation_median=("mean_dilation", "median"),
    ).reset_index()
