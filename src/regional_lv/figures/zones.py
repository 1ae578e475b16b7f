"""The left ventricle and its five zones, in 3-D and as a bullseye (the paper's Figure 1)."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyvista

from regional_lv import aha
from regional_lv.figures import bullseye, heart, style

SUBDIVISION = 4
"""Straight-edged cells per edge of a quadratic element."""


@style.context
def draw(mesh: Path, png: Path, csv: Path) -> None:
    """Draw the mesh `mesh` (VTU, mm) whole, cut open, and as a bullseye with segment numbers.

    The table holds, per segment: zone, colour, number of elements and place in the bullseye.
    Raises InputError if the mesh has no quadratic hexahedra with segment numbers.
    """
    grid = heart.straight_cells(mesh, SUBDIVISION)
    fig = style.figure(11.0, 4.6)
    left, middle, right = fig.subplots(1, 3, width_ratios=[1, 1, 1.25])
    for ax, title, picture in (
        (left, "Whole", _picture(grid)),
        (middle, "Cut open", _picture(heart.cut(grid))),
    ):
        ax.imshow(picture)
        ax.set_title(title)
        ax.set_axis_off()

    colours = [aha.ZONE_COLOURS[s.zone] for s in aha.SEGMENTS]
    bullseye.paint(right, colours, [str(s.number) for s in aha.SEGMENTS])
    right.set_title("AHA segments, seen from the apex", pad=2)
    for zone, (x, y, rotation) in {
        "anterior": (0, 1.07, 0),
        "inferior": (0, -1.07, 0),
        "lateral": (1.07, 0, -90),
        "septal": (-1.07, 0, 90),
    }.items():
        right.text(x, y, zone, ha="center", va="center", rotation=rotation)
    right.text(0, 0.12, "apical", ha="center", va="center")
    bullseye.frame(right, margin=0.17)
    style.save(fig, _table(grid), png, csv)


def _picture(grid: pyvista.UnstructuredGrid) -> np.ndarray:
    """The grid with the colours of its zones."""
    colours = [pyvista.Color(aha.ZONE_COLOURS[zone]).int_rgb for zone in aha.ZONES]
    zone = aha.SEGMENT_ZONE[np.asarray(grid.cell_data["segment"]) - 1]
    return heart.render(grid, np.array(colours)[zone])


def _table(grid: pyvista.UnstructuredGrid) -> pd.DataFrame:
    rows = []
    for segment, cell in zip(aha.SEGMENTS, bullseye.SEGMENT_CELLS, strict=True):
        inside = grid.cell_data["segment"] == segment.number
        rows.append(
            {
                "segment": segment.number,
                "name": segment.name,
                "zone": segment.zone,
                "colour": aha.ZONE_COLOURS[segment.zone],
                "elements": len(np.unique(grid.cell_data["element"][inside])),
                "bullseye_inner_radius": cell.inner,
                "bullseye_outer_radius": cell.outer,
                "bullseye_start_deg": cell.start,
                "bullseye_stop_deg": cell.stop,
            }
        )
    return pd.DataFrame(rows)
