"""Errors of the observables on several meshes, point by point of the box."""

import textwrap
from pathlib import Path

import pandas as pd
import seaborn
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
    shown = table[table["mesh"] != table["mesh"].iloc[-1]]  # the reference's own errors are zero
    fig = style.figure(11.0, 4.2)
    for ax, (column, label, limits) in zip(fig.subplots(1, 2), PANELS, strict=True):
        _panel(ax, shown, column, limits)
        ax.set_ylabel(label)
    fig.supxlabel("mesh, with its number of unknowns (line: median, dotted: limits)", fontsize=9)
    style.suptitle(fig, "Error against the reference mesh")
    style.save(fig, table, png, csv)


def _panel(ax: Axes, table: pd.DataFrame, column: str, limits) -> None:
    unknowns = table.groupby("mesh")["unknowns"].first().sort_values()
    names = list(unknowns.index)
    ax.set_yscale("log")  # before the dots, which a swarm places by their distances on paper
    seaborn.swarmplot(
        table, x="mesh", y=column, order=names, color=style.BLUE, size=3, alpha=0.6, ax=ax
    )
    seaborn.pointplot(
        table,
        x="mesh",
        y=column,
        order=names,
        estimator="median",
        errorbar=None,
        marker="_",
        markersize=24,
        linestyle="none",
        color=style.VERMILLION,
        ax=ax,
    )
    for limit in limits:
        ax.axhline(limit, color="0.5", linestyle=":", linewidth=1)
    labels = [f"{unknowns[n]:,}\n{textwrap.fill(n, 10)}" for n in names]
    ax.set_xticks(range(len(names)), labels, fontsize=7)
    ax.set_xlabel("")
