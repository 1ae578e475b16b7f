"""How far the observables are from those of a finer mesh, across the box of parameters."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.channels import Channels
from regional_lv.mechanics.continuation import Effort, GrowingRunner, Solver
from regional_lv.simulation.batches import known_from, make_simulator
from regional_lv.simulation.sobol import further_points
from regional_lv.study.progress import Progress

NATURAL, LOG = 15, 6  # points, in about the proportion of the study


def observe_mesh(
    mesh_file: str | Path, physics: dict, seed: int, mesh: str, observables: str | Path
) -> None:
    """Write the observables of the mesh called `mesh` at points of the box and, last, at theta = 1.

    Columns (Parquet): unknowns, mean_dilation, newton_steps, the parameters, the channels; the
    channels are NaN where a run failed.
    """
    simulator = make_simulator(mesh_file, physics)
    solver, parameters = Solver(simulator, physics["solver"]), simulator.parameters
    guesses = known_from(solver.inflate_all(parameters.middle, Effort()), simulator)
    points = further_points(parameters, seed, "mesh study", NATURAL, LOG)
    thetas = np.vstack([points, np.ones(len(parameters))])
    progress = Progress(f"mesh {mesh}", len(thetas))
    rows: list[list[float]] = [[] for _ in thetas]
    for row, result in GrowingRunner(solver, guesses).run_all(thetas):
        dilation = np.nan if result.state is None else simulator.dilation(result.state.w)
        rows[row] = [simulator.size, dilation, result.newton_steps, *result.theta]
        rows[row] += result.observables.tolist()
        progress.step(failed=result.state is None)
    columns = ["unknowns", "mean_dilation", "newton_steps", *parameters.names]
    table = pd.DataFrame(rows, columns=[*columns, *simulator.channels.names])
    table.to_parquet(observables, index=False)


def compare_meshes(
    tables: Sequence[str | Path],
    meshes: Sequence[str],
    channels: Channels,
    errors: str | Path,
    summary: str | Path,
) -> None:
    """Write the errors (CSV) of meshes against the last of them, and their summary (CSV).

    tables: as `observe_mesh` writes them, of `meshes`.
    """
    observed = dict(zip(meshes, map(pd.read_parquet, tables), strict=True))
    found = compare(observed, meshes[-1], channels)
    found.to_csv(errors, index=False)
    summarise(found).to_csv(summary, index=False)


def compare(meshes: dict[str, pd.DataFrame], reference: str, channels: Channels) -> pd.DataFrame:
    """Errors of each mesh against the mesh `reference`, one row per mesh and point.

    Columns: mesh, unknowns, point (0, 1, ..., the last is theta = 1), volume_percent (at end
    diastole), max_strain (the largest error of the strains) with its `channel`, mean_dilation.
    What is not observed is NaN, its channel empty.
    """
    volume = [c.name for c in channels if c.quantity == "volume" and c.load_fraction == 1]
    strains = [c.name for c in channels if c.kind.is_strain]
    exact, parts = meshes[reference], []
    for name, table in meshes.items():
        error = (table[strains] - exact[strains]).abs()
        percent = 100 * (table[volume] - exact[volume]).abs() / exact[volume]
        parts.append(
            pd.DataFrame(
                {
                    "mesh": name,
                    "unknowns": table["unknowns"],
                    "point": np.arange(len(table)),
                    "volume_percent": percent.max(axis=1),
                    "max_strain": error.max(axis=1),
                    "channel": error.fillna(-1.0).idxmax(axis=1) if strains else "",
                    "mean_dilation": table["mean_dilation"],
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


def summarise(errors: pd.DataFrame) -> pd.DataFrame:
    """Per mesh: unknowns, points solved, median and worst error over the points, dilation."""
    solved = errors.dropna(subset=["mean_dilation"])
    groups = solved.groupby("mesh", sort=False)
    return groups.agg(
        unknowns=("unknowns", "first"),
        points=("point", "count"),
        volume_percent_worst=("volume_percent", "max"),
        max_strain_median=("max_strain", "median"),
        max_strain_worst=("max_strain", "max"),
        mean_dilation_median=("mean_dilation", "median"),
    ).reset_index()
