"""Quadratic elements: shape functions, Jacobians, normals."""

import numpy as np
from numpy.polynomial import legendre

# Parents (corner nodes) of the nodes of the 27-node hexahedron and the 9-node quadrilateral, in
# the order of VTK (triquadratic hexahedron, biquadratic quad), which meshio and this module use.
HEXAHEDRON_PARENTS = (
    *((i,) for i in range(8)),
    *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)),
    *((0, 4), (1, 5), (2, 6), (3, 7)),
    *((0, 3, 4, 7), (1, 2, 5, 6), (0, 1, 4, 5), (2, 3, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7)),
    tuple(range(8)),
)

# Corner signs of the reference hexahedron and quadrilateral [-1, 1]^d, and from them all nodes.
_CORNERS = np.array(
    [[x, y, z] for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))], dtype=float
)
NODES = np.array([_CORNERS[list(p)].mean(axis=0) for p in HEXAHEDRON_PARENTS])
_QUAD_PARENTS = (*((i,) for i in range(4)), (0, 1), (1, 2), (2, 3), (3, 0), (0, 1, 2, 3))
QUAD_NODES = np.array([_CORNERS[list(p), :2].mean(axis=0) for p in _QUAD_PARENTS])


def lagrange(points, nodes=NODES):
    """Quadratic Lagrange shape functions (q, nodes) and derivatives (q, nodes, d) at (q, d) points.

    `nodes` are reference coordinates in [-1, 1]: of the hexahedron (default) or of the quad.
    """
    x, a = points[:, None, :], nodes[None]
    value = np.where(a == 0, 1 - x**2, x * (x + a) / 2)
    slope = np.where(a == 0, -2 * x, x + a / 2)
    dimension = nodes.shape[1]
    gradient = np.stack(
        [slope[..., d] * np.prod(np.delete(value, d, axis=-1), axis=-1) for d in range(dimension)],
        axis=-1,
    )
    return value.prod(axis=-1), gradient


def gauss(dimension, n=3):
    """Tensor Gauss points (n^d, d) and weights on [-1, 1]^d."""
    x, w = legendre.leggauss(n)
    grid = np.stack(np.meshgrid(*[x] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    weights = np.prod(np.stack(np.meshgrid(*[w] * dimension, indexing="ij"), -1), -1).ravel()
    return grid, weights


def jacobians(mesh, points):
    """Jacobian matrices dx/dxi (cells, q, 3, 3) of the mesh at reference points (q, 3)."""
    return np.einsum("enx,qnd->eqxd", mesh.points[mesh.cells], lagrange(points)[1])


def facet_normals(mesh, points):
    """Normals (facets, q, 3) at reference points (q, 2), of length area per reference area."""
    tangents = np.einsum("knx,qnd->kqdx", mesh.points[mesh.facets], lagrange(points, QUAD_NODES)[1])
    return np.cross(tangents[..., 0, :], tangents[..., 1, :])


def facet_cells(mesh):
    """Cell (k,) that each facet belongs to, found by the node in the facet's middle."""
    owner = np.full(len(mesh.points), -1)
    for face in range(20, 26):
        owner[mesh.cells[:, face]] = np.arange(len(mesh.cells))
    return owner[mesh.facets[:, 8]]
