"""The left ventricle and its zones, in 3-D and as a bullseye (the paper's Figure 1)."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyvista

from regional_lv import aha
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.plots import bullseye, heart, style

SUBDIVISION = 4
"""Straight-edged cells per edge of a quadratic element."""


@style.context
def draw(mesh: Path, parameters: StiffnessInputs, png: Path, csv: Path) -> None:
    """Draw the mesh `mesh` (VTU, mm) whole, cut open, and as a bullseye with segment numbers.

    The table holds, per segment: zone, colour, number of elements and place in the bullseye.
    Raises InputError if the mesh has no hexahedra with segment numbers.
    """
    grid = heart.straight_cells(mesh, SUBDIVISION)
    fig = style.figure(11.0, 4.6)
    left, middle, right = fig.subplots(1, 3, width_ratios=[1, 1, 1.25])
    for ax, title, shown in ((left, "Whole", grid), (middle, "Cut open", heart.cut(grid))):
        ax.imshow(picture(shown, parameters))
        ax.set_title(title)
        ax.set_axis_off()

    zone = [parameters.zone_of(s.number) for s in aha.SEGMENTS]
    numbers = [str(s.number) for s in aha.SEGMENTS]
    bullseye.paint(right, [parameters.colours[z] for z in zone], numbers, parameters)
    right.set_title("AHA segments, seen from the apex", pad=2)
    if len(parameters.zones) < len(aha.SEGMENTS):
        for name, shape in bullseye.zone_shapes(parameters).items():
            bullseye.name(right, style.zone_label(name), shape)
    bullseye.frame(right, bullseye.NAMED)
    style.save(fig, _table(grid, parameters), png, csv)


def picture(grid: pyvista.UnstructuredGrid, parameters: StiffnessInputs) -> np.ndarray:
    """The grid with the colours of its zones."""
    colours = [pyvista.Color(colour).int_rgb for colour in parameters.colours.values()]
    zone = parameters.segment_zone[np.asarray(grid.cell_data["segment"]) - 1]
    return heart.render(grid, np.array(colours)[zone])


def _table(grid: pyvista.UnstructuredGrid, parameters: StiffnessInputs) -> pd.DataFrame:
    rows = []
    for segment, cell in zip(aha.SEGMENTS, bullseye.SEGMENT_CELLS, strict=True):
        inside = grid.cell_data["segment"] == segment.number
        rows.append(
            {
                "segment": segment.number,
                "name": segment.name,
                "zone": parameters.zone_of(segment.number),
                "colour": parameters.colours[parameters.zone_of(segment.number)],
                "elements": len(np.unique(grid.cell_data["element"][inside])),
                "bullseye_inner_radius": cell.inner,
                "bullseye_outer_radius": cell.outer,
                "bullseye_start_deg": cell.start,
                "bullseye_stop_deg": cell.stop,
            }
        )
    return pd.DataFrame(rows)
