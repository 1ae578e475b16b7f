"""Truth against MAP of stiffened or baseline zones on the bullseye (the paper's Figures 6-8)."""

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.colors import Normalize

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.plots import scenarios
from regional_lv.paper.posteriors.sets_table import read_sets
from regional_lv.paper.posteriors.verdicts import warning_of_sets
from regional_lv.plots import bullseye, style

ZONES_SHOWN = {"stiffened": "stiffened zones", "baseline": "zones left at baseline"}


@style.context
def draw(
    recoveries: Sequence[Path],
    labels: Sequence[str],
    zones: str,
    title: str,
    parameters: StiffnessInputs,
    png: Path,
    csv: Path,
) -> None:
    """Draw the mean truth beside the mean MAP, for one factor after the other, a row for each set.

    recoveries: `recovery.csv` of the sets called `labels`. zones: `stiffened` or `baseline`: which
    zones of a case count. The numbers under a MAP are its root mean square error. The table: set,
    quantity, zone, cases, truth, map (means), rmse, failed (posteriors, of the convergence check).
    """
    table = read_sets(recoveries, labels, parameters)
    chosen = table[table["stiffened"] == (zones == "stiffened")]
    summary = summarise(chosen)
    norm = Normalize(*_limits(summary))
    factors = parameters.factors
    side = 2.5 if len(parameters.zones) <= bullseye.FEW_ZONES else 3.6
    fig = style.figure(max(8.0, 2 * side * len(factors) + 1.2), side * len(labels) + 0.8)
    axes = scenarios.panels(fig, len(labels), 2 * len(factors))
    places = axes.reshape(len(labels), len(factors), 2)
    for at, (label, factor) in zip(
        np.ndindex(places.shape[:2]), product(labels, factors), strict=True
    ):
        part = summary[(summary["set"] == label) & (summary["quantity"] == factor)]
        part = part.set_index("zone").reindex(parameters.zone_names)
        truth = [f"{value:.2f}" for value in part["truth"]]
        # As many digits as a zone has room for.
        error = part["rmse"].map(lambda e: f"{e:.2f}" if e >= 0.01 else f"{e:.1g}")
        found = [f"{value:.2f}\n±{e}" for value, e in zip(part["map"], error, strict=True)]
        for ax, what, text in zip(places[at], ("truth", "map"), (truth, found), strict=True):
            scale = bullseye.paint_zones(ax, part[what], norm, "viridis", text, parameters)
    for pair, factor in zip(places[0], factors, strict=True):
        for ax, what in zip(pair, ("truth", "MAP"), strict=True):
            ax.set_title(f"{style.factor_label(factor)}, {what}")
    for ax, label in zip(axes[:, 0], labels, strict=True):
        ax.text(-0.06, 0.5, label, transform=ax.transAxes, rotation=90, ha="center", va="center")
    fig.colorbar(scale, ax=list(axes.ravel()), label="mean stiffness factor", shrink=0.8)
    head = f"{title}, {ZONES_SHOWN[zones]}: mean over cases, ± RMSE of the MAP"
    style.suptitle(fig, head, warning_of_sets(table))
    style.save(fig, summary, png, csv)


def summarise(table: pd.DataFrame, by: Sequence[str] = ()) -> pd.DataFrame:
    """Means of truth and MAP and the MAP's RMSE per set, quantity and zone, and `by` columns."""
    squared = table.assign(squared=(table["map"] - table["truth"]) ** 2)
    summary = squared.groupby([*by, "set", "quantity", "of"], sort=False).agg(
        cases=("case", "nunique"),
        truth=("truth", "mean"),
        map=("map", "mean"),
        rmse=("squared", "mean"),
        failed=("failed", "sum"),
    )
    summary["rmse"] = np.sqrt(summary["rmse"])
    return summary.reset_index().rename(columns={"of": "zone"})


def _limits(summary: pd.DataFrame) -> tuple[float, float]:
    """Round limits that hold all values: one scale for truth and MAP."""
    values = summary[["truth", "map"]].to_numpy()
    return np.floor(4 * values.min()) / 4, np.ceil(4 * values.max()) / 4
