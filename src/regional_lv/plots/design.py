"""What the design brought: observed channels, and where simulations did not converge."""

from pathlib import Path

import numpy as np
import pandas as pd
import seaborn
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from regional_lv.channels import Channel, Channels
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.plots import style

QUANTILES = {"lower95": 0.025, "lower50": 0.25, "median": 0.5, "upper50": 0.75, "upper95": 0.975}


@style.context
def draw(
    simulations: Path,
    excluded: Path,
    parameters: StiffnessInputs,
    channels: Channels,
    png: Path,
    csv: Path,
) -> None:
    """Draw the screened simulations (Parquet) and the excluded ones (CSV).

    Of the channels, those at end diastole are drawn: segments' as boxes, others as histograms. The
    table is long: panel (a quantity | excluded), scale, item (channel, bin or parameter),
    statistic, value.
    """
    shown = [channel for channel in channels if channel.load_fraction == 1]
    names = [channel.name for channel in shown]
    table = pd.read_parquet(simulations, columns=["sample", "scale", *names])
    lost = pd.read_csv(excluded)
    scales = [s for s in style.SCALE_COLOURS if s in set(table["scale"]) | set(lost["scale"])]
    single = [channel for channel in shown if not channel.segment]
    by_segment: dict[str, list[Channel]] = {}
    for channel in shown:
        if channel.segment:
            by_segment.setdefault(channel.quantity, []).append(channel)

    # Beside the histograms, which share the left side, the parameters of what did not converge.
    beside = max(len(single), -(-len(parameters) // 12), 1)
    fig = style.figure(11.0, 2.625 * (beside + len(by_segment)))
    grid = fig.add_gridspec(beside + len(by_segment), 2, width_ratios=[1, 1.35])
    rows = []
    for at, channel in enumerate(single):
        rows += _histogram(fig.add_subplot(grid[at, 0]), table, channel, scales)
    place = grid[:beside, 1 if single else slice(None)]
    rows += _excluded(fig.add_subplot(place), lost, scales, len(table), parameters)
    for row, (quantity, some) in enumerate(by_segment.items(), start=beside):
        ax = fig.add_subplot(grid[row, :])
        rows += _boxes(ax, table, quantity, some, scales)
    if by_segment:
        ax.set_xlabel("AHA segment")
    handles = [
        Patch(color=style.SCALE_COLOURS[s], label=f"{s} scale ({(table['scale'] == s).sum()})")
        for s in scales
    ]
    fig.legend(handles=handles, loc="outside upper right", ncols=len(scales))
    style.suptitle(fig, f"{len(table)} converged simulations of the training design")
    columns = ["panel", "scale", "item", "statistic", "value"]
    style.save(fig, pd.DataFrame(rows, columns=columns), png, csv)


def _histogram(ax: Axes, table: pd.DataFrame, channel: Channel, scales: list[str]) -> list[tuple]:
    rows = []
    unit = "" if channel.unit == "1" else channel.unit
    edges = np.histogram_bin_edges(table[channel.name], bins=40)
    middles = (edges[1:] + edges[:-1]) / 2
    seaborn.histplot(
        table,
        x=channel.name,
        hue="scale",
        hue_order=scales,
        bins=edges,
        palette=style.SCALE_COLOURS,
        element="step",
        alpha=0.35,
        legend=False,
        ax=ax,
    )
    for scale in scales:
        counts, _ = np.histogram(table.loc[table["scale"] == scale, channel.name], edges)
        rows += [
            (channel.quantity, scale, f"{m:.4g} {unit}".strip(), "count", c)
            for m, c in zip(middles, counts, strict=True)
        ]
    title = style.channel_title(channel)
    ax.set(xlabel=f"end-diastolic {title}{f' ({unit})' if unit else ''}", ylabel="simulations")
    ax.set_title(title.capitalize())
    return rows


def _boxes(
    ax: Axes, table: pd.DataFrame, quantity: str, channels: list[Channel], scales: list[str]
) -> list[tuple]:
    """Boxes per segment: median, middle half, whiskers over the middle 95 %."""
    long = table.melt("scale", [channel.name for channel in channels], "channel")
    long["segment"] = long["channel"].map({c.name: c.segment for c in channels})
    present = [scale for scale in scales if scale in set(table["scale"])]
    seaborn.boxplot(
        long,
        x="segment",
        y="value",
        hue="scale",
        order=range(1, 18),
        ax=ax,
        gap=0.1,
        hue_order=present,
        palette=style.SCALE_COLOURS,
        legend=False,
        whis=(2.5, 97.5),
        showfliers=False,
        **style.BOXES,
    )
    quantiles = long.groupby(["scale", "channel"])["value"].quantile([*QUANTILES.values()])
    names = {level: name for name, level in QUANTILES.items()}
    rows = [
        (quantity, scale, channel, names[level], value)
        for (scale, channel, level), value in quantiles.items()
    ]
    ax.axhline(0, color=style.GREY, linewidth=0.6, zorder=0)
    strain = channels[0].kind.is_strain
    ax.set(xlabel="", ylabel="strain" if strain else quantity)
    title = f"{quantity.capitalize()}{' strain' if strain else ''}"
    ax.set_title(f"{title}: median, middle 50 % and 95 %")
    return rows


def _excluded(
    ax: Axes,
    lost: pd.DataFrame,
    scales: list[str],
    converged: int,
    parameters: StiffnessInputs,
) -> list[tuple]:
    places = {f"place_{name}": name for name in parameters.names}
    # The table has the parameters themselves as well.
    long = lost[["scale", "sample", *places]].rename(columns=places)
    long = long.melt(["scale", "sample"], var_name="item")
    seaborn.stripplot(
        long,
        x="value",
        y="item",
        hue="scale",
        order=parameters.names,
        ax=ax,
        hue_order=scales,
        palette=style.SCALE_COLOURS,
        dodge=True,
        jitter=False,
        marker="x",
        linewidth=1,
        size=4,
        legend=False,
        orient="y",
    )
    rows = [
        ("excluded", scale, name, f"place of sample {sample}", value)
        for scale, sample, name, value in long.itertuples(index=False)
    ]
    ax.yaxis.grid(True)
    ax.set_yticks(range(len(parameters)), [style.label(name) for name in parameters.names])
    ax.set(xlim=(-0.02, 1.02), ylim=(len(parameters) - 0.5, -0.5), ylabel="")
    ax.set_xlabel("place in the box, log scale (0 lower bound, 1 upper bound)")
    total = converged + len(lost)
    ax.set_title(f"Not converged: {len(lost)} of {total} ({100 * len(lost) / total:.2f} %)")
    if lost.empty:
        ax.text(
            0.5,
            0.5,
            "every simulation converged",
            transform=ax.transAxes,
            ha="center",
            bbox={"facecolor": "white", "edgecolor": "none"},
        )
    return rows
