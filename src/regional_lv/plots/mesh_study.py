"""Errors of the observables on several meshes, point by point of the box."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from regional_lv.plots import style

PANELS = (
    ("max_strain", "largest error of the 51 strains", (0.003, 0.006)),
    ("volume_percent", "error of the volume (%)", (0.5,)),
)
"""Column, label, and the limits that the study's mesh is chosen for."""


@style.context
def draw(errors: Path, png: Path, csv: Path) -> None:
    """Draw the table (CSV) of `verification.mesh_study.compare`: one dot per mesh and point."""
    table = pd.read_csv(errors)
    shown = table[table["max_strain"] > 0]  # the reference's own errors are zero
    fig = style.figure(9.5, 3.8)
    for ax, (column, label, limits) in zip(fig.subplots(1, 2), PANELS, strict=True):
        _panel(ax, shown, column, limits)
        ax.set_ylabel(label)
    style.suptitle(fig, "Error against the reference mesh")
    style.save(fig, table, png, csv)


def _panel(ax: Axes, table: pd.DataFrame, column: str, limits) -> None:
    names = list(dict.fromkeys(table["mesh"]))
    for place, name in enumerate(names):
        values = table.loc[table["mesh"] == name, column].to_numpy()
        spread = place + np.linspace(-0.2, 0.2, len(values))
        ax.plot(spread, values, "o", color=style.BLUE, markersize=3, alpha=0.6)
        ax.plot(place + np.array([-0.3, 0.3]), [np.median(values)] * 2, color=style.VERMILLION)
    for limit in limits:
        ax.axhline(limit, color="0.5", linestyle=":", linewidth=1)
    unknowns = table.groupby("mesh")["unknowns"].first()
    labels = [f"{unknowns[n]:,}\n" + n.replace(", ", ",\n") for n in names]
    ax.set_xticks(range(len(names)), labels, fontsize=7)
    ax.set_yscale("log")
    ax.set_xlabel("mesh, with its number of unknowns (line: median)")
