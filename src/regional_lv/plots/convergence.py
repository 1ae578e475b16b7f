"""Errors against the fineness of the mesh, with the orders fitted to them."""

from pathlib import Path

import numpy as np
import pandas as pd
import seaborn
from matplotlib.axes import Axes

from regional_lv.plots import style

TITLES = {"tube": "Tube, against the exact solution", "heart": "Heart, against its extrapolation"}
LOOKS = (
    (style.BLUE, "o"),
    (style.VERMILLION, "s"),
    (style.GREEN, "^"),
    (style.ORANGE, "D"),
    (style.PINK, "v"),
)


@style.context
def draw(errors: Path, orders: Path, png: Path, csv: Path) -> None:
    """Draw the tables (CSV) of `verification.convergence.run`, a panel for each body in them.

    The table is that of the errors with the order of each quantity beside it.
    """
    table = pd.read_csv(errors).merge(pd.read_csv(orders), on=["body", "quantity"])
    bodies = table["body"].unique()
    fig = style.figure(4.75 * len(bodies), 4.4)
    for ax, body in zip(fig.subplots(1, len(bodies), squeeze=False)[0], bodies, strict=True):
        _panel(ax, table[table["body"] == body])
        ax.set_title(TITLES[body])
    style.suptitle(fig, "Convergence under uniform refinement")
    style.save(fig, table, png, csv)


def _panel(ax: Axes, table: pd.DataFrame) -> None:
    names = table["quantity"] + ": order " + table["order"].map("{:.1f}".format)
    looks = dict(zip(names.unique(), LOOKS, strict=False))
    colours, markers = ({name: look[at] for name, look in looks.items()} for at in (0, 1))
    seaborn.lineplot(
        table,
        x="layers",
        y="error",
        hue=names,
        style=names,
        ax=ax,
        estimator=None,
        palette=colours,
        markers=markers,
        dashes=False,
        markersize=5,
    )
    layers = np.unique(table["layers"])
    ax.set(xscale="log", yscale="log", xlabel="elements through the wall", ylabel="relative error")
    ax.set_xticks(layers, [str(n) for n in layers])
    ax.set_xticks([], minor=True)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16))
