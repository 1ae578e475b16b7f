"""The left ventricle and its five zones, in 3-D and as a bullseye (the paper's Figure 1)."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyvista
from vtkmodules.vtkCommonDataModel import vtkTriQuadraticHexahedron

from regional_lv import aha
from regional_lv.errors import InputError
from regional_lv.figures import bullseye, style

SUBDIVISION = 4
"""Straight-edged cells per edge of a quadratic element, so that curved walls look curved."""

VIEW_ANGLE_DEG = -75.0
"""Direction from which the heart is seen: on the border of anterior and lateral wall."""

LINE_COLOUR = "#F7F7F7"


@style.context
def draw(mesh: Path, png: Path, csv: Path) -> None:
    """Draw the mesh `mesh` (VTU, mm) whole, cut open, and as a bullseye with segment numbers.

    The table holds, per segment: zone, colour, number of elements and place in the bullseye.
    Raises InputError if the mesh has no quadratic hexahedra with segment numbers.
    """
    grid = straight_cells(mesh)
    fig = style.figure(11.0, 4.6)
    left, middle, right = fig.subplots(1, 3, width_ratios=[1, 1, 1.25])
    for ax, title, picture in (
        (left, "Whole", _render(grid)),
        (middle, "Cut open", _render(_cut(grid))),
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


def straight_cells(mesh: Path) -> pyvista.UnstructuredGrid:
    """The mesh's 27-node hexahedra as SUBDIVISION^3 eight-node hexahedra each, with `segment`."""
    source = pyvista.read(mesh)
    quadratic = source.cells_dict.get(int(pyvista.CellType.TRIQUADRATIC_HEXAHEDRON))
    if quadratic is None or "segment" not in source.cell_data:
        raise InputError(f"{mesh}: no 27-node hexahedra with cell data `segment`; remake the mesh")
    is_solid = source.celltypes == pyvista.CellType.TRIQUADRATIC_HEXAHEDRON
    segment = np.asarray(source.cell_data["segment"])[is_solid].astype(int)

    n = SUBDIVISION + 1
    ticks = np.linspace(0, 1, n)
    local = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    points = np.einsum("pk,ekd->epd", _shape_functions(local), source.points[quadratic])

    i, j, k = (a.ravel() for a in np.meshgrid(*[np.arange(SUBDIVISION)] * 3, indexing="ij"))
    corner = [
        (0, 0, 0),
        (1, 0, 0),
        (1, 1, 0),
        (0, 1, 0),
        (0, 0, 1),
        (1, 0, 1),
        (1, 1, 1),
        (0, 1, 1),
    ]
    hexes = np.column_stack([((i + a) * n + j + b) * n + k + c for a, b, c in corner])
    cells = (hexes[None] + (np.arange(len(quadratic)) * n**3)[:, None, None]).reshape(-1, 8)
    grid = pyvista.UnstructuredGrid(
        {pyvista.CellType.HEXAHEDRON: cells}, points.reshape(-1, 3).astype(float)
    )
    grid.cell_data["segment"] = np.repeat(segment, SUBDIVISION**3)
    grid.cell_data["element"] = np.repeat(np.arange(len(quadratic)), SUBDIVISION**3)
    return grid.clean(tolerance=1e-4)


def _shape_functions(local: np.ndarray) -> np.ndarray:
    """Values (p, 27) of the triquadratic shape functions at local points (p, 3) in [0, 1]^3.

    VTK names its 27 nodes by their local coordinates; interpolating the monomials there gives
    the functions in VTK's own order.
    """
    nodes = np.array(vtkTriQuadraticHexahedron().GetParametricCoords()).reshape(27, 3)

    def monomials(x: np.ndarray) -> np.ndarray:
        powers = x[:, :, None] ** np.arange(3)
        return np.einsum("pi,pj,pk->pijk", *powers.transpose(1, 0, 2)).reshape(len(x), 27)

    return monomials(local) @ np.linalg.inv(monomials(nodes))


def _cut(grid: pyvista.UnstructuredGrid) -> pyvista.UnstructuredGrid:
    """Without the half that faces the viewer."""
    angle = np.radians(VIEW_ANGLE_DEG)
    normal = (np.cos(angle), np.sin(angle), 0.0)
    return grid.clip(normal=normal, origin=(0, 0, 0), invert=True)


def _borders(surface: pyvista.PolyData) -> pyvista.PolyData:
    """Edges between faces of two segments."""
    faces = surface.regular_faces
    edges = np.sort(np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    segment = np.tile(np.asarray(surface.cell_data["segment"]), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, segment = edges[order], segment[order]
    same = (edges[1:] == edges[:-1]).all(axis=1) & (segment[1:] != segment[:-1])
    lines = edges[1:][same]
    return pyvista.PolyData(surface.points, lines=np.insert(lines, 0, 2, axis=1).ravel())


def _render(grid: pyvista.UnstructuredGrid) -> np.ndarray:
    """Picture (h, w, 3) of the grid with zone colours and light segment borders, base up."""
    surface = grid.extract_surface(algorithm="dataset_surface").triangulate()
    zone = aha.SEGMENT_ZONE[np.asarray(surface.cell_data["segment"]) - 1]
    rgb = np.array([pyvista.Color(aha.ZONE_COLOURS[z]).int_rgb for z in aha.ZONES], dtype=np.uint8)
    plotter = pyvista.Plotter(off_screen=True, window_size=(900, 1100))
    plotter.background_color = "white"
    shaded = surface.copy()
    shaded.cell_data["rgb"] = rgb[zone]
    plotter.add_mesh(shaded, scalars="rgb", rgb=True, ambient=0.5, diffuse=0.55, specular=0.05)
    borders = _borders(surface)
    if borders.n_cells:
        plotter.add_mesh(borders.tube(radius=0.32), color=LINE_COLOUR, ambient=0.6)
    angle, tilt = np.radians(VIEW_ANGLE_DEG), np.radians(20)
    towards = (np.cos(tilt) * np.cos(angle), np.cos(tilt) * np.sin(angle), np.sin(tilt))
    low, high = np.array(grid.bounds)[::2], np.array(grid.bounds)[1::2]
    focus = np.array([0, 0, (low[2] + high[2]) / 2])
    plotter.camera.parallel_projection = True
    plotter.camera.focal_point = focus
    plotter.camera.position = focus + 400 * np.array(towards)
    plotter.camera.up = (0, 0, 1)
    plotter.camera.parallel_scale = 0.66 * (high[2] - low[2])
    plotter.camera.clipping_range = (1, 1000)
    plotter.enable_anti_aliasing("ssaa")
    picture = plotter.screenshot(return_img=True)
    plotter.close()
    return picture


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
