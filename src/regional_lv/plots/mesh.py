"""The mesh cut open: its elements, the depth in the wall, and the fibres."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyvista
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from regional_lv.plots import heart, style
from regional_lv.plots.zones import SUBDIVISION

FIBRE_MM = 3.0
"""Length of the lines along the fibres."""

GREY_RGB = (200, 200, 200)


@style.context
def draw(mesh: Path, png: Path, csv: Path) -> None:
    """Draw the mesh `mesh` (VTU, mm) cut open: elements by depth, and fibres by helix angle.

    The table has a row per node: x_mm, y_mm, z_mm, depth (0 endocardium, 1 epicardium), helix_deg.
    Raises InputError if the mesh has no hexahedra with segment numbers.
    """
    whole = heart.straight_cells(mesh, SUBDIVISION)
    # Whole elements are kept: a plane would cut slivers off those along it.
    element = whole.cell_data["element"]
    behind = heart.is_kept(whole.cell_centers().points)
    kept = pd.Series(behind).groupby(element).transform("mean") > 0.5
    elements, grid = whole.extract_cells(kept.to_numpy()), heart.cut(whole)
    source = pyvista.read(mesh)
    data = source.point_data
    fibre = np.asarray(data["fibre"])
    along, around = (
        (fibre * data[d]).sum(axis=1) for d in ("longitudinal_direction", "circumferential")
    )
    table = pd.DataFrame(source.points, columns=["x_mm", "y_mm", "z_mm"])
    table["depth"], table["helix_deg"] = data["transmural"], np.degrees(np.arctan2(along, around))

    fig = style.figure(8.4, 5.4)
    left, right = fig.subplots(1, 2)
    depth = ScalarMappable(Normalize(0, 1), "cividis")
    rgb = 255 * depth.to_rgba(elements.cell_data["depth"])[:, :3]
    left.imshow(heart.render(elements, rgb, {"element": 0.16}))
    linear = heart.solid_type(source) == pyvista.CellType.HEXAHEDRON
    left.set_title(f"{'Linear' if linear else 'Quadratic'} hexahedra")
    fig.colorbar(depth, ax=left, location="bottom", shrink=0.8).set_label(
        "depth in the wall (0 endocardium, 1 epicardium)"
    )
    limit = table["helix_deg"].abs().max()
    helix = ScalarMappable(Normalize(-limit, limit), "coolwarm")
    inner = np.flatnonzero((table["depth"] < 1e-6) & heart.is_kept(source.points))
    colour = (255 * helix.to_rgba(table["helix_deg"])[:, :3]).astype(np.uint8)
    middle, half = source.points[inner], FIBRE_MM / 2 * fibre[inner]
    ends = np.stack([middle - half, middle + half], axis=1).reshape(-1, 3)
    lines = np.column_stack([np.full(len(inner), 2), np.arange(len(ends)).reshape(-1, 2)])
    drawn = pyvista.PolyData(ends, lines=lines.ravel())
    drawn.point_data["rgb"] = np.repeat(colour[inner], 2, axis=0)
    grey = np.tile(GREY_RGB, (grid.n_cells, 1))
    right.imshow(heart.render(grid, grey, lines=drawn))
    right.set_title("Fibres of the endocardium")
    fig.colorbar(helix, ax=right, location="bottom", shrink=0.8, label="helix angle (degrees)")
    for ax in (left, right):
        ax.set_axis_off()
    style.save(fig, table, png, csv)
