"""The measured strains of one subject on bullseyes."""

from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from regional_lv import aha
from regional_lv.criticism.case_posterior import SOURCES
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.measured import read_measured
from regional_lv.plots import bullseye, style
from regional_lv.quantities import QUANTITIES


@style.context
def draw(
    measured: str | Path,
    subject: str,
    source: str,
    parameters: StiffnessInputs,
    png: Path,
    csv: Path,
) -> None:
    """Draw a bullseye for each measured strain, a row for each load, the full one first.

    measured: table of `subject`; source: `subjects.<name>.source` of the config. Numbers are per
    cent; segments that were not measured are grey. The table: subject, output, quantity, segment,
    load_fraction, value and sd (fractions).
    """
    table = read_measured(measured, strain_exponent=None)
    strains = table[[QUANTITIES[name].is_strain for name in table["quantity"]]]
    directions = list(dict.fromkeys(strains["quantity"]))
    loads = sorted(strains["load_fraction"].unique(), reverse=True)
    fig = style.figure(3.1 * max(len(directions), 1), 3.6 * max(len(loads), 1) + 0.7)
    axes = fig.subplots(max(len(loads), 1), max(len(directions), 1), squeeze=False)
    for column, direction in zip(axes.T, directions, strict=False):
        part = strains[strains["quantity"] == direction]
        norm = limits(part)
        for ax, load in zip(column, loads, strict=True):
            scale = paint(ax, part[part["load_fraction"] == load], norm, parameters)
            ax.set_title(f"{direction}{style.load_label(load)}", pad=2)
        add_scale(fig, scale, list(column))
    if strains.empty:
        axes[0, 0].text(0, 0, "no strain was measured", ha="center")
        bullseye.frame(axes[0, 0])
    style.suptitle(fig, f"Measured strains: {subject} - {SOURCES[source]}")
    columns = ["output", "quantity", "segment", "load_fraction", "value", "sd"]
    written = strains[columns].copy()
    written.insert(0, "subject", subject)
    style.save(fig, written, png, csv)


def limits(rows: pd.DataFrame) -> Normalize:
    """Colours from the smallest to the largest strain (per cent) of a measured table's `rows`."""
    return Normalize(100 * rows["value"].min(), 100 * rows["value"].max())


def paint(
    ax: Axes, rows: pd.DataFrame, norm: Normalize, parameters: StiffnessInputs
) -> ScalarMappable:
    """A bullseye of the strains of `rows`, one direction and one load of a measured table, in per
    cent; segments without a row are grey. Return the colour scale."""
    strains = rows.set_index("segment")["value"].reindex([s.number for s in aha.SEGMENTS])
    values = 100 * strains.to_numpy(float)
    labels = [f"{v:.0f}" if np.isfinite(v) else "" for v in values]
    with matplotlib.rc_context({"font.size": 8}):
        return bullseye.paint_values(ax, values, norm, "cividis", labels, parameters)


def add_scale(fig: Figure, scale: ScalarMappable, axes: list[Axes]) -> None:
    """The bar that says what the colours of the bullseyes `axes` mean."""
    fig.colorbar(scale, ax=axes, location="bottom", shrink=0.8, label="strain (%)")
