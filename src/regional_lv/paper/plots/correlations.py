"""Posterior correlations, averaged over the cases of a set (the paper's Figures S2-S5)."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import seaborn
from matplotlib.axes import Axes
from matplotlib.collections import Collection

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.posteriors import verdicts
from regional_lv.plots import style

SCALE = {"vmin": -1, "vmax": 1, "cmap": "PuOr"}
"""Orange-brown negative, purple positive, as in the paper."""


@style.context
def draw(
    correlations: Path,
    recovery: Path,
    label: str,
    parameters: StiffnessInputs,
    png: Path,
    csv: Path,
) -> None:
    """Draw the correlations of all parameters in one set, mean and standard error over its cases.

    correlations: `correlations.csv` (parameter_1, parameter_2, mean, se, cases); recovery:
    `recovery.csv`, for verdicts. Black lines are the borders of the zones.
    """
    joined = read([correlations], [label])
    count, factors = len(parameters), len(parameters.factors)
    side = max(8.0, 0.52 * count) if count > 4 else 4.5
    fig = style.figure(side + 1.2, side)
    ax = fig.subplots()
    image = matrix(ax, joined, "parameter", parameters.names, style.label)
    for border in np.arange(factors, count, factors) if factors > 1 else ():
        ax.axhline(border, color=style.BLACK, linewidth=0.8)
        ax.axvline(border, color=style.BLACK, linewidth=0.8)
    fig.colorbar(image, ax=ax, label="posterior correlation", shrink=0.8)
    cases = joined["cases"].max()
    warning = verdicts.warning_of_sets(verdicts.read_sets([recovery], [label], parameters))
    style.suptitle(
        fig, f"Posterior correlations, {label}: mean ± standard error, {cases} cases", warning
    )
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
    size = 7 if len(names) <= 12 else 5.5
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
