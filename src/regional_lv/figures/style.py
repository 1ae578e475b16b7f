"""Colours, sizes and saving, shared by every figure.

Colours are the Okabe-Ito palette (https://jfly.uni-koeln.de/color/), which readers with a colour
vision deficiency can tell apart; the zones take theirs from `regional_lv.aha.ZONE_COLOURS`.
"""

import textwrap
from pathlib import Path

import matplotlib
import pandas as pd
from matplotlib.figure import Figure

from regional_lv import aha

BLUE, ORANGE, GREEN = "#0072B2", "#E69F00", "#009E73"
VERMILLION, SKY, PINK = "#D55E00", "#56B4E9", "#CC79A7"
BLACK, GREY, LIGHT = "#000000", "#7F7F7F", "#D9D9D9"
OBSERVED = "#C1121F"

STIFFNESS_COLOURS = {"C_a": BLUE, "C_b": VERMILLION}
SCALE_COLOURS = {"natural": BLUE, "log": ORANGE}
CHAIN_COLOURS = (BLUE, ORANGE, GREEN, PINK)

DPI = 150

RC = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same letters on every machine
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.labelsize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "figure.titlesize": 12,
    "lines.linewidth": 1.2,
}

context = matplotlib.rc_context(RC)
"""Decorator of every `draw`: the style holds while the figure is made and leaks nowhere."""


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


def parameter_label(name: str) -> str:
    """`C_a_anterior` as a reader sees it; names of noise scales likewise."""
    if name in aha.PARAMETERS:
        return f"${name[:3]}$ {name[4:]}"
    if name.startswith("sigma_"):
        return rf"$\sigma$ {name.removeprefix('sigma_')}"
    return name


def quantity_of(output: str) -> str:
    """`volume` or the strain's direction, of one of `aha.OUTPUTS`."""
    return output.split("_")[0]


def segment_of(output: str) -> int | None:
    """AHA segment number of one of `aha.OUTPUTS`, None for the volume."""
    return None if output == "volume_ml" else int(output.split("_")[1])


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
