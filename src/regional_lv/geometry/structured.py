"""The mesh without gmsh, whose wheel loads only where the system has X libraries.

The same lines as in `meshing`, the same nodes and elements to the nanometre: quadrilaterals between
transfinite lines, extruded through the wall.
"""

from collections.abc import Sequence
from pathlib import Path

import meshio
import numpy as np
import pandas as pd

from regional_lv.aha import LEVELS, SEGMENTS
from regional_lv.geometry.elements import HEXAHEDRON_PARENTS
from regional_lv.geometry.mesh import BASE, ENDOCARDIUM, EPICARDIUM, SURFACES
from regional_lv.geometry.surfaces import Wall

# Nodes, in VTK's order, of three faces of the 27-node hexahedron.
INNER_FACE = [0, 1, 2, 3, 8, 9, 10, 11, 24]
OUTER_FACE = [4, 5, 6, 7, 12, 13, 14, 15, 25]
RIM_FACE = [1, 2, 6, 5, 9, 18, 13, 17, 21]


def write(
    table: pd.DataFrame,
    surfaces: Wall,
    layers: int,
    lines: tuple[np.ndarray, np.ndarray, list[str], float, int, np.ndarray],
    path: str | Path,
) -> None:
    """The mesh, moved onto the surfaces, in gmsh's format (2.2).

    lines: (angles, rings, levels, border, first, outline), where its lines run, as `meshing` has
    them; layers: elements through the wall.
    """
    angles, rings, levels, border, first, outline = lines
    plane, quads, segment = _bullseye(table, angles, rings, levels, first, outline)
    count = len(plane)
    inner = np.arange(count) >= len(rings) * len(angles)
    # From the endocardium outwards, one layer of all quadrilaterals after the other.
    shift = count * np.arange(layers)[:, None, None]
    corners = np.concatenate([quads + shift, quads + count + shift], axis=-1).reshape(-1, 8)
    cells, parents = _quadratic(corners)
    rho, phi = _node_places(np.tile(plane, (layers + 1, 1)), np.tile(inner, layers + 1), parents)
    t = (parents // count).mean(axis=1) / layers
    # To the nanometre: below it, results depend on the linear algebra library's threads.
    points = np.round(surfaces.wall(phi, rho, t, border), 6) + 0.0
    by_layer = cells.reshape(layers, -1, 27)
    skin = {
        ENDOCARDIUM: by_layer[0][:, INNER_FACE],
        EPICARDIUM: by_layer[-1][:, OUTER_FACE],
        BASE: by_layer[:, -len(angles) :, RIM_FACE].reshape(-1, 9),
    }
    tags = [
        np.tile(segment, layers),
        np.repeat([100 + surface for surface in skin], [len(facets) for facets in skin.values()]),
    ]
    names = {SEGMENTS[s - 1].name: (s, 3) for s in range(1, 18)}
    names |= {name: (100 + surface, 2) for surface, name in SURFACES.items()}
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    meshio.gmsh.write(
        path,
        meshio.Mesh(
            points,
            [("hexahedron27", cells), ("quad9", np.concatenate(list(skin.values())))],
            point_data={"transmural": t, "longitudinal": rho},
            cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
            field_data=names,
        ),
        fmt_version="2.2",
        binary=True,  # meshio 5.3 writes no readable ASCII with NumPy 2
    )


def _bullseye(
    table: pd.DataFrame,
    angles: np.ndarray,
    rings: np.ndarray,
    levels: Sequence[str],
    first: int,
    outline: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The bullseye in the plane: nodes (n, 2), quadrilaterals (m, 4) and their segments (m,).

    Nodes run around the rings from the patch's outline to the base, then through the patch;
    quadrilaterals fill the patch first and the base's row last. Outside the patch the second and
    third node of each are its outer ones. first, outline: of the patch, as `_patch_outline` in
    `meshing` gives them.
    """
    n = len(angles)
    # Rows of the apex go over from the patch's outline to the circle.
    fraction = np.maximum(0.0, 1 - np.arange(len(rings)) / levels.count("apex"))[:, None]
    radius = rings[:, None] - fraction * rings[0] * (1 - outline)
    radians = np.radians(angles)
    nodes = np.stack([radius * np.cos(radians), radius * np.sin(radians)], axis=-1).reshape(-1, 2)
    ring = np.arange(len(rings) * n).reshape(-1, n)
    ahead = np.roll(ring, -1, axis=1)
    rows = np.stack([ahead[:-1], ahead[1:], ring[1:], ring[:-1]], axis=-1)
    grid, inside = _patch(nodes, np.roll(ring[0], -first))
    patch = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=-1)
    segments = [17] * patch[..., 0].size
    middle = (angles + np.append(angles[1:], angles[0] + 360)) / 2
    for level in levels:
        sectors = table.loc[[s - 1 for s in LEVELS[level]]]
        start, end = (sectors[f"angle_{k}_deg"].to_numpy() for k in ("from", "to"))
        within = (middle[:, None] - start) % 360 < end - start
        segments.extend(sectors["aha_segment"].to_numpy()[within.argmax(axis=1)])
    quads = np.concatenate([patch.reshape(-1, 4), rows.reshape(-1, 4)])
    return np.concatenate([nodes, inside]), quads, np.array(segments)


def _patch(nodes: np.ndarray, outline: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(grid, inside): node numbers (k + 1, k + 1) of the patch, and places of its inner nodes.

    `outline` (4 k,) are the nodes around it, from a corner on. The inner nodes come from
    transfinite (Coons) interpolation between the four sides, and are numbered after `nodes`.
    """
    k = len(outline) // 4
    grid = np.empty((k + 1, k + 1), dtype=int)
    around = np.append(outline, outline[0])
    for i, side in enumerate((grid[:, 0], grid[k], grid[::-1, k], grid[0, ::-1])):
        side[:] = around[i * k : (i + 1) * k + 1]
    grid[1:-1, 1:-1] = len(nodes) + np.arange((k - 1) ** 2).reshape(k - 1, k - 1)

    def fractions(*opposite: np.ndarray) -> np.ndarray:
        """Places along two opposite sides, their ends left out, by the mean of their lengths."""
        steps = sum(np.linalg.norm(np.diff(nodes[side], axis=0), axis=1) for side in opposite)
        return np.cumsum(steps)[:-1] / steps.sum()

    u = fractions(grid[:, 0], grid[:, k])[:, None, None]
    v = fractions(grid[0], grid[k])[None, :, None]
    inside = (
        (1 - v) * nodes[grid[1:-1, :1]]
        + v * nodes[grid[1:-1, k:]]
        + (1 - u) * nodes[grid[:1, 1:-1]]
        + u * nodes[grid[k:, 1:-1]]
        - (1 - u) * (1 - v) * nodes[grid[0, 0]]
        - u * (1 - v) * nodes[grid[k, 0]]
        - u * v * nodes[grid[k, k]]
        - (1 - u) * v * nodes[grid[0, k]]
    )
    return grid, inside.reshape(-1, 2)


def _quadratic(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (m, 27) of quadratic hexahedra with the given corners (m, 8), and their parents (n, 8).

    A node lies in the middle of its parents, which are corners, each as often as the others.
    """
    of_cells = [
        np.sort(np.repeat(corners[:, list(parents)], 8 // len(parents), axis=1), axis=1)
        for parents in HEXAHEDRON_PARENTS
    ]
    parents, cells = np.unique(
        np.stack(of_cells, axis=1).reshape(-1, 8), axis=0, return_inverse=True
    )
    return cells.reshape(-1, 27), parents


def _node_places(
    corners: np.ndarray, inner: np.ndarray, parents: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(rho, phi) of the quadratic nodes with the given `parents` (n, 8).

    `corners` (c, 2) are places in the plane, of which `inner` (c,) lie inside the patch. Nodes
    between corners lie half-way in rho and phi outside the patch, and half-way in the plane of the
    bullseye inside it. The patch's middle node is moved to the pole.
    """
    x, y = corners.T
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    rho = radius[parents].mean(axis=1)
    phi = np.unwrap(angle[parents], axis=1).mean(axis=1)
    free = inner[parents].any(axis=1)
    middle = np.flatnonzero(inner)[np.argmin(radius[inner])]
    rim = radius[parents[free]].max()
    place = corners[parents[free]].mean(axis=1)
    fade = 1 - (np.linalg.norm(place, axis=1, keepdims=True) / rim) ** 2
    place -= fade * corners[middle] / (1 - (radius[middle] / rim) ** 2)
    rho[free], phi[free] = np.hypot(*place.T), np.arctan2(*place.T[::-1])
    at_pole = rho < 1e-9
    rho[at_pole] = phi[at_pole] = 0.0
    return rho, phi
