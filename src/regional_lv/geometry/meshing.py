"""The mesh: the bullseye meshed by gmsh, extruded, and moved onto the surfaces."""

import logging
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pandas as pd

from regional_lv.aha import LEVELS, SEGMENTS
from regional_lv.geometry import structured
from regional_lv.geometry.elements import HEXAHEDRON_PARENTS, facet_cells, facet_normals
from regional_lv.geometry.mesh import BASE, ENDOCARDIUM, EPICARDIUM, SURFACES, Mesh
from regional_lv.geometry.surfaces import QUARTER, Wall
from regional_lv.geometry.table import with_joined_borders

log = logging.getLogger(__name__)

# The same hexahedron in gmsh's order.
GMSH_TO_VTK = np.array(
    [*range(8), 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15, 22, 23, 21, 24, 20, 25, 26]
)


SAME_LINE_DEG = 1e-3
"""Sector borders that are no further apart are one mesh line."""


def _grid_angles(table: pd.DataFrame, n: int) -> np.ndarray:
    """The n angles (degrees, increasing, from -180) of the mesh lines that run base to apex.

    All sector borders (16 at most), and equal divisions of the gaps between them: each further
    line goes to the gap whose divisions are widest.
    """
    sectors = table.iloc[:16]
    borders = np.concatenate([sectors["angle_from_deg"], sectors["angle_to_deg"]])
    borders = np.unique(np.round(np.round(borders + 180, 6) % 360 - 180, 6))
    # Levels whose borders differ by round-off share one line.
    borders = borders[np.diff(borders, prepend=borders[-1] - 360) > SAME_LINE_DEG]
    gaps = np.diff(borders, append=borders[0] + 360)
    count = np.ones(len(gaps), dtype=int)
    for _ in range(n - len(gaps)):
        count[np.argmax(np.round(gaps / count, 6))] += 1
    return np.concatenate(
        [b + g * np.arange(k) / k for b, g, k in zip(borders, gaps, count, strict=True)]
    )


def _rings(
    table: pd.DataFrame, endo_apex_z_mm: float, mesh: Mapping
) -> tuple[np.ndarray, list[str], float]:
    """(radii, levels, border) of the rings of nodes on the bullseye.

    radii from the patch's corners to the base (rows + 1,), the level between each two (rows,), and
    the radius of the border between apical level and apex.
    """
    z = [table["z_bottom_mm"].iloc[i] for i in (15, 11, 5)] + [0.0]
    borders = 1 - np.arcsin(np.array(z) / endo_apex_z_mm) / QUARTER
    half, apex = mesh["circumferential"] / 8, mesh["apex"]
    patch = borders[0] * half / (half + apex)
    radii, levels = [patch], []
    for level, outer in zip(("apex", "apical", "mid", "basal"), borders, strict=True):
        # Towards the held base, where strains change fast, rows get lower by a constant factor.
        heights = (mesh["basal_grading"] if level == "basal" else 1.0) ** np.arange(mesh[level])
        radii.extend(radii[-1] + (outer - radii[-1]) * np.cumsum(heights) / heights.sum())
        levels.extend([level] * mesh[level])
    return np.array(radii), levels, borders[0]


PATCH_ROUNDNESS = 0.4


def _patch_outline(angles: np.ndarray) -> tuple[int, np.ndarray]:
    """Index of the first of the patch's four corners, and the outline's radius at each angle.

    The corners have radius 1; between them it lies between the chord and the arc, so that the
    angles at the corners are near 120 degrees and the elements on both sides well shaped.
    """
    n = len(angles)
    quarter = n // 4
    spread = [
        np.ptp(np.concatenate([angles[i::quarter] - 90 * np.arange(4)])) for i in range(quarter)
    ]
    first = int(np.argmin(np.round(spread, 6)))
    side = np.append(angles[first::quarter], angles[first] + 360)
    radius = np.empty(n)
    for k, angle in enumerate(angles):
        angle = angle if angle >= angles[first] else angle + 360
        j = np.searchsorted(side, angle, side="right") - 1
        half = np.radians(side[j + 1] - side[j]) / 2
        off = np.radians(angle - side[j]) - half
        radius[k] = (1 - PATCH_ROUNDNESS) * np.cos(half) / np.cos(off) + PATCH_ROUNDNESS
    return first, radius


