"""Widths of the 95 % HPD intervals in the stiffening scenarios (the paper's Figure 9)."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import seaborn
from matplotlib.patches import Patch

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.plots import scenarios
from regional_lv.paper.posteriors.sets_table import read_sets
from regional_lv.paper.posteriors.verdicts import warning_of_sets
from regional_lv.plots import style

GROUPS = {
    "all parameters": style.GREY,
    "of the stiffened zone": style.VERMILLION,
    "of the other zones": style.SKY,
}
STATISTICS = ("cases", "q05", "q25", "median", "q75", "q95", "mean")


@style.context
def draw(
    recoveries: Sequence[Path],
    labels: Sequence[str],
    parameters: StiffnessInputs,
    png: Path,
    csv: Path,
) -> None:
    """Draw boxes (quartiles) with whiskers (5 and 95 %) of the HPD widths of all cases.

    recoveries: `recovery.csv` of the sets `labels` and then of their noisy twins. The table:
    noise, set, parameters (which), then STATISTICS.
    """
    table = read_sets(recoveries, labels, parameters)
    groups = _groups(table)
    fig = style.figure(11.0, 4.8)
    axes = scenarios.panels(fig, 1, 2)[0]  # noise widens the intervals by two decades
    for ax, (noise, part) in zip(axes, groups.groupby("noise", sort=False), strict=True):
        seaborn.boxplot(
            part,
            x="set",
            y="hpd_width95",
            hue="parameters",
            order=labels,
            ax=ax,
            hue_order=GROUPS,
            palette=GROUPS,
            whis=(5, 95),
            showfliers=False,
            gap=0.1,
            legend=False,
            **style.BOXES,
        )
        ax.set(xlabel="", ylabel="", title=noise, yscale="log")
        style.plain_log(ax.yaxis)
        ax.yaxis.grid(True, which="both")
    axes[0].set_ylabel("width of the 95 % HPD interval")
    handles = [Patch(color=colour, alpha=0.6, label=name) for name, colour in GROUPS.items()]
    fig.legend(handles=handles, loc="outside lower center", ncols=3)
    style.suptitle(
        fig,
        f"Widths of the 95 % HPD intervals (of the prior: {_prior_width(parameters)})",
        warning_of_sets(table),
    )
    style.save(fig, _statistics(groups), png, csv)


def _prior_width(parameters: StiffnessInputs) -> str:
    """Width of the prior's own 95 % interval, by factor where they differ."""
    widths = {name: f"{0.95 * np.ptp(bounds):.2f}" for name, bounds in parameters.bounds.items()}
    if len(set(widths.values())) == 1:
        return next(iter(widths.values()))
    return ", ".join(f"{style.factor_label(name)} {width}" for name, width in widths.items())


def _groups(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of `read_sets` once for each of GROUPS that they belong to: `parameters`."""
    of = np.where(table["stiffened"], "of the stiffened zone", "of the other zones")
    return pd.concat([table.assign(parameters="all parameters"), table.assign(parameters=of)])


def _statistics(table: pd.DataFrame) -> pd.DataFrame:
    """STATISTICS of each noise, set and group of a table of `_groups`."""
    groups = table.groupby(["noise", "set", "parameters"], sort=False)
    widths = groups["hpd_width95"]
    summary = widths.quantile([0.05, 0.25, 0.5, 0.75, 0.95]).unstack()
    summary.columns = STATISTICS[1:-1]
    summary = summary.assign(cases=groups["case"].nunique(), mean=widths.mean())
    return summary[[*STATISTICS]].reset_index()
