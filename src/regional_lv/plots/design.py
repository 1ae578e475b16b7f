"""What the design brought: observed channels, and where simulations did not converge."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from regional_lv.channels import Channel, Channels
from regional_lv.parameters import Parameterisation
from regional_lv.plots import style

QUANTILES = {"lower95": 0.025, "lower50": 0.25, "median": 0.5, "upper50": 0.75, "upper95": 0.975}


@style.context
def draw(
    simulations: Path,
    excluded: Path,
    parameters: Parameterisation,
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
    for scale in scales:
        values = table.loc[table["scale"] == scale, channel.name]
        counts, _ = np.histogram(values, edges)
        ax.stairs(counts, edges, fill=True, alpha=0.35, color=style.SCALE_COLOURS[scale])
        ax.stairs(counts, edges, color=style.SCALE_COLOURS[scale])
        middles = (edges[1:] + edges[:-1]) / 2
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
    rows = []
    for place, scale in enumerate(scales):
        part = table[table["scale"] == scale]
        boxes = []
        for channel in channels:
            if part.empty:
                continue
            stats = {key: part[channel.name].quantile(q) for key, q in QUANTILES.items()}
            rows += [(quantity, scale, channel.name, key, value) for key, value in stats.items()]
            boxes.append(
                {
                    "med": stats["median"],
                    "q1": stats["lower50"],
                    "q3": stats["upper50"],
                    "whislo": stats["lower95"],
                    "whishi": stats["upper95"],
                }
            )
        if not boxes:
            continue
        colour = style.SCALE_COLOURS[scale]
        offset = 0.38 * (place - (len(scales) - 1) / 2)
        ax.bxp(
            boxes,
            positions=np.array([channel.segment for channel in channels]) + offset,
            widths=0.32,
            showfliers=False,
            patch_artist=True,
            manage_ticks=False,
            boxprops={"facecolor": colour, "alpha": 0.45, "edgecolor": colour},
            medianprops={"color": style.BLACK, "linewidth": 1.4},
            whiskerprops={"color": colour},
            capprops={"color": colour},
        )
    ax.axhline(0, color=style.GREY, linewidth=0.6, zorder=0)
    ax.set_xticks(range(1, 18))
    strain = channels[0].kind.is_strain
    ax.set(xlim=(0.4, 17.6), ylabel="strain" if strain else quantity)
    title = f"{quantity.capitalize()}{' strain' if strain else ''}"
    ax.set_title(f"{title}: median, middle 50 % and 95 %")
    return rows


def _excluded(
    ax: Axes,
    lost: pd.DataFrame,
    scales: list[str],
    converged: int,
    parameters: Parameterisation,
) -> list[tuple]:
    rows = []
    height = {name: -i for i, name in enumerate(parameters.names)}
    for name, y in height.items():
        ax.axhline(y, color=style.LIGHT, linewidth=0.8, zorder=0)
        for place, scale in enumerate(scales):
            part = lost[lost["scale"] == scale]
            offset = 0.3 * (place - (len(scales) - 1) / 2)
            ax.plot(
                part[f"place_{name}"],
                np.full(len(part), y - offset),
                "x",
                color=style.SCALE_COLOURS[scale],
                markersize=4,
            )
            rows += [
                ("excluded", scale, name, f"place of sample {sample}", value)
                for sample, value in zip(part["sample"], part[f"place_{name}"], strict=True)
            ]
    ax.set_yticks(list(height.values()), [style.label(n) for n in height])
    ax.set(xlim=(-0.02, 1.02), xlabel="place in the box, log scale (0 lower bound, 1 upper bound)")
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
