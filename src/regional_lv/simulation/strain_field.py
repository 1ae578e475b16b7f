"""The strains of one solution at every integration point, not only their segment means."""

from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.geometry.mesh import write_mesh
from regional_lv.mechanics.observables.motion import DIRECTIONS
from regional_lv.mechanics.observables.observer import Observer
from regional_lv.simulation.batches import make_runner


def map_strains(
    mesh: str | Path, predictor: str | Path, physics: dict, table: str | Path, vtu: str | Path
) -> None:
    """Simulate theta = 1 and write its strains.

    table: Parquet of `strain_field`. vtu: the mesh (unloaded, as thick as simulated) with
    `displacement` (mm) and each cell's mean strains, for ParaView. Raises RuntimeError if the
    simulation fails.
    """
    runner = make_runner(mesh, physics, predictor, sensitivities=False)
    result = runner.run(np.ones(len(runner.parameters)))
    if result.state is None:
        raise RuntimeError(f"the simulation at theta = 1 failed: {result.reason}")
    simulator = runner.solver.simulator
    moved = simulator.displacement(result.state.w)
    dilation = simulator.wall_dilation(result.state.w)
    field = strain_field(simulator.observer, moved, dilation)
    field.to_parquet(table, index=False)
    means = cell_means(field)
    write_mesh(
        simulator.observer.wall.mesh,
        vtu,
        {"displacement": moved},
        {q: means[q].to_numpy() for q in means},
        runner.parameters.zones,
    )


def strain_field(
    observer: Observer, displacement: np.ndarray, dilation: float | np.ndarray | None = None
) -> pd.DataFrame:
    """Strains at the Gauss points of every cell, whose means over segments are observed (of the
    whole wall, before a layer, turned segments or a scale of the strains).

    displacement, dilation: as of `Observer.values`. Columns: cell and point (numbers, cells in the
    mesh's order, points with the last reference coordinate fastest), segment (AHA), volume_mm3 (of
    the wall in the reference state, what a segment mean weights with), circumferential, radial,
    longitudinal.
    """
    wall = observer.wall
    cells, count = len(wall.segment), wall.points_per_cell
    strains = observer.point_motion(displacement, dilation).strains
    return pd.DataFrame(
        {
            "cell": np.repeat(np.arange(cells), count),
            "point": np.tile(np.arange(count), cells),
            "segment": np.repeat(wall.segment + 1, count),
            "volume_mm3": wall.volume,
            **{name: strains[name].numpy() for name in DIRECTIONS},
        }
    )


def cell_means(field: pd.DataFrame) -> pd.DataFrame:
    """Volume averages of `strain_field` over each cell: a row per cell, a column per direction."""
    weighted = field[list(DIRECTIONS)].mul(field["volume_mm3"], axis=0)
    volume = field.groupby("cell")["volume_mm3"].sum()
    return weighted.groupby(field["cell"]).sum().div(volume, axis=0)
