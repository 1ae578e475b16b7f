"""A left ventricle between two surfaces of triangles, in the project's frame."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import pyvista

from regional_lv.geometry.fitted import FittedSurface
from regional_lv.geometry.triangles import enclosed_volume, triangle_points
from regional_lv.geometry.wall_lines import WallLines

SIDES = ("endocardium", "epicardium")

# Distance (mm) between the points of the endocardium among which its place on the axis is sought.
APEX_MM = 1.0
# Points (mm) of the surfaces that are fitted: at most so far apart on a triangle, and one per cube
# of this edge. The polynomials' shortest wave at the base is some 7 mm long.
GAP_MM, THINNED_MM = 3.0, 1.5


@dataclass(frozen=True)
class Ventricle:
    """Two surfaces of a left ventricle below its base plane, in the project's frame (mm).

    Triangles are turned the same way all over a surface. A point of the files is
    `origin + rotation.T @ x`, over `mm_per_unit`. base_normal (3,): of the base plane, which passes
    through the origin, in the project's frame.
    """

    endocardium: pyvista.PolyData
    epicardium: pyvista.PolyData
    rotation: np.ndarray
    origin: np.ndarray
    mm_per_unit: float
    base_normal: np.ndarray

    @cached_property
    def lines(self) -> WallLines:
        """The `WallLines` of this ventricle."""
        return WallLines.of(
            triangle_points(self.endocardium, APEX_MM),
            -self.base_normal[:2] / self.base_normal[2],
        )

    @cached_property
    def smooth(self) -> dict[str, FittedSurface]:
        """The `FittedSurface` of each side."""
        return {
            side: FittedSurface(self.lines, _points_to_fit(getattr(self, side), self.base_normal))
            for side in SIDES
        }

    def turned(self, rotation: np.ndarray) -> Self:
        """The same in a frame that is turned: a point x becomes rotation (3, 3) @ x."""
        inner, outer = (
            pyvista.PolyData(surface.points @ rotation.T, faces=surface.faces)
            for surface in (self.endocardium, self.epicardium)
        )
        return replace(
            self,
            endocardium=inner,
            epicardium=outer,
            rotation=rotation @ self.rotation,
            base_normal=rotation @ self.base_normal,
        )

    def in_file(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the project's frame in the files' coordinates."""
        return (self.origin + points @ self.rotation) / self.mm_per_unit

    def in_file_words(self, point: np.ndarray) -> str:
        """A point (3,) of the project's frame as text in the files' coordinates."""
        return place_words(self.in_file(point))

    @property
    def cavity_volume_ml(self) -> float:
        return enclosed_volume(self.endocardium)

    @property
    def wall_volume_ml(self) -> float:
        return enclosed_volume(self.epicardium) - self.cavity_volume_ml


def _points_to_fit(surface: pyvista.PolyData, base_normal: np.ndarray) -> np.ndarray:
    """Corners of the triangles, in large ones points between them, in dense places fewer."""
    points = np.concatenate([surface.points, triangle_points(surface, GAP_MM)])
    # Of each cell of a fine grid one point; those in the base plane have cells of their own.
    cell = np.column_stack([np.floor(points / THINNED_MM), points @ base_normal > -1e-6])
    _, first = np.unique(cell, axis=0, return_index=True)
    return points[np.sort(first)]


def place_words(point: np.ndarray) -> str:
    """A point (3,) as text."""
    return "({})".format(", ".join(f"{x:.4g}" for x in point))
