"""Do the posteriors find the parameters that made the data? Truth against estimate, coverage."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from regional_lv.emulators import label_of
from regional_lv.parameters import Parameterisation
from regional_lv.plots import style
from regional_lv.plots.verdicts import chosen, failed_cases, warning_of

MANY = 18
"""More labels than this stand upright."""

LEVEL_COLOURS = {50: style.SKY, 80: style.GREEN, 95: style.BLUE}


@style.context
def draw(
    recovery: Path,
    coverage: Path,
    diagnostics: Path,
    choice: Path,
    parameters: Parameterisation,
    png: Path,
    csv: Path,
) -> None:
    """Draw MAP and 95 % interval against truth per parameter, and coverage with its own interval.

    recovery: CSV with case, parameter, truth, map, lower95, upper95, covered. coverage: CSV with
    parameter (each and "all"), coverage50/80/95 and their binomial 95 % intervals
    (`coverage95_lower`, `coverage95_upper`, ...). diagnostics: verdict of every case; intervals of
    posteriors that failed are grey and dashed. choice: JSON with the emulator's name. The table
    holds the rows of `recovery` with their verdict, and of `coverage`, told apart by the column
    `panel`.
    """
    table = pd.read_csv(recovery, dtype={"case": str})
    covered = pd.read_csv(coverage)
    failed = failed_cases(diagnostics)
    table["failed"] = table["case"].isin(failed)
    cases = table["case"].nunique()

    factors = parameters.factors
    (rows, columns), places = style.zone_places(len(parameters.zones), len(factors))
    fig = style.figure(max(12.0, 2.4 * columns), 2.95 * rows + 2.9)
    fig.get_layout_engine().set(h_pad=0.09)
    grid = fig.add_gridspec(rows + 1, columns, height_ratios=[1] * rows + [0.95])
    limit = 1.03 * table[["truth", "map", "upper95"]].max().max()
    for (at, zone), (row, column) in zip(
        np.ndindex(places.shape[:2]), places.reshape(-1, 2), strict=True
    ):
        name = parameters[zone * len(factors) + at].name
        ax = fig.add_subplot(grid[row, column])
        _panel(ax, table[table["parameter"] == name], limit)
        ax.set_title(style.label(name))
        if column == 0:
            ax.set_ylabel("MAP and 95 % interval")
        if at == len(factors) - 1:
            ax.set_xlabel("truth")
    _coverage(fig.add_subplot(grid[rows, :]), covered, parameters.names)
    fig.legend(handles=_legend(table), loc="outside lower center", ncols=4)
    mse = ((table["map"] - table["truth"]) ** 2).mean()
    everything = covered.set_index("parameter").loc["all"]
    style.suptitle(
        fig,
        f"Recovery of {cases} simulated test cases, {label_of(chosen(choice))}: "
        f"parameter MSE {mse:.3g}, 95 % intervals cover {100 * everything['coverage95']:.1f} %",
        warning_of(len(failed & set(table["case"])), cases, "grey"),
    )
    joined = pd.concat(
        [table.assign(panel="recovery"), covered.assign(panel="coverage")], ignore_index=True
    )
    joined.insert(0, "panel", joined.pop("panel"))
    style.save(fig, joined, png, csv)


def _panel(ax: Axes, part: pd.DataFrame, limit: float) -> None:
    covered = part["covered"].astype(bool)
    for which, colour, line in (
        (covered & ~part["failed"], style.BLUE, "-"),
        (~covered & ~part["failed"], style.VERMILLION, "-"),
        (part["failed"], style.GREY, "--"),
    ):
        here = part[which]
        ax.vlines(
            here["truth"],
            here["lower95"],
            here["upper95"],
            colors=colour,
            linestyles=line,
            linewidth=0.8,
            alpha=0.7,
        )
        ax.scatter(here["truth"], here["map"], c=colour, s=7, linewidths=0, zorder=3)
    ax.plot([0, limit], [0, limit], color=style.BLACK, linewidth=0.6)
    ax.set(xlim=(0, limit), ylim=(0, limit), aspect="equal")
    mse = ((part["map"] - part["truth"]) ** 2).mean()
    ax.text(
        0.04,
        0.97,
        f"MSE {mse:.2g}\ncovered {100 * covered.mean():.1f} %",
        transform=ax.transAxes,
        va="top",
        fontsize=8,
    )


def _coverage(ax: Axes, table: pd.DataFrame, parameters: Sequence[str]) -> None:
    names = [*parameters, "all"]
    table = table.set_index("parameter").loc[names]
    at = np.arange(len(names)) + np.r_[np.zeros(len(names) - 1), 0.5]
    for place, (level, colour) in enumerate(LEVEL_COLOURS.items()):
        value = 100 * table[f"coverage{level}"].to_numpy()
        ends = 100 * table[[f"coverage{level}_lower", f"coverage{level}_upper"]].to_numpy()
        shift = 0.18 * (place - 1)
        ax.axhline(level, color=colour, linestyle="--", linewidth=1)
        ax.vlines(at + shift, *ends.T, colors=colour)
        ax.plot(at + shift, value, "o", color=colour, markersize=4)
        ax.annotate(
            f"{level} %",
            (1, level),
            xycoords=("axes fraction", "data"),
            xytext=(3, 0),
            textcoords="offset points",
            va="center",
            color=colour,
        )
    many = len(names) > MANY
    labels = [style.label(name) for name in names]
    ax.set_xticks(at, labels if many else map(style.in_lines, labels), rotation=90 if many else 0)
    ax.set(ylabel="intervals that cover (%)", ylim=(None, 101))
    ax.set_title("Coverage of the 50, 80 and 95 % intervals, with binomial 95 % intervals")


def _legend(table: pd.DataFrame) -> list[Line2D]:
    handles = [
        Line2D([], [], color=style.BLUE, marker="o", markersize=3, label="interval covers"),
        Line2D([], [], color=style.VERMILLION, marker="o", markersize=3, label="does not cover"),
    ]
    if table["failed"].any():
        handles.append(
            Line2D([], [], color=style.GREY, linestyle="--", label="posterior failed its gate")
        )
    return handles
