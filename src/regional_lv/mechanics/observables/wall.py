"""The wall at its quadrature points: what of the mesh the motion there and its averages need."""

import itertools
from functools import cached_property

import numpy as np
from scipy import sparse

from regional_lv import aha
from regional_lv.geometry.elements import (
    NODES,
    POINTS_PER_EDGE,
    QUAD_NODES,
    gauss,
    jacobians,
    lagrange,
    nodes_of,
)
from regional_lv.geometry.mesh import BASE, ENDOCARDIUM, Mesh
from regional_lv.mechanics.observables.layer import window_weights
from regional_lv.mechanics.observables.segments import membership, turned_membership


class Wall:
    """Quadrature points of a mesh, cell by cell, the last reference coordinate fastest: M of them.

    volume (M,) mm3, the part of the unloaded wall that each stands for; place (M, 3) mm;
    depth_gradient (M, 3) 1/mm, of the transmural coordinate; segment (cells,) number less one.
    """

    def __init__(self, mesh: Mesh):
        self.mesh = mesh
        points, weights = gauss(3, POINTS_PER_EDGE)
        self._shape, shape_gradient = lagrange(points, nodes_of(mesh))
        jacobian = jacobians(mesh, points)
        # d(shape)/dx as a matrix per cell: (cells, 3 q, nodes), the direction x fastest.
        local = np.einsum("qnd,eqdx->eqxn", shape_gradient, np.linalg.inv(jacobian), optimize=True)
        self._local = np.ascontiguousarray(local.reshape(len(local), -1, local.shape[-1]))
        self._corner_shape = lagrange(points, NODES[:8])[0]
        self.volume = (np.linalg.det(jacobian) * weights).ravel()
        self.place = self.values(mesh.points)
        depth = mesh.transmural[mesh.cells][..., None]
        self.depth_gradient = (self._local @ depth).reshape(-1, 3)
        self.segment = mesh.segment - 1

    @property
    def points_per_cell(self) -> int:
        return POINTS_PER_EDGE**3

    def values(self, nodal: np.ndarray) -> np.ndarray:
        """(M, c) of a field (n, c) at the mesh's nodes."""
        cells = nodal[self.mesh.cells]
        return np.matmul(self._shape, cells).reshape(-1, nodal.shape[1])

    def corner_values(self, corners: np.ndarray) -> np.ndarray:
        """(M, c) of a field that is linear in each cell, from its values (cells, 8, c) at the
        corners."""
        return np.matmul(self._corner_shape, corners).reshape(-1, corners.shape[-1])

    def gradients(self, nodal: np.ndarray) -> np.ndarray:
        """d(field)/dx (M, 3, c), derivatives along x first, of a field (n, c) at the nodes."""
        return (self._local @ nodal[self.mesh.cells]).reshape(-1, 3, nodal.shape[1])

    def on_nodes(self, shares: "Shares", of_values: np.ndarray | None, of_gradients: np.ndarray):
        """The transpose of `values` and `gradients`, averaged: (17, n, c), by segment and node.

        of_values (M, c) and of_gradients (M, c, 3), x last: what an average changes with, per unit
        of a field and of its gradient at each point.
        """
        q, c = self.points_per_cell, of_gradients.shape[1]
        found = np.zeros((len(shares.by_cell), len(self.mesh.points), c))
        of_gradients = of_gradients.reshape(-1, q, c, 3).swapaxes(2, 3)
        for each, (cells, weight) in zip(found, shares.by_cell, strict=True):
            rows = weight[..., None, None] * of_gradients[cells]
            here = self._local[cells].swapaxes(1, 2) @ rows.reshape(len(cells), 3 * q, c)
            if of_values is not None:
                here += self._shape.T @ (weight[..., None] * of_values.reshape(-1, q, c)[cells])
            np.add.at(each, self.mesh.cells[cells], here)
        return found

    def on_corners(self, shares: "Shares", of_values: np.ndarray) -> np.ndarray:
        """The transpose of `corner_values`, averaged: (17, cells, 8), of of_values (M,)."""
        found = np.zeros((len(shares.by_cell), len(self.segment), 8))
        of_values = of_values.reshape(len(self.segment), -1)
        for each, (cells, weight) in zip(found, shares.by_cell, strict=True):
            each[cells] = (weight * of_values[cells]) @ self._corner_shape
        return found

    def shares(self, layer: tuple[float, float], rotation_deg: float) -> "Shares":
        """What each point counts for in the mean over each segment."""
        depth = self.mesh.transmural[self.mesh.cells[:, :8]]
        weight = self.volume * window_weights(depth, *layer, POINTS_PER_EDGE).ravel()
        if rotation_deg:
            corners = self.mesh.points[self.mesh.cells[:, :8]]
            part = turned_membership(
                np.arctan2(self.place[:, 1], self.place[:, 0]),
                np.repeat(np.arange(len(self.segment)), self.points_per_cell),
                np.arctan2(corners[..., 1], corners[..., 0]),
                self.segment,
                np.deg2rad(rotation_deg),
            )
        else:
            part = membership(self.segment, self.points_per_cell)
        total = part @ weight
        mean = sparse.diags(1 / np.where(total > 0, total, 1.0)) @ part @ sparse.diags(weight)
        return Shares(mean.tocsr(), self.points_per_cell)

    @cached_property
    def segment_of_points(self) -> np.ndarray:
        """Number less one (M,) of the segment of each point."""
        return np.repeat(self.segment, self.points_per_cell)

    @cached_property
    def segment_volumes(self) -> np.ndarray:
        """Volumes (17,) of the segments, mm3."""
        return np.bincount(self.segment_of_points, self.volume, len(aha.SEGMENTS))