@cache
def load_gmsh() -> Any:
    """The library, or None where its wheel does not load: it needs X libraries, which bare machines
    lack."""
    try:
        import gmsh
    except OSError as error:
        log.info("gmsh cannot be loaded (%s); the same mesh is laid out without it", error)
        return None
    return gmsh


def _build_disk(
    gmsh: Any,
    table: pd.DataFrame,
    angles: np.ndarray,
    rings: np.ndarray,
    levels: Sequence[str],
    layers: int,
) -> int:
    """The bullseye in gmsh, extruded by 1 through the wall, meshed at order 2 and tagged."""
    geo = gmsh.model.geo
    n = len(angles)
    first, outline = _patch_outline(angles)
    radians = np.radians(angles)
    inner = len(levels) - levels.count("basal") - levels.count("mid") - levels.count("apical")
    points = []
    for k, ring in enumerate(rings):
        # Rows of the apex go over from the patch's outline to the circle.
        fraction = max(0.0, 1 - k / inner)
        radius = ring - fraction * rings[0] * (1 - outline)
        xy = np.stack([radius * np.cos(radians), radius * np.sin(radians)], axis=-1)
        points.append([geo.addPoint(x, y, 0.0) for x, y in xy])
    around = [[geo.addLine(p[i], p[(i + 1) % n]) for i in range(n)] for p in points]
    across = [[geo.addLine(a[i], b[i]) for i in range(n)] for a, b in pairwise(points)]
    volumes: dict[int, list[int]] = {s: [] for s in range(1, 18)}
    # Faces with the segment that each belongs to; the base's faces come last.
    faces, owners = [], []

    def add_face(loop: list[int], corners: list[int], segment: int) -> None:
        face = geo.addPlaneSurface([geo.addCurveLoop(loop)])
        geo.mesh.setTransfiniteSurface(face, cornerTags=corners)
        geo.mesh.setRecombine(2, face)
        faces.append(face)
        owners.append(segment)

    for curve in [c for group in (*around, *across) for c in group]:
        geo.mesh.setTransfiniteCurve(curve, 2)
    add_face(around[0], [points[0][first + k * n // 4] for k in range(4)], 17)
    middle = (angles + np.append(angles[1:], angles[0] + 360)) / 2
    for k, level in enumerate(levels):
        rows = table.loc[[s - 1 for s in LEVELS[level]]]
        for i in range(n):
            j = (i + 1) % n
            loop = [around[k + 1][i], -across[k][j], -around[k][i], across[k][i]]
            inside = (middle[i] - rows["angle_from_deg"]) % 360 < (
                rows["angle_to_deg"] - rows["angle_from_deg"]
            )
            add_face(loop, [], int(rows["aha_segment"][inside].iloc[0]))
    # For each face in turn gmsh returns its copy, the volume, and the sides in the loop's order.
    out = geo.extrude([(2, f) for f in faces], 0, 0, -1, numElements=[layers], recombine=True)
    at = [i for i, (dimension, _) in enumerate(out) if dimension == 3]
    for i, segment in zip(at, owners, strict=True):
        volumes[segment].append(out[i][1])
    surfaces = {
        ENDOCARDIUM: faces,
        EPICARDIUM: [out[i - 1][1] for i in at],
        BASE: [out[i + 1][1] for i in at[-n:]],
    }
    geo.synchronize()
    for segment, tags in volumes.items():
        gmsh.model.addPhysicalGroup(3, tags, tag=segment, name=SEGMENTS[segment - 1].name)
    for surface, tags in surfaces.items():
        gmsh.model.addPhysicalGroup(2, tags, tag=100 + surface, name=SURFACES[surface])
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)
    return volumes[17][0]


def _node_places(gmsh: Any, patch: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(tags, rho, phi, t) of the nodes of the straight-sided gmsh model; `patch` is its volume tag.

    Nodes between corners lie half-way in rho and phi outside the patch, and half-way in the plane
    of the bullseye inside it. The patch's middle node is moved to the pole.
    """
    tags, xyz, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(tags)
    tags, xyz = tags[order], xyz.reshape(-1, 3)[order]
    x, y, t = xyz.T * [[1], [1], [-1]]
    cells = np.searchsorted(tags, gmsh.model.mesh.getElements(3, patch)[2][0].reshape(-1, 27))
    inner, corners = np.unique(cells), np.unique(cells[:, :8])
    middle = corners[np.argmin(np.hypot(x[corners], y[corners]))]
    rho, phi = np.hypot(x, y), np.arctan2(y, x)
    done = np.zeros(len(tags), dtype=bool)
    for _, volume in gmsh.model.getEntities(3):
        if volume == patch:
            continue
        nodes = gmsh.model.mesh.getElements(3, volume)[2][0].reshape(-1, 27)
        for cell in np.searchsorted(tags, nodes)[:, GMSH_TO_VTK]:
            angle = np.unwrap(phi[cell[:8]])
            radius = rho[cell[:8]]
            for node, parents in zip(cell[8:], HEXAHEDRON_PARENTS[8:], strict=True):
                phi[node] = angle[list(parents)].mean()
                rho[node] = radius[list(parents)].mean()
            done[cell] = True
    free = inner[~done[inner]]
    fade = 1 - (np.hypot(x[free], y[free]) / rho[inner].max()) ** 2
    shift = np.array([x[middle], y[middle]]) / (1 - (rho[middle] / rho[inner].max()) ** 2)
    x[free] -= fade * shift[0]
    y[free] -= fade * shift[1]
    rho[free], phi[free] = np.hypot(x[free], y[free]), np.arctan2(y[free], x[free])
    at_pole = rho < 1e-9
    rho[at_pole] = phi[at_pole] = 0.0
    return tags, rho, phi, t


def write_plain(table: pd.DataFrame, surfaces: Wall, mesh: Mapping, path: str | Path) -> None:
    """What `write_gmsh` does, without gmsh (`structured`): the same nodes and elements."""
    table = with_joined_borders(table)
    angles = _grid_angles(table, mesh["circumferential"])
    rings, levels, border = _rings(table, surfaces.endo_apex, mesh)
    lines = (angles, rings, levels, border, *_patch_outline(angles))
    structured.write(table, surfaces, mesh["transmural"], lines, path)


def write_gmsh(table: pd.DataFrame, surfaces: Wall, mesh: Mapping, path: str | Path) -> None:
    """Build the mesh in gmsh, move it onto the surfaces and write it (ASCII, format 4.1).

    Where gmsh cannot be loaded, it is `write_plain`.
    """
    gmsh = load_gmsh()
    if gmsh is None:
        write_plain(table, surfaces, mesh, path)
        return
    table = with_joined_borders(table)
    angles = _grid_angles(table, mesh["circumferential"])
    rings, levels, border = _rings(table, surfaces.endo_apex, mesh)
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("left ventricle")
        patch = _build_disk(gmsh, table, angles, rings, levels, mesh["transmural"])
        tags, rho, phi, t = _node_places(gmsh, patch)
        # To the nanometre: below it, results depend on the linear algebra library's threads.
        points = np.round(surfaces.wall(phi, rho, t, border), 6) + 0.0
        for tag, point in zip(tags, points, strict=True):
            gmsh.model.mesh.setNode(tag, point, [])
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        gmsh.write(str(path))
        for name, values in (("transmural", t), ("longitudinal", rho)):
            view = gmsh.view.add(name)
            gmsh.view.addModelData(view, 0, "left ventricle", "NodeData", tags, values[:, None])
            gmsh.view.write(view, str(path), append=True)
    finally:
        gmsh.finalize()


def convert_mesh(msh_path: str | Path) -> Mesh:
    """Mesh from the gmsh file that `make_mesh` writes, read by meshio.

    Cells are sorted by segment. Facets are turned so that their normals point out of the wall.
    """
    raw = meshio.read(msh_path)
    physical = raw.cell_data["gmsh:physical"]

    def collect(kind: str) -> tuple[np.ndarray, np.ndarray]:
        blocks = [i for i, block in enumerate(raw.cells) if block.type == kind]
        return (
            np.concatenate([raw.cells[i].data for i in blocks]).astype(np.int64),
            np.concatenate([physical[i] for i in blocks]).astype(np.int32),
        )

    cells, segment = collect("hexahedron27")
    facets, surface = collect("quad9")
    order = np.argsort(segment, kind="stable")
    t, rho = (raw.point_data[k].ravel() for k in ("transmural", "longitudinal"))
    mesh = Mesh(raw.points, cells[order], segment[order], facets, surface - 100, t, rho)
    outward = mesh.points[facets[:, 8]] - mesh.points[mesh.cells[facet_cells(mesh), 26]]
    inward = np.einsum("kx,kx->k", facet_normals(mesh, np.zeros((1, 2)))[:, 0], outward) < 0
    mesh.facets[inward] = facets[inward][:, [0, 3, 2, 1, 7, 6, 5, 4, 8]]
    return mesh
