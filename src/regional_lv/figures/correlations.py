"""Posterior correlations, averaged over the cases of a set (the paper's Figures 10, S2-S5)."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import Normalize

from regional_lv import aha
from regional_lv.figures import scenarios, style

SCALE = {"norm": Normalize(-1, 1), "cmap": "PuOr"}
"""Orange-brown negative, purple positive, as in the paper."""


@style.context
def draw_zones(
    tables: Sequence[Path],
    recoveries: Sequence[Path],
    labels: Sequence[str],
    title: str,
    png: Path,
    csv: Path,
) -> None:
    """Draw the 5 x 5 correlations of the zones' first components, mean ± standard error.

    tables: `zone_correlations.csv` (zone_1, zone_2, mean, se, cases) of the sets `labels`;
    recoveries: `recovery.csv` of the same, for verdicts. The table: set and the columns above.
    """
    joined = _read(tables, labels)
    fig = style.figure(3.1 * len(labels) + 1, 4.2)
    axes = scenarios.panels(fig, 1, len(labels))[0]
    for ax, label in zip(axes, labels, strict=True):
        part = joined[joined["set"] == label]
        image = _matrix(ax, part, "zone", aha.ZONES)
        ax.set_title(f"{label} ({part['cases'].max()} cases)")
    for ax in axes[1:]:
        ax.set_yticklabels([])
    fig.colorbar(image, ax=list(axes), label="posterior correlation", shrink=0.75)
    warning = scenarios.warning(scenarios.read_sets(recoveries, labels))
    style.suptitle(fig, title, warning)
    style.save(fig, joined, png, csv)


@style.context
def draw_parameters(table: Path, recovery: Path, label: str, png: Path, csv: Path) -> None:
    """Draw the 10 x 10 correlations of one set, mean and standard error over its cases.

    table: `correlations.csv` (parameter_1, parameter_2, mean, se, cases); recovery: `recovery.csv`,
    for verdicts.
    """
    joined = _read([table], [label])
    fig = style.figure(9.2, 8.0)
    ax = fig.subplots()
    image = _matrix(ax, joined, "parameter", aha.PARAMETERS)
    names = [style.parameter_label(name) for name in aha.PARAMETERS]
    ax.set_xticks(range(10), names, rotation=45, ha="right")
    ax.set_yticks(range(10), names)
    for border in np.arange(1.5, 9, 2):
        ax.axhline(border, color=style.BLACK, linewidth=0.8)
        ax.axvline(border, color=style.BLACK, linewidth=0.8)
    fig.colorbar(image, ax=ax, label="posterior correlation", shrink=0.8)
    cases = joined["cases"].max()
    warning = scenarios.warning(scenarios.read_sets([recovery], [label]))
    style.suptitle(
        fig, f"Posterior correlations, {label}: mean ± standard error, {cases} cases", warning
    )
    style.save(fig, joined, png, csv)


def _read(tables: Sequence[Path], labels: Sequence[str]) -> pd.DataFrame:
    parts = [pd.read_csv(path) for path in tables]
    for part, label in zip(parts, labels, strict=True):
        part.insert(0, "set", label)
    return pd.concat(parts, ignore_index=True)


def _matrix(ax: Axes, table: pd.DataFrame, what: str, names: Sequence[str]):
    """Heat map of the means with numbers on it; the diagonal stays empty."""
    indexed = table.set_index([f"{what}_1", f"{what}_2"])
    pairs = pd.MultiIndex.from_product([names, names])
    mean, se = (
        indexed[column].reindex(pairs).to_numpy().reshape(len(names), -1)
        for column in ("mean", "se")
    )
    np.fill_diagonal(mean, np.nan)
    image = ax.imshow(mean, **SCALE)
    for i, j in np.argwhere(np.isfinite(mean)):
        error = f"\n±{se[i, j]:.3f}" if np.isfinite(se[i, j]) else ""
        colour = "white" if abs(mean[i, j]) > 0.65 else "black"
        ax.text(
            j, i, f"{mean[i, j]:z.2f}{error}", ha="center", va="center", color=colour, fontsize=7
        )
    ax.set_xticks(range(len(names)), names, rotation=45, ha="right")
    ax.set_yticks(range(len(names)), names)
    ax.spines[:].set_visible(False)
    return image
