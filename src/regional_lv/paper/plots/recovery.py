"""Do the posteriors find the parameters that made the data? Errors against truth, coverage."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import seaborn
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from regional_lv.emulators import label_of
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.posteriors.files import chosen
from regional_lv.paper.posteriors.verdicts import failed_cases, warning_of
from regional_lv.plots import style

MANY = 18
"""More labels than this stand upright."""

OUTCOMES = {"covers": style.BLUE, "misses": style.VERMILLION, "failed": style.GREY}
"""Of a case's interval: covers the truth, misses it, or its posterior did not converge."""

LEVEL_COLOURS = {50: style.SKY, 80: style.GREEN, 95: style.BLUE}


@style.context
def draw(
    recovery: Path,
    coverage: Path,
    diagnostics: Path,
    choice: Path,
    parameters: StiffnessInputs,
    png: Path,
    csv: Path,
) -> None:
    """Draw errors of MAP and 95 % interval against the truth per parameter, and coverage.

    recovery: CSV with case, parameter, truth, map, lower95, upper95, covered95. coverage: CSV with
    parameter (each and "all"), coverage50/80/95 and their 95 % intervals, drawn with them
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
    fig.set_layout_engine("constrained", h_pad=0.09)
    grid = fig.add_gridspec(rows + 1, columns, height_ratios=[1] * rows + [0.95])
    table["outcome"] = np.select(
        [table["failed"], table["covered95"].astype(bool)], ["failed", "covers"], "misses"
    )
    for (at, zone), (row, column) in zip(
        np.ndindex(places.shape[:2]), places.reshape(-1, 2), strict=True
    ):
        name = parameters[zone * len(factors) + at].name
        ax = fig.add_subplot(grid[row, column])
        _panel(ax, table[table["parameter"] == name])
        if column == 0:
            ax.set_ylabel("error: estimate - truth\n(MAP and 95 % interval)")
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
        [table.drop(columns="outcome").assign(panel="recovery"), covered.assign(panel="coverage")],
        ignore_index=True,
    )
    joined.insert(0, "panel", joined.pop("panel"))
    style.save(fig, joined, png, csv)


def _panel(ax: Axes, part: pd.DataFrame) -> None:
    """Errors of one parameter: intervals are too short to be seen beside the range of the truth."""
    ax.axhline(0, color=style.BLACK, linewidth=0.6, zorder=0)
    ends = part[["lower95", "upper95"]].sub(part["truth"], axis=0)
    # A line for each case as seaborn has none with both ends given.
    ax.vlines(
        part["truth"],
        ends["lower95"],
        ends["upper95"],
        linewidth=0.8,
        alpha=0.7,
        colors=part["outcome"].map(OUTCOMES),
        linestyles=part["failed"].map({True: "--", False: "-"}),
    )
    seaborn.scatterplot(
        x=part["truth"],
        y=part["map"] - part["truth"],
        hue=part["outcome"],
        palette=OUTCOMES,
        s=8,
        linewidth=0,
        legend=False,
        ax=ax,
    )
    ax.set(xlabel="", ylabel="")
    mse = ((part["map"] - part["truth"]) ** 2).mean()
    # Above the axes: intervals of any length stay clear of it.
    title = style.label(part["parameter"].iloc[0])
    covered = 100 * part["covered95"].astype(bool).mean()
    ax.set_title(f"{title}\nMSE {mse:.2g}, covered {covered:.1f} %", fontsize=9)


def _coverage(ax: Axes, table: pd.DataFrame, parameters: Sequence[str]) -> None:
    names = [*parameters, "all"]
    table = table.set_index("parameter").loc[names]
    table = 100 * table
    shown = []
    for level, colour in LEVEL_COLOURS.items():
        columns = [f"coverage{level}{end}" for end in ("", "_lower", "_upper")]
        part = table[columns].set_axis(["value", "lower", "upper"], axis=1)
        shown.append(part.reset_index().assign(level=level))
        ax.axhline(level, color=colour, linestyle="--", linewidth=1)
        ax.annotate(
            f"{level} %",
            (1, level),
            xycoords=("axes fraction", "data"),
            xytext=(3, 0),
            textcoords="offset points",
            va="center",
            color=colour,
        )
    style.intervals(
        ax,
        pd.concat(shown),
        "parameter",
        "value",
        ("lower", "upper"),
        hue="level",
        palette=LEVEL_COLOURS,
        dodge=0.36,
        legend=False,
    )
    many = len(names) > MANY
    labels = [style.label(name) for name in names]
    if not many:
        labels = [style.in_lines(label) for label in labels]
    ax.set_xticks(range(len(names)), labels, rotation=90 if many else 0)
    ax.set(xlabel="", ylabel="intervals that cover (%)", ylim=(None, 101))
    title = (
        "Coverage of the 50, 80 and 95 % intervals, with 95 % intervals (all: cases as clusters)"
    )
    ax.set_title(title)


def _legend(table: pd.DataFrame) -> list[Line2D]:
    handles = [
        Line2D([], [], color=OUTCOMES["covers"], marker="o", markersize=3, label="interval covers"),
        Line2D([], [], color=OUTCOMES["misses"], marker="o", markersize=3, label="does not cover"),
    ]
    if table["failed"].any():
        handles.append(
            Line2D(
                [],
                [],
                color=OUTCOMES["failed"],
                linestyle="--",
                label="posterior failed its check",
            )
        )
    return handles
