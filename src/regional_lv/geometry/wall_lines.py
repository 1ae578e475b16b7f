"""Straight lines through the wall, from which the mesh's coordinates are made.

A line stands in the half plane of each angle phi about the long axis for each latitude u (0 at the
base, pi/2 at the apex). With the endocardial apex at z = -c, s = sin(u), and gamma the slope of the
base plane in that half plane, the points of a line are

    r = D a cos(u),        z = -c (s - f) + D (-c f + gamma (1 - s) a cos(u)),        D >= 0.

D = 0 lies on the long axis, D = 1 on a half ellipsoid of half axes a and c whose rim lies in the
base plane. At the base the lines lie in that plane, and towards the apex they become perpendicular
to the long axis. From the share s_f of the cavity's length on they fan out to join the apices:

    f = (s - s_f)^2 / (2 (1 - s_f))        for s > s_f,  else 0.

Lines never meet away from the axis: at a fixed distance from the axis, z falls as u grows as long
as |gamma| r < c. (phi, u, D) are therefore coordinates of the whole space below the base plane. A
wall between two surfaces of one D for each line is meshed without folds if and only if the
epicardium's D is the larger one everywhere, whatever the shapes.
"""

from typing import Self

import numpy as np

from regional_lv.geometry.surfaces import QUARTER

LEVEL_ENDS = (1 / 3, 2 / 3, 0.9)
"""Where basal, mid and apical level end, as shares of the cavity's length on the long axis.

The AHA divides the ventricle into thirds perpendicular to the long axis; segment 17 is the tip
beyond the cavity's end (Cerqueira et al. 2002, doi 10.1161/hc0402.102975). Here that segment begins
with the last tenth of the cavity, so that it has an endocardium, whose strains are defined."""

# Lines fan out from the end of the mid level on.
FAN = LEVEL_ENDS[1]


class WallLines:
    """The lines of the module; methods take and give angles phi and latitudes u (n,) in rad.

    length, radius: the half axes c and a (mm). slope (2,): dz/dx and dz/dy of the base plane, which
    passes through the origin.
    """

    def __init__(
        self, length: float, radius: float, slope: tuple[float, float] | np.ndarray = (0.0, 0.0)
    ) -> None:
        self.length, self.radius, self.slope = length, radius, np.asarray(slope, dtype=float)

    @classmethod
    def of(
        cls, endocardium: np.ndarray, slope: tuple[float, float] | np.ndarray = (0.0, 0.0)
    ) -> Self:
        """Lines whose half ellipsoid has the apex of the endocardium's points (n, 3), and lies
        close to those below the mid level."""
        r = np.hypot(endocardium[:, 0], endocardium[:, 1])
        share = endocardium[:, 2] / endocardium[r.argmin(), 2]
        apical = (share > FAN) & (share < 1)
        radius = np.sqrt((r[apical] ** 2).sum() / (1 - share[apical] ** 2).sum())
        return cls(-endocardium[r.argmin(), 2], radius, slope)

    def _line(self, phi: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(foot, r, z): height (n,) of D = 0 and the step (n,), (n,) from there to D = 1."""
        s, across = np.sin(u), self.radius * np.cos(u)
        fan = np.maximum(s - FAN, 0) ** 2 / (2 * (1 - FAN))
        slope = self.slope[0] * np.cos(phi) + self.slope[1] * np.sin(phi)
        along = -self.length * fan + slope * (1 - s) * across
        return -self.length * (s - fan), across, along

    def points(self, phi: np.ndarray, u: np.ndarray, distance: np.ndarray) -> np.ndarray:
        """Points (n, 3) of the lines at D = distance (n,)."""
        foot, across, along = self._line(phi, u)
        r = distance * across
        return np.stack([r * np.cos(phi), r * np.sin(phi), foot + distance * along], axis=-1)

    def directions(self, phi: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Steps (n, 3) in mm along the lines from the axis to D = 1."""
        return self.points(phi, u, np.ones_like(u)) - self.points(phi, u, np.zeros_like(u))

    def coordinates(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(phi, u, D) of points (n, 3) below the base plane; above it u is 0."""
        x, y, z = points.T
        phi, r = np.arctan2(y, x), np.hypot(x, y)
        low, high = np.zeros(len(points)), np.full(len(points), QUARTER)
        for _ in range(50):
            u = (low + high) / 2
            foot, across, along = self._line(phi, u)
            below = (z - foot) * across < r * along
            low, high = np.where(below, u, low), np.where(below, high, u)
        u = (low + high) / 2
        foot, across, along = self._line(phi, u)
        return phi, u, np.hypot(r, z - foot) / np.hypot(across, along)
