"""How a shape moves the nodes of a mesh: other figures of the segment table, or another thickness.

Meshes of one layout have the same nodes for every shape. A node of a mesh from a segment table is
named by its place on the bullseye and its depth, which no figure of the table changes.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from regional_lv.geometry.mesh import Mesh
from regional_lv.geometry.surfaces import QUARTER, Surfaces
from regional_lv.geometry.thickness import endocardial_foot

FIGURES = ("wall_thickness_mm", "endo_radius_mm", "length_mm", "apex_mm")
"""Keys of a shape that its surfaces depend on, in the order of `Surfaces.changes_of_ends`."""


class NodePlaces:
    """Places of a mesh's nodes under any shape.

    A shape is the section `geometry` of a model (`inputs.model`): `wall_thickness_scale`, and of a
    heart from a segment table the table and the `FIGURES`.

    Parameters
    ----------
    mesh: before its wall is scaled.
    shape: the one that the mesh has.
    """

    def __init__(self, mesh: Mesh, shape: Mapping):
        self._points = mesh.points
        self._foot = endocardial_foot(mesh)
        self._table: Any = shape.get("table")  # of pandas, which is not typed; None without one
        self._known: tuple = ()
        if self._table is None:
            return
        self._columns, self._of = np.unique(self._foot, return_inverse=True)
        self._depth = mesh.transmural[:, None]
        x, y, _ = mesh.points[self._columns].T
        self._rho = mesh.longitudinal[self._columns]
        self._phi = np.arctan2(y, x)
        self._length = shape["length_mm"]
        level = self._table["z_bottom_mm"].iloc[15] / self._length
        self._rho_border = 1 - np.arcsin(-level) / QUARTER
        self._across = np.stack([np.cos(self._phi), np.sin(self._phi)], axis=-1)
        # What the mesh's file rounds, and how far its surfaces have settled.
        self._offset: np.ndarray | float = 0.0
        self._offset = mesh.points - self._wall(shape)

    def __call__(self, shape: Mapping) -> np.ndarray:
        """Points (n, 3) mm. Raises InputError for a table without a smooth surface."""
        points = self._wall(shape)
        foot = points[self._foot]
        return foot + shape["wall_thickness_scale"] * (points - foot)

    def moves(self, shape: Mapping) -> dict[str, np.ndarray]:
        """Derivatives of the points about each number of a shape: (n, 3), of the table's columns
        (17, n, 3)."""
        points = self._wall(shape)
        scale = shape["wall_thickness_scale"]
        found = {"wall_thickness_scale": points - points[self._foot]}
        if self._table is None:
            return found
        surfaces, latitudes = self._surfaces(shape)
        ends = surfaces.changes_of_ends(self._phi, self._rho, self._rho_border, latitudes)
        inner, outer = (
            np.concatenate([r.T[..., None] * self._across, z.T[..., None]], axis=-1)
            for r, z in ends
        )
        by_figure = inner[:, self._of] + scale * self._depth * (outer - inner)[:, self._of]
        first = 0
        for name in FIGURES:
            count = np.size(shape[name])
            moves = by_figure[first : first + count]
            found[name] = moves if np.ndim(shape[name]) else moves[0]
            first += count
        return found

    def _surfaces(self, shape: Mapping):
        """The surfaces of a shape and the latitudes of the nodes' lines through its wall; those of
        the last shape are kept."""
        figures = [np.array(shape[name]) for name in FIGURES]
        known = self._known
        if known and all(map(np.array_equal, known[0], figures)):
            return known[1:]
        ratio = shape["length_mm"] / self._length
        heights = {name: self._table[name] * ratio for name in ("z_top_mm", "z_bottom_mm")}
        columns = {name: shape[name] for name in FIGURES[:2]}
        apex = -shape["length_mm"]
        table = self._table.assign(**heights, **columns)
        surfaces = Surfaces(table, apex, apex - shape["apex_mm"], sharp=True)
        latitudes = surfaces.latitudes(self._phi, self._rho, self._rho_border)
        self._known = figures, surfaces, latitudes
        return surfaces, latitudes

    def _wall(self, shape: Mapping) -> np.ndarray:
        """Points (n, 3) before the wall is scaled."""
        if self._table is None:
            return self._points
        surfaces, (u_endo, u_epi, *_) = self._surfaces(shape)
        inner, outer = (
            np.concatenate([r[:, None] * self._across, z[:, None]], axis=-1)
            for r, z in (
                surfaces.endocardium(self._phi, u_endo),
                surfaces.epicardium(self._phi, u_epi),
            )
        )
        walls = (1 - self._depth) * inner[self._of] + self._depth * outer[self._of]
        return walls + self._offset
