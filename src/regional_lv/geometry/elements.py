"""Linear and quadratic elements: shape functions, Jacobians, normals, facets."""

from functools import cache

import numpy as np
from numpy.polynomial import legendre

from regional_lv.geometry.mesh import Mesh

# Parents (corner nodes) of the nodes of the 27-node hexahedron and the 9-node quadrilateral, in
# the order of VTK (triquadratic hexahedron, biquadratic quad), which meshio and this module use.
HEXAHEDRON_PARENTS = (
    *((i,) for i in range(8)),
    *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)),
    *((0, 4), (1, 5), (2, 6), (3, 7)),
    *((0, 3, 4, 7), (1, 2, 5, 6), (0, 1, 4, 5), (2, 3, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7)),
    tuple(range(8)),
)
# Corners of the hexahedron's six faces, turned so that their normals point out of the cell.
FACES = np.array(
    [(0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)]
)

# Corner signs of the reference hexahedron and quadrilateral [-1, 1]^d, and from them all nodes.
_CORNERS = np.array(
    [[x, y, z] for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))], dtype=float
)
NODES = np.array([_CORNERS[list(p)].mean(axis=0) for p in HEXAHEDRON_PARENTS])
_QUAD_PARENTS = (*((i,) for i in range(4)), (0, 1), (1, 2), (2, 3), (3, 0), (0, 1, 2, 3))
QUAD_NODES = np.array([_CORNERS[list(p), :2].mean(axis=0) for p in _QUAD_PARENTS])


def lagrange(points: np.ndarray, nodes: np.ndarray = NODES) -> tuple[np.ndarray, np.ndarray]:
    """Lagrange shape functions (q, nodes) and derivatives (q, nodes, d) at (q, d) points.

    `nodes` are reference coordinates in [-1, 1], of the hexahedron (default) or of the quad: all of
    them for quadratic functions, the corners alone for linear ones.
    """
    x, a = points[:, None, :], nodes[None]
    dimension = nodes.shape[1]
    if len(nodes) == 2**dimension:
        value = (1 + x * a) / 2
        slope = np.broadcast_to(a / 2, value.shape)
    else:
        value = np.where(a == 0, 1 - x**2, x * (x + a) / 2)
        slope = np.where(a == 0, -2 * x, x + a / 2)
    gradient = np.stack(
        [slope[..., d] * np.prod(np.delete(value, d, axis=-1), axis=-1) for d in range(dimension)],
        axis=-1,
    )
    return value.prod(axis=-1), gradient


POINTS_PER_EDGE = 3
"""Gauss points along each edge of a cell and of a facet, as many as the simulator integrates with.
They are exact for the cavity's volume under a quadratic motion."""


@cache
def gauss(dimension: int, n: int = POINTS_PER_EDGE) -> tuple[np.ndarray, np.ndarray]:
    """Tensor Gauss points (n^d, d) and weights on [-1, 1]^d."""
    x, w = legendre.leggauss(n)
    grid = np.stack(np.meshgrid(*[x] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    weights = np.prod(np.stack(np.meshgrid(*[w] * dimension, indexing="ij"), -1), -1).ravel()
    for each in (grid, weights):  # they are shared
        each.setflags(write=False)
    return grid, weights


def gauss_shares(first: np.ndarray, last: np.ndarray, n: int) -> np.ndarray:
    """What each of n Gauss points of [-1, 1] counts for in the integral from `first` to `last`,
    (...), of the polynomial through the points: a multiple (n, ...) of its weight."""
    both = np.polynomial.polynomial.polyval(np.stack([first, last]), _gauss_integrals(n))
    return both[:, 1] - both[:, 0]


@cache
def _gauss_integrals(n: int) -> np.ndarray:
    """Coefficients (n + 1, n), by power, of the integrals of the polynomials that are one at a
    Gauss point and zero at the others, over the point's weight."""
    x, w = legendre.leggauss(n)
    basis = (np.poly1d(np.poly(np.delete(x, i))) for i in range(n))
    integrals = [
        np.polyint(p / (p(at) * weight)) for p, at, weight in zip(basis, x, w, strict=True)
    ]
    return np.stack([integral.coeffs[::-1] for integral in integrals], axis=1)


def nodes_of(mesh: Mesh) -> np.ndarray:
    """Reference coordinates (27 or 8, 3) of the nodes of the mesh's cells."""
    return NODES[: mesh.cells.shape[1]]


def facet_nodes_of(mesh: Mesh) -> np.ndarray:
    """Reference coordinates (9 or 4, 2) of the nodes of the mesh's facets."""
    return QUAD_NODES[: mesh.facets.shape[1]]


def jacobians(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    """Jacobian matrices dx/dxi (cells, q, 3, 3) of the mesh at reference points (q, 3)."""
    gradient = lagrange(points, nodes_of(mesh))[1]
    return np.einsum("enx,qnd->eqxd", mesh.points[mesh.cells], gradient, optimize=True)


def facet_points(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    """Places (facets, q, 3) at reference points (q, 2) of the mesh's facets."""
    shape = lagrange(points, facet_nodes_of(mesh))[0]
    return np.einsum("qn,knx->kqx", shape, mesh.points[mesh.facets])


def facet_normals(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    """Normals (facets, q, 3) at reference points (q, 2), of length area per reference area."""
    return np.cross(*_facet_tangents(mesh, points, mesh.points))


def facet_normal_changes(mesh: Mesh, points: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """Changes (K, facets, q, 3) of `facet_normals` per unit of moves (K, n, 3) of the nodes."""
    first, second = _facet_tangents(mesh, points, mesh.points)
    moved = _facet_tangents(mesh, points, moves)
    return np.cross(moved[0], second) + np.cross(first, moved[1])


def _facet_tangents(mesh: Mesh, points: np.ndarray, nodal: np.ndarray) -> np.ndarray:
    """Derivatives (2, ..., facets, q, 3) of a field (..., n, 3) at reference points (q, 2)."""
    gradient = lagrange(points, facet_nodes_of(mesh))[1]
    return np.einsum("...knx,qnd->d...kqx", nodal[..., mesh.facets, :], gradient, optimize=True)


def exterior_faces(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(corners, owner): faces that one cell alone has, (k, 4) nodes turned outwards and (k,) cell.

    `cells` (m, >= 8) begin with their corners in VTK's order.
    """
    corners = cells[:, FACES].reshape(-1, 4)
    _, first, count = np.unique(
        np.sort(corners, axis=1), axis=0, return_index=True, return_counts=True
    )
    alone = np.sort(first[count == 1])
    return corners[alone], alone // len(FACES)


def facet_cells(mesh: Mesh) -> np.ndarray:
    """Cell (k,) that each facet belongs to, found by its corners."""
    corners, owner = exterior_faces(mesh.cells)
    cell_of = {tuple(row): cell for row, cell in zip(np.sort(corners, axis=1), owner, strict=True)}
    return np.array([cell_of[tuple(row)] for row in np.sort(mesh.facets[:, :4], axis=1)], dtype=int)
