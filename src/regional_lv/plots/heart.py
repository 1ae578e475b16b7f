"""Pictures of the left ventricle's mesh in three dimensions, for the figures that show it."""

from ctypes import CDLL
from pathlib import Path

import numpy as np
import pyvista
from vtkmodules.vtkCommonDataModel import vtkHexahedron, vtkTriQuadraticHexahedron

from regional_lv.errors import InputError

VIEW_ANGLE_DEG = -75.0
"""Direction from which the heart is seen: on the border of anterior and lateral wall."""

TILT_DEG = 20.0
"""How far the viewer stands above the base plane's horizon."""

LINE_COLOUR = "#F7F7F7"
PIXELS = (900, 1150)

HEXAHEDRA = {
    pyvista.CellType.TRIQUADRATIC_HEXAHEDRON: vtkTriQuadraticHexahedron,
    pyvista.CellType.HEXAHEDRON: vtkHexahedron,
}
"""Cells that a mesh of the wall can have: those of the meshes made here, and those of an imported
mesh that was kept."""


def straight_cells(
    mesh: str | Path, subdivision: int, linear: int = 1, moved: bool = False
) -> pyvista.UnstructuredGrid:
    """The mesh's 27-node hexahedra as subdivision^3 eight-node hexahedra each, or its eight-node
    hexahedra, which have straight edges, as linear^3 each.

    So many straight edges per curved one make curved walls look curved. Cell data: `segment`,
    `element` (number of the mesh's cell), `part` (0 ... subdivision^3 - 1, the last reference
    coordinate fastest), and `depth` in the wall if the mesh has it. With `moved`, nodes are moved
    by the mesh's point data `displacement`.
    Raises InputError if the mesh has no hexahedra with segment numbers.
    """
    source = pyvista.read(mesh)
    kind = solid_type(source)
    if kind is None or "segment" not in source.cell_data:
        raise InputError(f"{mesh}: no hexahedra with cell data `segment`; make the mesh again")
    if kind == pyvista.CellType.HEXAHEDRON:
        subdivision = linear
    nodes, is_solid = source.cells_dict[int(kind)], source.celltypes == kind
    reference = np.array(HEXAHEDRA[kind]().GetParametricCoords()).reshape(-1, 3)
    segment = np.asarray(source.cell_data["segment"])[is_solid].astype(int)

    places = source.points + source.point_data["displacement"] if moved else source.points

    n = subdivision + 1
    ticks = np.linspace(0, 1, n)
    local = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    points = np.einsum("pk,ekd->epd", _shape_functions(local, reference), places[nodes])

    i, j, k = (a.ravel() for a in np.meshgrid(*[np.arange(subdivision)] * 3, indexing="ij"))
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
    cells = (hexes[None] + (np.arange(len(nodes)) * n**3)[:, None, None]).reshape(-1, 8)
    grid = pyvista.UnstructuredGrid(
        {pyvista.CellType.HEXAHEDRON: cells}, points.reshape(-1, 3).astype(float)
    )
    grid.cell_data["segment"] = np.repeat(segment, subdivision**3)
    if "transmural" in source.point_data:
        depth = source.point_data["transmural"][nodes] @ _shape_functions(local, reference).T
        grid.cell_data["depth"] = depth[:, hexes].mean(axis=-1).ravel()
    grid.cell_data["element"] = np.repeat(np.arange(len(nodes)), subdivision**3)
    grid.cell_data["part"] = np.tile(np.arange(subdivision**3), len(nodes))
    return grid.clean(tolerance=1e-4)


def solid_type(mesh: pyvista.UnstructuredGrid) -> pyvista.CellType | None:
    """The type of the wall's cells, or None if they are not hexahedra."""
    return next((kind for kind in HEXAHEDRA if int(kind) in mesh.cells_dict), None)


