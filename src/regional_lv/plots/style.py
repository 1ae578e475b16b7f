"""Theme, colours, labels and saving, shared by every figure.

The theme is seaborn's `ticks` style at the size of its `paper` context. Colours are the Okabe-Ito
palette (https://jfly.uni-koeln.de/color/), which readers with a colour vision deficiency can tell
apart; zones have those of `StiffnessInputs.colours`.
"""

import textwrap
from collections.abc import Iterable, Sequence
from itertools import cycle
from pathlib import Path

import matplotlib.style
import numpy as np
import pandas as pd
import seaborn
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from regional_lv.channels import Channel
from regional_lv.mechanics.materials import MATERIALS

BLUE, ORANGE, GREEN = "#0072B2", "#E69F00", "#009E73"
VERMILLION, SKY, PINK = "#D55E00", "#56B4E9", "#CC79A7"
BLACK, GREY, LIGHT = "#000000", "#7F7F7F", "#D9D9D9"
OBSERVED = "#C1121F"

FACTOR_COLOURS = (BLUE, VERMILLION, GREEN, PINK, ORANGE, SKY)
QUANTITY_COLOURS = {
    "volume": PINK,
    "circumferential": SKY,
    "radial": GREEN,
    "longitudinal": ORANGE,
}
SCALE_COLOURS = {"natural": BLUE, "log": ORANGE}
CHAIN_COLOURS = (BLUE, ORANGE, GREEN, PINK)

ZONES_PER_ROW = 6
"""Panels beside each other in figures with a panel for each zone."""

DPI = 150

RC = {
    **seaborn.axes_style("ticks"),
    **seaborn.plotting_context("paper"),
    "axes.prop_cycle": cycler(color=seaborn.color_palette(FACTOR_COLOURS)),
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same letters on every machine
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.edgecolor": BLACK,
    "axes.labelcolor": BLACK,
    "text.color": BLACK,
    "xtick.color": BLACK,
    "ytick.color": BLACK,
    "grid.color": LIGHT,
    "grid.linewidth": 0.5,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "legend.title_fontsize": 8,
    "legend.frameon": False,
    "figure.titlesize": 12,
    "lines.linewidth": 1.2,
}

context = matplotlib.style.context(["default", RC])
"""Decorator of every `draw`: the style holds while the figure is made and leaks nowhere. All
that it does not set is as in matplotlib itself, whatever style the user has."""

BOXES: dict = {
    "linewidth": 0.8,
    "linecolor": BLACK,
    "saturation": 1,
    "boxprops": {"alpha": 0.6},
    "flierprops": {"marker": ".", "markersize": 4, "markeredgecolor": GREY},
}
"""Options of every `seaborn.boxplot`."""


def figure(width: float, height: float) -> Figure:
    """An empty figure of `width` by `height` inches that keeps its own labels from overlapping.

    Made without pyplot: no display, no window, nothing global that has to be closed.
    """
    return Figure(figsize=(width, height), layout="constrained")


def save(fig: Figure, table: pd.DataFrame, png: Path, csv: Path) -> None:
    """Write `fig` as PNG (150 dpi) and the numbers it shows, `table`, as CSV.

    The PNG names no software version and no date, so that equal figures are equal files.
    """
    for path in (png, csv):
        Path(path).parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(png, dpi=DPI, format="png", facecolor="white", metadata={"Software": None})
    table.to_csv(csv, index=False, float_format="%.8g")


def intervals(
    ax: Axes, table: pd.DataFrame, at: str, value: str, ends: Sequence[str], **options
) -> None:
    """Draw points at `value` with intervals that are known already, with `seaborn.pointplot`.

    at, value, ends: columns of `table`, of which `at` is categorical and `ends` are the lower and
    the upper end. seaborn makes intervals from samples: it gets value and ends as three samples,
    whose median is the value and whose range is the interval. options: of `pointplot`.
    """
    if "hue" in options and table[options["hue"]].nunique() == 1:
        options["dodge"] = False  # seaborn cannot dodge one group
    samples = pd.concat([table.assign(**{value: table[c]}) for c in (value, *ends)])
    options = {"linestyle": "none", "markersize": 4, "err_kws": {"linewidth": 1.2}} | options
    seaborn.pointplot(
        samples, x=at, y=value, ax=ax, estimator="median", errorbar=("pi", 100), **options
    )


