"""How far the MAP is from the truth, by zone and severity, in and outside the stiffened zone."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import seaborn
from matplotlib.lines import Line2D

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.plots import scenarios
from regional_lv.paper.plots.bullseye_map import summarise
from regional_lv.paper.posteriors.sets_table import NOISE, read_sets
from regional_lv.paper.posteriors.verdicts import warning_of_sets
from regional_lv.plots import bullseye, style


@style.context
def draw(
    recoveries: Sequence[Path],
    labels: Sequence[str],
    parameters: StiffnessInputs,
    png: Path,
    csv: Path,
) -> None:
    """Draw the MAP's root mean square error; a row for each factor, with measurement noise on the
    right.

    recoveries: `recovery.csv` of the sets `labels` and then of their noisy twins. The table: noise,
    stiffened, set, quantity, zone, cases, truth, map, rmse, failed.
    """
    table = read_sets(recoveries, labels, parameters)
    summary = summarise(table, ["noise", "stiffened"])
    factors = parameters.factors
    many = len(parameters.zones) > bullseye.FEW_ZONES
    # Without noise errors are some 1,000 times smaller: each column has its own axis.
    fig = style.figure(18.0 if many else 10.5, 2.6 * len(factors) + 1.2)
    axes = scenarios.panels(fig, len(factors), 2, sharex=True, sharey="col")
    for column, noise in zip(axes.T, NOISE, strict=True):
        column[0].set_title(noise)
        for ax, factor in zip(column, factors, strict=True):
            chosen = (summary["noise"] == noise) & (summary["quantity"] == factor)
            _panel(ax, summary[chosen], labels, parameters.zone_names)
    for ax, factor in zip(axes[:, 0], factors, strict=True):
        ax.set_ylabel(f"RMSE of the MAP of {style.factor_label(factor)}")
    for ax in axes[-1] if many else []:
        ax.tick_params(axis="x", rotation=60)
    fig.legend(handles=_legend(labels), loc="outside lower center", ncols=len(labels) + 2)
    title = "Error of the MAP by zone and severity (axes differ between columns)"
    style.suptitle(fig, title, warning_of_sets(table))
    style.save(fig, summary, png, csv)


def _panel(ax, part: pd.DataFrame, labels: Sequence[str], zones: Sequence[str]) -> None:
    sets = {label: scenarios.look(at) for at, label in enumerate(labels)}
    for stiffened, face in ((True, None), (False, "white")):
        mine = part[part["stiffened"] == stiffened]
        seaborn.pointplot(
            mine,
            x="zone",
            y="rmse",
            hue="set",
            order=zones,
            hue_order=labels,
            ax=ax,
            palette=[colour for colour, _ in sets.values()],
            errorbar=None,
            markers=[marker for _, marker in sets.values()],
            linestyle="none",
            markersize=5.5,
            markerfacecolor=face,
            markeredgewidth=1,
            legend=False,
            dodge=0.75 * (1 - 1 / len(labels)),
        )
    place = np.arange(len(zones))
    ax.set_xticks(place, [style.zone_label(zone) for zone in zones])
    ax.set(xlabel="", ylabel="", yscale="log")
    style.plain_log(ax.yaxis)
    ax.yaxis.grid(True)
    for border in place[:-1] + 0.5:
        ax.axvline(border, color=style.LIGHT, linewidth=0.8)


def _legend(labels: Sequence[str]) -> list[Line2D]:
    looks = {label: (*scenarios.look(at), "") for at, label in enumerate(labels)}
    looks |= {"stiffened zone": (style.GREY, "o", ""), "other zones": (style.GREY, "o", "white")}
    return [
        Line2D([], [], ls="", marker=marker, color=colour, mfc=face or colour, label=label)
        for label, (colour, marker, face) in looks.items()
    ]