class Shares:
    """Sparse matrix (17, M) of what each point of a wall counts for in the mean over each segment,
    q points in each cell."""

    def __init__(self, matrix: sparse.csr_matrix, q: int):
        self.matrix, self._q = matrix, q

    def __matmul__(self, values: np.ndarray) -> np.ndarray:
        return self.matrix @ values

    @cached_property
    def by_cell(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """By segment, the cells (m,) that have a share in it, and their points' weights (m, q)."""
        found = []
        for first, last in itertools.pairwise(self.matrix.indptr):
            cell, point = np.divmod(self.matrix.indices[first:last], self._q)
            cells, at = np.unique(cell, return_inverse=True)
            weight = np.zeros((len(cells), self._q))
            weight[at, point] = self.matrix.data[first:last]
            found.append((cells, weight))
        return found


class Cavity:
    """The cavity's volume under the endocardium, and how it follows the endocardium's nodes.

    The lid is the cone from the ring where endocardium and base meet to the ring's centre, flat if
    the ring is.
    """

    def __init__(self, mesh: Mesh):
        self._facets = mesh.facets[mesh.surface == ENDOCARDIUM]
        self.nodes = mesh.nodes_on(ENDOCARDIUM)
        self._at = np.searchsorted(self.nodes, self._facets)
        self.reference = mesh.points[self.nodes]
        points, self._weights = gauss(2, POINTS_PER_EDGE)
        reference = QUAD_NODES[: self._facets.shape[1]]
        self._shape, self._slope = lagrange(points, reference)
        self.ring = np.searchsorted(self.nodes, mesh.nodes_on(ENDOCARDIUM, BASE))
        self.apex = int(self.reference[:, 2].argmin())

    def volume_and_gradient(self, displacement: np.ndarray) -> tuple[float, np.ndarray]:
        """Volume (mL), and its derivatives (m, 3) in mL/mm with respect to the displacement (m, 3)
        in mm of `nodes`.

        V = -1/3 sum over facets of the integral of (x - c) . n, n pointing into the cavity: on the
        cone through c, x - c has no component along the normal.
        """
        x = self.reference + displacement
        centre = x[self.ring].mean(axis=0)
        corners = x[self._at]
        place = np.einsum("qn,knx->kqx", self._shape, corners) - centre
        first, second = np.moveaxis(np.einsum("qnd,knx->dkqx", self._slope, corners), 0, 0)
        normal = np.cross(first, second)
        weight = -self._weights / 3e3
        volume = np.einsum("kqx,kqx,q->", place, normal, weight)
        # d(place . (first x second)) = dplace . normal + dfirst . (second x place) + ...
        by_corner = np.einsum("kqx,qn,q->knx", normal, self._shape, weight)
        for index, turned in enumerate((np.cross(second, place), np.cross(place, first))):
            by_corner += np.einsum("kqx,qn,q->knx", turned, self._slope[..., index], weight)
        gradient = np.zeros_like(x)
        np.add.at(gradient, self._at, by_corner)
        gradient[self.ring] -= np.einsum("kqx,q->x", normal, weight) / len(self.ring)
        return float(volume), gradient
