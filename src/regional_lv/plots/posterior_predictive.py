"""What the posterior predicts for each channel, with the observations (the paper's Figure 12)."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.stats import gaussian_kde

from regional_lv.channels import Channel, Channels
from regional_lv.criticism.case_posterior import CasePosterior, read_averaged
from regional_lv.plots import style
from regional_lv.quantities import QUANTITIES

GAP = 1.2
"""Between quantities, in widths of a violin."""

ROOM = 3.5
"""For numbers and name of an axis between quantities, in widths of a violin."""

WIDTH = 0.84
"""Of a violin where it is widest."""

GRID = 100
"""Values at which a density is evaluated."""

INTERVAL: dict = {"color": style.BLACK, "linewidth": 0.8}
MEDIAN: dict = {"color": style.BLACK, "linestyle": "", "marker": "_", "markersize": 7}
INSIDE: dict = {
    "color": style.OBSERVED,
    "linestyle": "",
    "marker": "D",
    "markersize": 4,
    "zorder": 5,
}
OUTSIDE = INSIDE | {"marker": "x", "markersize": 7, "markeredgewidth": 2}

COLUMNS = ["output", "quantity", "segment", "item", "value", "density", "inside"]


@style.context
def draw(posterior: Path, findings: Path, source: str, png: Path, csv: Path) -> None:
    """`draw_posterior` of one that is averaged over models (NetCDF, and its findings)."""
    draw_posterior(read_averaged(posterior, findings), source, png, csv)


def draw_posterior(found: CasePosterior, source: str, png: Path, csv: Path) -> None:
    """Draw violins of the posterior predictive and the observations on them.

    The predictive includes output error and measurement noise, in natural units. source:
    `subjects.<name>.source` of the config. Strains are read on the left, every other quantity on an
    axis of its own to its right; each load has a panel, the full one first. The table is long:
    output, quantity, segment, item (observed, median, lower95, upper95, density), value, density,
    inside.
    Raises InputError if the file has no posterior predictive.
    """
    predicted, observed = found.prediction
    channels = Channels.parse(predicted["output"].values.tolist())
    draws = {name: np.ravel(predicted.sel(output=name)) for name in channels.names}
    observed = observed.reindex(channels.names)

    loads = {
        load: [c for c in channels if c.load_fraction == load] for load in channels.load_fractions
    }
    widest = max(map(len, loads.values()))
    fig = style.figure(max(6.0, 0.27 * widest + 2.5), 5.0 * len(loads) ** 0.8)
    panels = fig.subplots(len(loads), 1, squeeze=False)[:, 0]
    rows = []
    for ax, (load, some) in zip(panels, loads.items(), strict=True):
        rows += _panel(ax, _by_quantity(some), draws, observed)
        if load != 1:
            ax.set_title(f"at {100 * load:g} % of the end-diastolic pressure", pad=16)

    table = pd.DataFrame(rows, columns=COLUMNS)
    table.insert(0, "subject", found.case)
    table["verdict"] = found.verdict
    seen = table[table["item"] == "observed"]
    outside = int((~seen["inside"].astype(bool)).sum())
    marks = {
        "posterior predictive": Patch(color=style.GREY, alpha=0.55),
        "median": Line2D([], [], **MEDIAN),
        "95 % interval": Line2D([], [], **INTERVAL),
        "observed, inside the 95 % interval": Line2D([], [], **INSIDE),
        "observed, outside": Line2D([], [], **OUTSIDE),
    }
    fig.legend(marks.values(), marks.keys(), loc="outside lower center", ncols=len(marks))
    title = found.title("Posterior predictive", source)
    style.suptitle(fig, f"{title}: {outside} of {len(seen)} observations outside", found.warning)
    style.save(fig, table, png, csv)


def _by_quantity(channels: list[Channel]) -> dict[str, list[Channel]]:
    """Channels of one load by quantity, wall strains first, places in order."""
    known = list(QUANTITIES)
    ordered = sorted(channels, key=lambda c: (not c.kind.is_strain, known.index(c.quantity)))
    groups: dict[str, list[Channel]] = {}
    for channel in ordered:
        groups.setdefault(channel.quantity, []).append(channel)
    return {
        quantity: sorted(some, key=lambda c: c.kind.places.index(c.place))
        for quantity, some in groups.items()
    }


def _panel(
    ax: Axes, groups: dict[str, list[Channel]], draws: Mapping[str, np.ndarray], observed: pd.Series
) -> list[tuple]:
    """The violins of one load; what is drawn."""
    colours = style.quantity_colours(groups)
    rows, ticks, abbreviations = [], {}, []
    last, at = list(groups)[-1], 0.0
    for quantity, channels in groups.items():
        strain, start = channels[0].kind.is_strain, at
        axis = ax if strain else ax.twinx()
        mine = []
        for channel in channels:
            mine += _violin(
                axis, at, channel, colours[quantity], draws[channel.name], observed[channel.name]
            )
            ticks[at] = _tick(channel)
            at += 1.0
        rows += mine
        ax.text(
            (start + at - 1) / 2,
            1.01,
            quantity,
            transform=ax.get_xaxis_transform(),
            ha="center",
            va="bottom",
            color=style.BLACK,
        )
        if not strain:
            unit = "" if channels[0].unit == "1" else f" ({channels[0].unit})"
            axis.spines["right"].set_visible(True)
            axis.set_ylabel(f"{quantity}{unit}")
            axis.set_ylim(_padded(mine))
            if start > 0:
                ax.axvline(start - 1.1, color=style.LIGHT, linewidth=0.8)
            if not channels[0].place:
                abbreviations.append(f"{quantity[0].upper()}: {quantity}")
            if quantity != last:
                axis.spines["right"].set_position(("data", at))
                at += ROOM
        at += GAP
    if not any(channels[0].kind.is_strain for channels in groups.values()):
        ax.set_yticks([])
        ax.spines["left"].set_visible(False)
    else:
        ax.axhline(0, color=style.LIGHT, linewidth=0.8, zorder=0)
        ax.set_ylabel("strain")
    ax.set_xticks(list(ticks), list(ticks.values()))
    for tick, text in zip(ax.get_xticklabels(), ticks.values(), strict=True):
        tick.set_rotation(90 if len(text) > 2 else 0)
    words = f" ({', '.join(abbreviations)})" if abbreviations else ""
    ax.set(xlim=(-1, at - 0.2), xlabel=f"AHA segment{words}")
    return rows


def _tick(channel: Channel) -> str:
    if channel.segment:
        return str(channel.segment)
    return channel.place or channel.quantity[0].upper()


def _violin(
    ax: Axes, at: float, channel: Channel, colour: str, draws: np.ndarray, observed: float
) -> list[tuple]:
    lower, median, upper = np.quantile(draws, [0.025, 0.5, 0.975])
    values = np.linspace(draws.min(), draws.max(), GRID)
    heights = gaussian_kde(draws)(values)
    half = WIDTH / 2 * heights / heights.max()
    ax.fill_betweenx(values, at - half, at + half, color=colour, alpha=0.55, linewidth=0.6)
    ax.plot([at, at], [lower, upper], **INTERVAL)
    ax.plot(at, median, **MEDIAN)
    inside = bool(lower <= observed <= upper)
    head = (channel.name, channel.quantity, channel.segment)
    rows: list[tuple] = [
        (*head, item, value, np.nan, None)
        for item, value in (("median", median), ("lower95", lower), ("upper95", upper))
    ]
    rows += [(*head, "density", v, h, None) for v, h in zip(values, heights, strict=True)]
    if np.isfinite(observed):
        ax.plot(at, observed, **(INSIDE if inside else OUTSIDE))
        rows.append((*head, "observed", float(observed), np.nan, inside))
    return rows


def _padded(rows: list[tuple]) -> tuple[float, float]:
    """Limits that leave violins the middle third: few channels on their own axis need no more."""
    values = [row[4] for row in rows]
    low, high = min(values), max(values)
    return low - (high - low), high + (high - low)
