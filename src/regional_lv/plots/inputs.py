"""What a study is given: the heart with its segments, and the measured strains on bullseyes."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes

from regional_lv import aha
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.plots import bullseye, heart, measured_strains, style
from regional_lv.plots.zones import picture
from regional_lv.quantities import QUANTITIES

SUBDIVISION = 3
"""Straight-edged cells per edge of a quadratic element."""

OF_THE_HEART = 2
"""Columns that show the heart itself."""


@style.context
def draw(
    mesh: Path, tables: Mapping[str, pd.DataFrame], parameters: StiffnessInputs, png: Path
) -> None:
    """Draw the mesh `mesh` (VTU, mm) cut open, the numbers of its segments, and of every subject a
    row of bullseyes: its strains at end diastole, one per direction, in percent.

    tables: measured tables (as of `read_measured`) by subject.
    """
    directions = [name for name, kind in QUANTITIES.items() if kind.is_strain]
    rows, columns = max(1, len(tables)), OF_THE_HEART + len(directions)
    fig = style.figure(3.0 * columns, 3.6 * rows)
    axes = fig.subplots(rows, columns, squeeze=False)
    for ax in axes.ravel():
        ax.set_axis_off()
    _heart(axes[0, 0], mesh, parameters)
    zones = [parameters.zone_of(segment.number) for segment in aha.SEGMENTS]
    numbers = [str(segment.number) for segment in aha.SEGMENTS]
    colours = [parameters.colours[zone] for zone in zones]
    bullseye.paint(axes[0, 1], colours, numbers, parameters)
    bullseye.name_walls(axes[0, 1])
    axes[0, 1].set_title("AHA segments, seen from the apex")
    for row, (subject, table) in zip(axes, tables.items(), strict=False):
        full = table[table["load_fraction"] == 1]
        volume = full.loc[full["quantity"] == "volume", "value"]
        head = subject if volume.empty else f"{subject}, {volume.iloc[0]:.0f} mL"
        for ax, direction in zip(row[OF_THE_HEART:], directions, strict=True):
            own = full[full["quantity"] == direction]
            scale = measured_strains.paint(ax, own, measured_strains.limits(own), parameters)
            bullseye.name_walls(ax)
            ax.set_title(f"{head}\n{direction} strain{'' if len(own) else ' not measured'}")
            if len(own):
                measured_strains.add_scale(fig, scale, [ax])
    fig.savefig(png, dpi=style.DPI, format="png", facecolor="white", metadata={"Software": None})


def _heart(ax: Axes, mesh: Path, parameters: StiffnessInputs) -> None:
    grid = heart.cut(heart.straight_cells(mesh, SUBDIVISION))
    ax.imshow(picture(grid, parameters))
    ax.set_title("Unloaded heart, cut open")
