"""Posterior correlations of parameters or of zones, averaged over the cases of a set (the paper's
Figures 10 and S2-S5)."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import seaborn
from matplotlib.axes import Axes
from matplotlib.collections import Collection

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.plots import scenarios
from regional_lv.paper.posteriors.sets_table import read_sets
from regional_lv.paper.posteriors.verdicts import warning_of_sets
from regional_lv.plots import style

SCALE = {"vmin": -1, "vmax": 1, "cmap": "PuOr"}
"""Orange-brown negative, purple positive, as in the paper."""

FEW = 12
"""Up to so many names, numbers have letters of seven points."""


@style.context
def draw(
    correlations: Sequence[Path],
    recoveries: Sequence[Path],
    labels: Sequence[str],
    title: str,
    parameters: StiffnessInputs,
    png: Path,
    csv: Path,
) -> None:
    """Draw the correlations in each set, mean and standard error over its cases.

    correlations: `correlations.csv` (parameter_1, parameter_2, mean, se, cases) of the sets
    `labels`, or their `zone_correlations.csv` (zone_1, zone_2, ...: of the zones' first principal
    components); recoveries: `recovery.csv` of the same, for verdicts. Black lines between
    parameters are the borders of the zones. The table: set and the columns above.
    """
    joined = read(correlations, labels)
    of_zones = "zone_1" in joined
    names = parameters.zone_names if of_zones else parameters.names
    side = max(3.1, (0.62 if len(names) <= FEW else 0.5) * len(names))
    fig = style.figure(max(side * len(labels) + 1, 6.0), side + 0.7)
    axes = scenarios.panels(fig, 1, len(labels))[0]
    factors = len(names) // len(parameters.zones)
    for ax, (label, part) in zip(axes, joined.groupby("set", sort=False), strict=True):
        label_of = style.zone_label if of_zones else style.label
        image = matrix(ax, part, "zone" if of_zones else "parameter", names, label_of)
        for border in np.arange(factors, len(names), factors) if factors > 1 else ():
            ax.axhline(border, color=style.BLACK, linewidth=0.8)
            ax.axvline(border, color=style.BLACK, linewidth=0.8)
        ax.set_title(f"{label} ({part['cases'].max()} cases)")
    for ax in axes[1:]:
        ax.set_yticklabels([])
    fig.colorbar(image, ax=list(axes), label="posterior correlation", shrink=0.75)
    warning = warning_of_sets(read_sets(recoveries, labels, parameters))
    style.suptitle(fig, title, warning)
    style.save(fig, joined, png, csv)


def read(tables: Sequence[Path], labels: Sequence[str]) -> pd.DataFrame:
    """The rows of several tables of correlations, with the label of their `set`."""
    parts = [pd.read_csv(path) for path in tables]
    for part, label in zip(parts, labels, strict=True):
        part.insert(0, "set", label)
    return pd.concat(parts, ignore_index=True)


def matrix(
    ax: Axes,
    table: pd.DataFrame,
    what: str,
    names: Sequence[str],
    label: Callable[[str], str],
) -> Collection:
    """Heat map of the means with numbers on it; the diagonal is grey.

    what: `parameter` or `zone`, the stem of the columns that hold `names`; label: makes a label of
    a name.
    """
    indexed = table.set_index([f"{what}_1", f"{what}_2"])
    pairs = pd.MultiIndex.from_product([names, names])
    mean, se = (
        indexed[column].reindex(pairs).to_numpy(float).reshape(len(names), -1)
        for column in ("mean", "se")
    )
    np.fill_diagonal(mean, np.nan)
    text = np.vectorize(lambda m, e: f"{m:z.2f}" + (f"\n±{e:.3f}" if np.isfinite(e) else ""))
    size = 7 if len(names) <= FEW else 5.5
    labels = [label(name) for name in names]
    seaborn.heatmap(
        mean,
        ax=ax,
        annot=text(mean, se),
        fmt="",
        annot_kws={"fontsize": size},
        xticklabels=labels,
        yticklabels=labels,
        square=True,
        cbar=False,
        **SCALE,
    )
    ax.set_facecolor(style.LIGHT)  # of the diagonal, which is no correlation of zero
    for cell, value in zip(ax.texts, mean[np.isfinite(mean)], strict=True):
        cell.set_color("white" if abs(value) > 0.65 else "black")
    ax.set_xticks(ax.get_xticks(), labels, rotation=45, ha="right")
    ax.tick_params(axis="y", rotation=0)
    ax.tick_params(length=0)
    return ax.collections[0]