def _shape_functions(local: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Values (p, n) of the shape functions of a hexahedron at local points (p, 3) in [0, 1]^3.

    nodes: local coordinates (n, 3) of its 8 or 27 nodes, in VTK's order. Interpolating the
    monomials there gives the functions in the same order.
    """
    degrees = np.arange(round(len(nodes) ** (1 / 3)))

    def monomials(x: np.ndarray) -> np.ndarray:
        powers = x[:, :, None] ** degrees
        return np.einsum("pi,pj,pk->pijk", *powers.transpose(1, 0, 2)).reshape(len(x), len(nodes))

    return monomials(local) @ np.linalg.inv(monomials(nodes))


def cut(grid: pyvista.UnstructuredGrid) -> pyvista.UnstructuredGrid:
    """Without the half that faces the viewer."""
    # A tenth of a millimetre behind the axis: where segments end in the plane itself, the cut would
    # show pieces of both.
    normal = _towards_viewer()
    return grid.clip(normal=normal, origin=-0.1 * normal, invert=True)


def is_kept(points: np.ndarray) -> np.ndarray:
    """Mask (n,) of the points (n, 3) in the half that `cut` leaves."""
    return points @ _towards_viewer() <= -0.1


def _towards_viewer() -> np.ndarray:
    """Horizontal direction from the heart to the viewer."""
    angle = np.radians(VIEW_ANGLE_DEG)
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def _require_rendering() -> None:
    """Raise InputError where VTK finds nothing to draw with, and would end the process."""
    try:
        CDLL("libEGL.so.1")
    except OSError as error:
        raise InputError(
            "pictures in three dimensions need the system's libEGL; install the package libegl1 "
            "(Debian, Ubuntu) or mesa-libEGL (Fedora)"
        ) from error


def borders_of(surface: pyvista.PolyData, of: str) -> pyvista.PolyData:
    """Edges between faces whose cell data `of` differ."""
    faces = surface.regular_faces
    edges = np.sort(np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    number = np.tile(np.asarray(surface.cell_data[of]), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, number = edges[order], number[order]
    same = (edges[1:] == edges[:-1]).all(axis=1) & (number[1:] != number[:-1])
    lines = edges[1:][same]
    return pyvista.PolyData(surface.points, lines=np.insert(lines, 0, 2, axis=1).ravel())


def render(
    grid: pyvista.UnstructuredGrid,
    rgb: np.ndarray,
    borders: dict[str, float] | None = None,
    lines: pyvista.PolyData | None = None,
) -> np.ndarray:
    """Picture (h, w, 3) of the grid, cells coloured by `rgb` (cells, 3; 0-255), base up.

    borders: cell data (`segment`, `element`) -> radius in mm of the light lines where it changes;
    default: the segments'. lines: drawn on top, coloured by their point data `rgb`.
    """
    grid = grid.copy()
    grid.cell_data["rgb"] = np.asarray(rgb, dtype=np.uint8)
    surface = grid.extract_surface(algorithm="dataset_surface").triangulate()
    _require_rendering()
    plotter = pyvista.Plotter(off_screen=True, window_size=PIXELS)
    plotter.background_color = "white"
    plotter.add_mesh(surface, scalars="rgb", rgb=True, ambient=0.55, diffuse=0.5, specular=0.05)
    for of, radius in ({"segment": 0.32} if borders is None else borders).items():
        found = borders_of(surface, of)
        if found.n_cells:
            plotter.add_mesh(found.tube(radius=radius), color=LINE_COLOUR, ambient=0.6)
    if lines is not None:
        plotter.add_mesh(lines.tube(radius=0.3), scalars="rgb", rgb=True, ambient=0.6)
    tilt, around = np.radians(TILT_DEG), _towards_viewer()
    across = np.array([-around[1], around[0], 0.0])
    up = np.cos(tilt) * np.array([0, 0, 1.0]) - np.sin(tilt) * around
    towards = np.cos(tilt) * around + np.sin(tilt) * np.array([0, 0, 1.0])
    # What is seen of the grid, in the middle and as large as fits.
    seen = grid.points @ np.column_stack([across, up])
    low, high = seen.min(axis=0), seen.max(axis=0)
    focus = np.array([across, up]).T @ (low + high) / 2
    width, height = high - low
    plotter.camera.parallel_projection = True
    plotter.camera.focal_point = focus
    plotter.camera.position = focus + 400 * towards
    plotter.camera.up = (0, 0, 1)
    plotter.camera.parallel_scale = 0.52 * max(height, width * PIXELS[1] / PIXELS[0])
    plotter.camera.clipping_range = (1, 1000)
    plotter.enable_anti_aliasing("ssaa")
    picture = plotter.screenshot(return_img=True)
    plotter.close()
    return picture