def factor_colours(factors: Iterable[str]) -> dict[str, str]:
    """Factor -> colour, in the order of the factors: blue, vermillion, then others."""
    return dict(zip(factors, cycle(FACTOR_COLOURS), strict=False))


def quantity_colours(quantities: Iterable[str]) -> dict[str, str]:
    """Observed quantity -> colour: its own, or one that none of the others has."""
    more = cycle((BLUE, VERMILLION, GREY))
    return {name: QUANTITY_COLOURS.get(name) or next(more) for name in quantities}


def label(name: str) -> str:
    """`C_a_anterior` as a reader sees it, with the factor of a law as mathematics; names of noise
    scales likewise."""
    if name.startswith("sigma_"):
        return rf"$\sigma$ {name.removeprefix('sigma_')}"
    factors = {factor.name for law in MATERIALS for factor in MATERIALS[law].factors}
    for factor in sorted(factors, key=len, reverse=True):
        if name.startswith(f"{factor}_"):
            return f"{factor_label(factor)} {zone_label(name.removeprefix(f'{factor}_'))}"
    return name


def factor_label(factor: str) -> str:
    """`C_a` as mathematics."""
    letter, _, index = factor.partition("_")
    return f"${letter}_{{{index}}}$" if index else factor


def zone_label(zone: str) -> str:
    """A zone's name without underscores."""
    return zone.replace("_", " ")


def in_lines(text: str) -> str:
    """A label with a line for each word, for crowded axes."""
    return text.replace(" ", "\n")


def channel_title(channel: Channel) -> str:
    """What is observed: quantity, place unless it is a segment, and the load unless it is full."""
    place = "" if channel.segment or not channel.place else f" {channel.place}"
    return f"{channel.quantity}{place}{load_label(channel.load_fraction)}"


def load_label(fraction: float) -> str:
    """`` at end diastole, `, 50 % load` before."""
    return "" if fraction == 1 else f", {100 * fraction:g} % load"


def zone_places(zones: int, rows: int) -> tuple[tuple[int, int], np.ndarray]:
    """Where panels go if each zone has `rows` of them, one below the other.

    Returns rows and columns of the grid and, of each panel (rows, zones, 2), its row and column in
    it. More than ZONES_PER_ROW zones go on below.
    """
    across = min(zones, ZONES_PER_ROW)
    block, column = np.divmod(np.arange(zones), across)
    row = block * rows + np.arange(rows)[:, None]
    return (row.max() + 1, across), np.stack([row, np.broadcast_to(column, row.shape)], axis=-1)


def zone_panels(fig, zones: int, rows: int, **options) -> np.ndarray:
    """Axes (rows, zones) at `zone_places`; places that are left over stay empty.

    fig: a figure or a part of one; options: of its `subplots`.
    """
    shape, places = zone_places(zones, rows)
    axes = fig.subplots(*shape, squeeze=False, **options)
    found = axes[places[..., 0], places[..., 1]]
    for ax in set(axes.ravel()) - set(found.ravel()):
        ax.set_axis_off()
    return found


def plain_log(axis: Axis) -> None:
    """Ticks of a logarithmic axis at 1, 2 and 5 in each decade, written as plain numbers."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())


def suptitle(fig: Figure, text: str, warning: str = "") -> None:
    """Title of a figure, in lines that fit on it; a warning under it turns the whole title
    vermillion and bold."""
    width = int(9 * fig.get_figwidth())
    lines = [*textwrap.wrap(text, width), *textwrap.wrap(warning, width)]
    fig.suptitle(
        "\n".join(lines),
        color=VERMILLION if warning else BLACK,
        fontweight="bold" if warning else "normal",
    )
