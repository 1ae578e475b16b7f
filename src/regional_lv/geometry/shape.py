"""How a shape moves the nodes of a mesh: other values of the segment table, or another thickness.

Meshes of one layout have the same nodes for every shape. A node is named by its place on the
bullseye and its depth, which no figure of the table changes but for the levels' ends: rows of nodes
go along with them. Nodes of a mesh from elsewhere, which a table describes, move as those of a mesh
from this table would.
"""

from collections.abc import Collection, Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from regional_lv.aha import LEVELS
from regional_lv.errors import InputError
from regional_lv.geometry.mesh import Mesh
from regional_lv.geometry.surfaces import QUARTER, Latitudes, Surfaces
from regional_lv.geometry.thickness import endocardial_foot

SIZES = ("wall_thickness_mm", "endo_radius_mm", "length_mm", "apex_mm")
"""Keys of a shape that its surfaces depend on, in the order of `Surfaces.changes_of_ends`."""

LEVEL_KEYS = ("basal_end", "mid_end", "apical_end")
"""Keys of a shape: where its levels end, in shares of the length from the base plane."""

SHAPE_KEYS = (*SIZES, *LEVEL_KEYS)
"""All numbers of a shape beside the scale of its wall's thickness."""

LEVEL_STEP = 1e-4
"""In which differences with respect to the levels' ends are taken: surfaces are found to 1e-11 of
their values."""


def level_ends(table: pd.DataFrame, length_mm: float) -> dict[str, float]:
    """The `LEVEL_KEYS` of a segment table."""
    bottom = -table["z_bottom_mm"].to_numpy(float) / length_mm
    return {
        name: float(bottom[level[0] - 1])
        for name, level in zip(LEVEL_KEYS, LEVELS.values(), strict=False)
    }


def heights(shape: Mapping) -> dict[str, np.ndarray]:
    """Columns z_top_mm and z_bottom_mm (17,) of the segment table of a shape.

    Raises InputError for levels that do not follow each other.
    """
    ends = np.array([0.0, *(shape[name] for name in LEVEL_KEYS), 1.0])
    if (np.diff(ends) <= 0).any():
        raise InputError(
            f"inputs.level_end: levels cannot end at {ends[1]:.3g}, {ends[2]:.3g} and "
            f"{ends[3]:.3g} of the length; give narrower ranges"
        )
    level = np.repeat(np.arange(len(LEVELS)), [len(numbers) for numbers in LEVELS.values()])
    z = -shape["length_mm"] * ends
    return {"z_top_mm": z[level], "z_bottom_mm": z[level + 1]}


class Lines(NamedTuple):
    """Lines of nodes through the wall of one shape.

    figures: its `SHAPE_KEYS`; rho: where on the bullseye the lines are; border: where the apical
    level ends there.
    """

    figures: list[np.ndarray]
    surfaces: Surfaces
    rho: np.ndarray
    border: float
    latitudes: Latitudes


