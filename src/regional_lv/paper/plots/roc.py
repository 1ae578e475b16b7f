"""How well a stiffened zone is told from a zone at baseline: receiver operating characteristics."""

from collections.abc import Sequence
from itertools import cycle, product
from pathlib import Path

import pandas as pd
import seaborn

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.plots import scenarios
from regional_lv.paper.posteriors.sets_table import NOISE, read_sets
from regional_lv.paper.posteriors.verdicts import warning_of_sets
from regional_lv.plots import style

LINES = ("-", "--", "-.")
"""Of the factors, in their order; what combines them is dotted."""


@style.context
def draw(
    curves: Sequence[Path],
    areas: Sequence[Path],
    recoveries: Sequence[Path],
    labels: Sequence[str],
    parameters: StiffnessInputs,
    png: Path,
    csv: Path,
) -> None:
    """Draw the curves of every set: rows without and with noise, a column for each scenario.

    curves: `roc.csv` (quantity, zone, threshold, false_positive_rate, true_positive_rate); areas:
    `auc.csv` (quantity, zone, auc, auc_lower, auc_upper, ...); recoveries: `recovery.csv` (for
    verdicts); all of the sets in `labels` and then of their noisy twins. Drawn is zone `all`: every
    zone of every case is one decision; global stiffening, which leaves no zone at baseline, borrows
    those of the local scenarios. The table holds the curves of all zones with their area.
    """
    fig = style.figure(3.3 * len(labels) + 0.4, 6.8)
    axes = scenarios.panels(fig, 2, len(labels), sharex=True, sharey=True)
    parts = []
    for ax, (noise, label), curve, area in zip(
        axes.ravel(), product(NOISE, labels), curves, areas, strict=True
    ):
        table = pd.read_csv(curve).merge(pd.read_csv(area), on=["quantity", "zone"])
        _panel(ax, table[table["zone"] == "all"], parameters.factors)
        ax.set_title(f"{label}\n{noise}")
        table.insert(0, "noise", noise)
        table.insert(0, "set", label)
        parts.append(table)
    for ax in axes[-1]:
        ax.set_xlabel("false positive rate\n(baseline zones called stiff)")
    for ax in axes[:, 0]:
        ax.set_ylabel("true positive rate\n(stiffened zones called stiff)")
    warning = warning_of_sets(read_sets(recoveries, labels, parameters))
    style.suptitle(fig, "Classification of stiffened zones by posterior probability", warning)
    style.save(fig, pd.concat(parts, ignore_index=True), png, csv)


def _panel(ax, table: pd.DataFrame, factors: Sequence[str]) -> None:
    ax.plot([0, 1], [0, 1], color=style.LIGHT, linewidth=0.8)
    colours = style.factor_colours(factors)
    lines = dict(zip(factors, cycle(LINES), strict=False))
    for quantity in [*factors, *(q for q in table["quantity"].unique() if q not in factors)]:
        colour, line = colours.get(quantity, style.BLACK), lines.get(quantity, ":")
        name = style.factor_label(quantity) if quantity in factors else quantity
        mine = table[table["quantity"] == quantity].sort_values(
            ["false_positive_rate", "true_positive_rate"]
        )
        if mine.empty:
            continue
        first = mine.iloc[0]
        # Three digits: two of 0.985 are 0.98 here and 0.99 where the decimal number is rounded.
        label = f"{name}: {first['auc']:.3f} [{first['auc_lower']:.3f}, {first['auc_upper']:.3f}]"
        seaborn.lineplot(
            mine,
            x="false_positive_rate",
            y="true_positive_rate",
            color=colour,
            ax=ax,
            linestyle=line,
            label=label,
            estimator=None,
            sort=False,
        )
    ax.set(aspect="equal", xlim=(-0.02, 1.02), ylim=(-0.02, 1.02), xlabel="", ylabel="")
    ax.legend(
        loc="lower right",
        title="area under the curve",
        title_fontsize=8,
        frameon=True,
        framealpha=0.8,
        edgecolor="none",
    )
