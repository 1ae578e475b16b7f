"""How far the MAP is from the truth, by zone and severity, in and outside the stiffened zone."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D

from regional_lv import aha
from regional_lv.figures import scenarios, style
from regional_lv.figures.bullseye_map import summarise


@style.context
def draw(
    recoveries: Sequence[Path],
    noisy: Sequence[Path],
    labels: Sequence[str],
    png: Path,
    csv: Path,
) -> None:
    """Draw the MAP's root mean square error; C_a above C_b, with measurement noise on the right.

    recoveries, noisy: `recovery.csv` of the sets `labels` and of their noisy twins. The table:
    noise, stiffened, set, quantity, zone, cases, truth, map, rmse, failed.
    """
    parts, warnings = [], []
    for noise, paths in zip(scenarios.NOISE, (recoveries, noisy), strict=True):
        table = scenarios.read_sets(paths, labels)
        warnings.append(scenarios.warning(table))
        for stiffened, group in table.groupby("stiffened"):
            parts.append(summarise(group).assign(noise=noise, stiffened=stiffened))
    summary = pd.concat(parts, ignore_index=True)
    summary = summary[["noise", "stiffened", *summary.columns[:-2]]]

    fig = style.figure(10.5, 6.4)
    axes = scenarios.panels(fig, 2, 2, sharex=True, sharey=True)
    for column, noise in zip(axes.T, scenarios.NOISE, strict=True):
        column[0].set_title(noise)
        for ax, kind in zip(column, ("C_a", "C_b"), strict=True):
            chosen = (summary["noise"] == noise) & (summary["quantity"] == kind)
            _panel(ax, summary[chosen], labels)
    for ax, kind in zip(axes[:, 0], ("C_a", "C_b"), strict=True):
        ax.set_ylabel(f"RMSE of the MAP of ${kind}$")
    fig.legend(handles=_legend(labels), loc="outside lower center", ncols=len(labels) + 2)
    style.suptitle(fig, "Error of the MAP by zone and severity", " / ".join(filter(None, warnings)))
    style.save(fig, summary, png, csv)


def _panel(ax, part: pd.DataFrame, labels: Sequence[str]) -> None:
    place = np.arange(len(aha.ZONES))
    for at, label in enumerate(labels):
        shift = 0.75 * ((at + 0.5) / len(labels) - 0.5)
        colour, marker = scenarios.COLOURS[at], scenarios.MARKERS[at]
        for stiffened, face in ((True, colour), (False, "white")):
            mine = part[(part["set"] == label) & (part["stiffened"] == stiffened)]
            value = mine.set_index("zone")["rmse"].reindex(list(aha.ZONES))
            ax.plot(
                place + shift, value, marker, color=colour, markerfacecolor=face, markersize=5.5
            )
    ax.set_xticks(place, aha.ZONES)
    ax.set_yscale("log")
    ax.yaxis.grid(True, which="both", color=style.LIGHT, linewidth=0.5)
    for border in place[:-1] + 0.5:
        ax.axvline(border, color=style.LIGHT, linewidth=0.8)


def _legend(labels: Sequence[str]) -> list[Line2D]:
    def mark(marker, colour, face, label):
        return Line2D(
            [], [], linestyle="", marker=marker, color=colour, markerfacecolor=face, label=label
        )

    sets = [
        mark(scenarios.MARKERS[i], scenarios.COLOURS[i], scenarios.COLOURS[i], label)
        for i, label in enumerate(labels)
    ]
    kinds = [
        mark("o", style.GREY, style.GREY, "stiffened zone"),
        mark("o", style.GREY, "white", "other zones"),
    ]
    return sets + kinds