class NodePlaces:
    """Places of a mesh's nodes under any shape. Raises InputError where they have to move and the
    mesh has no columns of cells through the wall.

    A shape is the section `geometry` of a model (`inputs.model`): `wall_thickness_scale`, and of a
    heart with a segment table the table, whose angles it has, and the `SHAPE_KEYS`.

    Parameters
    ----------
    mesh: before its wall is scaled.
    shape: the one that the mesh has.
    """

    def __init__(self, mesh: Mesh, shape: Mapping) -> None:
        self._mesh, self._points = mesh, mesh.points
        self._table: Any = shape.get("table")  # of pandas, which is not typed; None without one
        self._known: Lines | None = None
        if self._table is None:
            return
        self._columns, self._of = np.unique(self._foot, return_inverse=True)
        self._depth = mesh.transmural[:, None]
        x, y, _ = mesh.points[self._columns].T
        self._phi = np.arctan2(y, x)
        # Place within the levels, from the pole (0) to the base (4).
        self._row = np.interp(
            mesh.longitudinal[self._columns], _borders(shape), np.arange(len(LEVELS) + 1)
        )
        self._across = np.stack([np.cos(self._phi), np.sin(self._phi)], axis=-1)
        # What the mesh's file rounds, how far its surfaces have settled, and by what the wall of a
        # mesh from elsewhere is not that of the table: of the line's foot, and from there on.
        walls, across = self._table_wall(shape)
        offset = mesh.points - walls
        self._foot_offset = offset[self._foot]
        self._line_offset = offset - self._foot_offset
        self._width = np.linalg.norm(across, axis=-1)

    @cached_property
    def _foot(self) -> np.ndarray:
        """As `endocardial_foot`: of a mesh whose nodes stay, nothing asks for it."""
        return endocardial_foot(self._mesh, "inputs (of the family shape)")

    def __call__(self, shape: Mapping) -> np.ndarray:
        """Points (n, 3) mm. Raises InputError for a table without a smooth surface."""
        points = self._wall(shape)
        foot = points[self._foot]
        return foot + shape["wall_thickness_scale"] * (points - foot)

    def moves(self, shape: Mapping, about: Collection[str]) -> dict[str, np.ndarray]:
        """Derivatives of the points with respect to each number of a shape: (n, 3), of the table's
        columns (17, n, 3). Those of levels' ends cost most, and are zero where `about` does not
        name them."""
        if self._table is None:
            return {"wall_thickness_scale": self._points - self._points[self._foot]}
        walls, across = self._table_wall(shape)
        width, points = np.linalg.norm(across, axis=-1), self._as_wide(walls, across)
        scale = shape["wall_thickness_scale"]
        found = {"wall_thickness_scale": points - points[self._foot]}
        at = self._lines(shape)
        ends = at.surfaces.changes_of_ends(self._phi, at.rho, at.border, at.latitudes)
        inner, outer = (
            np.concatenate([r.T[..., None] * self._across, z.T[..., None]], axis=-1)
            for r, z in ends
        )
        share = ((outer - inner) * across).sum(axis=-1) / (width * self._width)
        by_figure = inner[:, self._of] + scale * (
            self._depth * (outer - inner)[:, self._of]
            + share[:, self._of, None] * self._line_offset
        )
        first = 0
        for name in SIZES:
            count = np.size(shape[name])
            moves = by_figure[first : first + count]
            found[name] = moves if np.ndim(shape[name]) else moves[0]
            first += count
        # Last: they replace the lines that are kept, which the others share.
        return found | {
            name: self._move_of_level(shape, name) if name in about else np.zeros_like(points)
            for name in LEVEL_KEYS
        }

    def _move_of_level(self, shape: Mapping, name: str) -> np.ndarray:
        """Derivative (n, 3) of the points with respect to one level's end."""
        below, above = (
            self({**shape, name: shape[name] + step}) for step in (-LEVEL_STEP, LEVEL_STEP)
        )
        return (above - below) / (2 * LEVEL_STEP)

    def _lines(self, shape: Mapping) -> Lines:
        """Those of a shape; of the last one they are kept."""
        figures = [np.array(shape[name]) for name in SHAPE_KEYS]
        if self._known and all(map(np.array_equal, self._known.figures, figures)):
            return self._known
        columns = {name: shape[name] for name in SIZES[:2]}
        apex = -shape["length_mm"]
        table = self._table.assign(**heights(shape), **columns)
        surfaces = Surfaces(table, apex, apex - shape["apex_mm"], sharp=True)
        borders = _borders(shape)
        rho = np.interp(self._row, np.arange(len(borders)), borders)
        latitudes = surfaces.latitudes(self._phi, rho, borders[1])
        self._known = Lines(figures, surfaces, rho, borders[1], latitudes)
        return self._known

    def _wall(self, shape: Mapping) -> np.ndarray:
        """Points (n, 3) before the wall is scaled."""
        if self._table is None:
            return self._points
        return self._as_wide(*self._table_wall(shape))

    def _as_wide(self, walls: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Points (n, 3) of the mesh's wall, whose lines are as many times as wide as those of a
        table's wall (`_table_wall`) as they were: a thinner one does not fold."""
        share = np.linalg.norm(across, axis=-1) / self._width
        return walls + self._foot_offset + share[self._of, None] * self._line_offset

    def _table_wall(self, shape: Mapping) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, 3) of the wall that a shape's table describes, and the vectors (columns, 3)
        across it."""
        at = self._lines(shape)
        inner, outer = (
            np.concatenate([r[:, None] * self._across, z[:, None]], axis=-1)
            for r, z in (
                at.surfaces.endocardium(self._phi, at.latitudes.endo),
                at.surfaces.epicardium(self._phi, at.latitudes.epi),
            )
        )
        walls = (1 - self._depth) * inner[self._of] + self._depth * outer[self._of]
        return walls, outer - inner


def _borders(shape: Mapping) -> np.ndarray:
    """Distances (5,) from the bullseye's centre at which its levels begin, the base's rim last."""
    ends = np.array([1.0, *(shape[name] for name in reversed(LEVEL_KEYS)), 0.0])
    return 1 - np.arcsin(ends) / QUARTER
