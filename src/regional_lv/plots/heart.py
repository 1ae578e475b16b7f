"""Pictures of the left ventricle's mesh in three dimensions, for the figures that show it."""

from pathlib import Path

import numpy as np
import pyvista
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from vtkmodules.vtkCommonDataModel import vtkHexahedron, vtkTriQuadraticHexahedron

from regional_lv.errors import InputError

VIEW_ANGLE_DEG = -75.0
"""Direction from which the heart is seen: on the border of anterior and lateral wall."""

TILT_DEG = 20.0
"""How far the viewer stands above the base plane's horizon."""

LINE_COLOUR = "#F7F7F7"
PIXELS = (900, 1150)
OVERSAMPLING = 2
"""The picture is drawn this many times as fine and averaged, which smooths its edges."""

LIGHT_DEG = 25.0
"""How far the light stands above the viewer: the wall and the base plane are equally bright."""

AMBIENT, DIFFUSE = 0.6, 0.55
TUBE_SIDES = 6
LIFT_MM = 3.0
"""Lines are sorted as if they were so much nearer, so that they lie on the faces they run along;
less than a wall is thick."""

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
    surface = _facing(grid.extract_surface(algorithm="dataset_surface").triangulate())
    parts = [_triangles(surface, surface.cell_data["rgb"])]
    for of, radius in ({"segment": 0.32} if borders is None else borders).items():
        found = borders_of(surface, of)
        if found.n_cells:
            tube = found.tube(radius=radius, n_sides=TUBE_SIDES).triangulate()
            light = np.tile(255 * np.array(to_rgb(LINE_COLOUR)), (tube.n_cells, 1))
            parts.append(_triangles(tube, light, LIFT_MM))
    if lines is not None:
        tube = lines.tube(radius=0.3, n_sides=TUBE_SIDES).triangulate()
        colour = tube.point_data["rgb"][tube.regular_faces].mean(axis=1)
        parts.append(_triangles(tube, colour, LIFT_MM))
    triangles, colours = (np.concatenate(part) for part in zip(*parts, strict=True))
    return _paint(triangles, colours, grid.points @ _axes()[:2].T)


def _axes() -> np.ndarray:
    """Unit vectors (3, 3) of the picture as rows: to the right, upwards, towards the viewer."""
    tilt, around, vertical = np.radians(TILT_DEG), _towards_viewer(), np.array([0.0, 0.0, 1.0])
    across = np.array([-around[1], around[0], 0.0])
    up = np.cos(tilt) * vertical - np.sin(tilt) * around
    return np.array([across, up, np.cos(tilt) * around + np.sin(tilt) * vertical])


def _facing(surface: pyvista.PolyData) -> pyvista.PolyData:
    """The triangles of a closed surface, with their cell data, that face the viewer."""
    outwards = surface.compute_normals(point_normals=False, auto_orient_normals=True)
    seen = outwards.cell_data["Normals"] @ _axes()[2] > 0
    part = pyvista.PolyData.from_regular_faces(outwards.points, outwards.regular_faces[seen])
    for name, values in outwards.cell_data.items():
        part.cell_data[name] = values[seen]
    return part


def _triangles(
    surface: pyvista.PolyData, rgb: np.ndarray, lift: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """A surface's triangles (n, 3, 3) in the picture's axes, and their colours (n, 3; 0-1).

    rgb: (n, 3; 0-255). lift: how much nearer to the viewer they are taken to be (mm). A face that
    is turned away from the light is darker.
    """
    corners = surface.points[surface.regular_faces] @ _axes().T
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    light = np.array([0, np.sin(np.radians(LIGHT_DEG)), np.cos(np.radians(LIGHT_DEG))])
    facing = np.maximum(normal @ light, 0) / np.where(length > 0, length, 1.0)
    bright = np.minimum(1, AMBIENT + DIFFUSE * facing)
    return corners + np.array([0, 0, lift]), bright[:, None] * np.asarray(rgb) / 255


def _paint(triangles: np.ndarray, colours: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Picture (h, w, 3; 0-255) of the triangles (n, 3, 3), the nearest drawn last.

    seen: points (m, 2) in the picture's plane that it holds, in the middle and as large as fits.
    """
    # Drawn here and not by VTK: that needs the system's libEGL, which a server or a container
    # lacks. The projection is parallel and the triangles are small, so that sorting them by depth
    # hides what is hidden.
    low, high = seen.min(axis=0), seen.max(axis=0)
    half = 0.52 * max(high[1] - low[1], (high[0] - low[0]) * PIXELS[1] / PIXELS[0])
    order = np.argsort(triangles[:, :, 2].mean(axis=1))
    figure = Figure(figsize=PIXELS, dpi=OVERSAMPLING)
    canvas = FigureCanvasAgg(figure)
    ax = figure.add_axes((0, 0, 1, 1))
    ax.set_axis_off()
    ax.set_ylim((low + high)[1] / 2 + half * np.array([-1, 1]))
    ax.set_xlim((low + high)[0] / 2 + half * PIXELS[0] / PIXELS[1] * np.array([-1, 1]))
    # An edge in the face's colour, a pixel wide, closes the seams between neighbours.
    ax.add_collection(
        PolyCollection(
            list(triangles[order, :, :2]),
            facecolors=colours[order],
            edgecolors=colours[order],
            linewidths=72 / OVERSAMPLING,
            antialiased=False,
        ),
        autolim=False,
    )
    canvas.draw()
    n, (width, height) = OVERSAMPLING, PIXELS
    fine = np.asarray(canvas.buffer_rgba())[..., :3].reshape(height, n, width, n, 3)
    return fine.mean(axis=(1, 3)).round().astype(np.uint8)
