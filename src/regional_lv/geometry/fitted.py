"""Smooth surfaces through a ventricle from elsewhere, and the borders of its segments.

A surface has one D, smooth in the pole, for each of the `wall_lines`: the polynomial of the
bullseye (X, Y) of `surfaces` that fits the surface's nodes best.

Levels end at a latitude that varies with the angle, on the endocardium and on the epicardium on its
own. Those of two bare surfaces end in planes perpendicular to the long axis, whatever the slope of
the base; those of a mesh where its segments do, which may tilt, against the base or through the
wall.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Self, TypeAlias

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from regional_lv.aha import LEVELS, SEGMENTS, beside
from regional_lv.errors import InputError
from regional_lv.geometry.elements import facet_cells
from regional_lv.geometry.mesh import ENDOCARDIUM, EPICARDIUM, Mesh
from regional_lv.geometry.segment_tags import middle_angles
from regional_lv.geometry.summary import cell_volumes
from regional_lv.geometry.surfaces import QUARTER, bullseye, polynomials, powers
from regional_lv.geometry.table import joined_borders
from regional_lv.geometry.wall_lines import LEVEL_ENDS, WallLines

# The polynomials' highest degree, and the nodes that a coefficient needs at least.
HIGHEST_DEGREE = 22
NODES_PER_COEFFICIENT = 4
# Weight of a coefficient's squared order beside the misfit of D: it decides only what the nodes
# leave open.
SMOOTHING = 1e-6
# Angular harmonics of a level's border.
HARMONICS = 3
# Where the middle of the septum lies, between segments 2 and 3.
SEPTUM_DEG = 150.0
# Width of a level's AHA sectors, and the lower border of its first (degrees): anterior is a quarter
# turn counter-clockwise from the septum (Cerqueira et al. 2002, doi 10.1161/hc0402.102975).
AHA_SECTORS = {
    "basal": (60, SEPTUM_DEG + 60),
    "mid": (60, SEPTUM_DEG + 60),
    "apical": (90, SEPTUM_DEG + 45),
}
# Least latitude of a border that lies in a plane perpendicular to the long axis, as a share of the
# latitude that it has under a base that lies so, too: a strongly sloped one would cut the plane.
LEAST_LATITUDE = 0.3
# Sector borders of different levels that lie closer than this share of an element's width become
# one mesh line.
SNAP = 1 / 3

LARGEST_MM = 5.0
"""Distance between a given surface and the smooth one that is not to be accepted."""


class FittedSurface:
    """One surface through nodes (n, 3), as the module describes it; arrays phi, u (rad) are (n,).

    lines: the `WallLines`, each of which meets the surface once.
    """

    def __init__(self, lines: WallLines, points: np.ndarray) -> None:
        self.lines = lines
        phi, u, distance = lines.coordinates(points)
        enough = len(points) / NODES_PER_COEFFICIENT
        self._degree = max(d for d in range(HIGHEST_DEGREE + 1) if len(powers(d)) <= enough)
        basis = polynomials(*bullseye(phi, u), degree=self._degree)
        roughness = SMOOTHING * np.diag([(i + j) ** 2.0 for i, j in powers(self._degree)])
        # The deviation from a half ellipsoid is fitted, so that smoothing pulls towards that.
        misfit = (distance - 1) / np.sqrt(len(points))
        self._coefficients = np.linalg.lstsq(
            np.concatenate([basis / np.sqrt(len(points)), roughness]),
            np.concatenate([misfit, np.zeros(len(roughness))]),
            rcond=None,
        )[0]

    def distance(self, phi: np.ndarray, u: np.ndarray) -> np.ndarray:
        """D (n,) of the surface."""
        return 1 + polynomials(*bullseye(phi, u), degree=self._degree) @ self._coefficients

    def __call__(self, phi: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Points (n, 3) of the surface."""
        return self.lines.points(phi, u, self.distance(phi, u))

    def misfit(self, points: np.ndarray) -> np.ndarray:
        """Distances (n,) of points (n, 3) all over the given surface from this one, along the
        points' lines or to another's: no less than to the surface."""
        phi, u, _ = self.lines.coordinates(points)
        return cKDTree(self(phi, u)).query(points)[0]


Latitude: TypeAlias = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Of angle and radius on the bullseye (n,) in the mesher's own coordinates: latitude (n,)."""


class FittedSurfaces:
    """Endocardium and epicardium with the borders of their levels, for `meshing.write_gmsh`.

    sides: the two as (`FittedSurface`, its latitude as a function of phi and of the bullseye's
    radius rho in the mesher's own coordinates). border_radii (3,): rho of the levels' borders, from
    base to apex.
    """

    def __init__(
        self,
        sides: Sequence[tuple[FittedSurface, Latitude]],
        border_radii: Sequence[float] | np.ndarray,
    ) -> None:
        self._sides, self.border_radii = sides, np.asarray(border_radii)
        self.endo_apex = -sides[0][0].lines.length

    @property
    def sides(self) -> list[FittedSurface]:
        """Endocardium and epicardium, each a `FittedSurface`."""
        return [surface for surface, _ in self._sides]

    @classmethod
    def of_mesh(cls, mesh: Mesh) -> Self:
        """Those of a mesh with tagged segments."""
        owner, skin = facet_cells(mesh), [mesh.surface == s for s in (ENDOCARDIUM, EPICARDIUM)]
        points = [mesh.points[np.unique(mesh.facets[mine])] for mine in skin]
        lines = WallLines.of(points[0])
        surfaces = [FittedSurface(lines, own) for own in points]
        borders = [
            _level_borders(mesh, mesh.facets[mine], mesh.segment[owner[mine]], lines)
            for mine in skin
        ]
        radii = [1 - border.mean / QUARTER for border in borders[0]]
        latitudes = [partial(_latitude, own, radii) for own in borders]
        return cls(list(zip(surfaces, latitudes, strict=True)), radii)

    @classmethod
    def of_lines(
        cls, endocardium: FittedSurface, epicardium: FittedSurface, level_ends: Sequence[float]
    ) -> Self:
        """Those of two `FittedSurface`s on the same lines, whose levels end in planes perpendicular
        to the long axis (`LEAST_LATITUDE`), at these shares (3,) of the cavity's length."""
        radii = (1 - np.arcsin(level_ends) / QUARTER).tolist()
        sides = []
        for surface in (endocardium, epicardium):
            borders = [_border_in_plane(surface, share) for share in level_ends]
            sides.append((surface, partial(_latitude, borders, radii)))
        return cls(sides, radii)

    def wall(
        self, phi: np.ndarray, rho: np.ndarray, t: np.ndarray, _rho_border: float
    ) -> np.ndarray:
        """Points (n, 3) at angle phi, place rho on the bullseye and transmural depth t.

        Lines through the wall are straight.
        """
        inner, outer = (surface(phi, latitude(phi, rho)) for surface, latitude in self._sides)
        return (1 - t)[:, None] * inner + t[:, None] * outer


class LevelBorder:
    """Latitude (rad) of a border between levels, by angle: a Fourier series through edges."""

    def __init__(self, phi: np.ndarray, u: np.ndarray, weight: np.ndarray) -> None:
        root = np.sqrt(weight)
        self._coefficients = np.linalg.lstsq(
            self._waves(phi) * root[:, None], u * root, rcond=None
        )[0]
        self.mean = self._coefficients[0]

    @staticmethod
    def _waves(phi: np.ndarray) -> np.ndarray:
        order = np.arange(1, HARMONICS + 1) * np.asarray(phi)[..., None]
        return np.concatenate([np.ones_like(order[..., :1]), np.cos(order), np.sin(order)], axis=-1)

    def __call__(self, phi: np.ndarray) -> np.ndarray:
        return self._waves(phi) @ self._coefficients


def _border_in_plane(surface: FittedSurface, share: float) -> LevelBorder:
    """Where a surface crosses the plane perpendicular to the long axis at a share of the cavity's
    length; real hearts' stay within 0.1 mm of it. See `LEAST_LATITUDE`."""
    phi = np.linspace(-np.pi, np.pi, 180, endpoint=False)
    least = LEAST_LATITUDE * np.arcsin(share)
    low, high = np.full(len(phi), least), np.full(len(phi), QUARTER)
    for _ in range(40):
        u = (low + high) / 2
        above = surface(phi, u)[:, 2] > -share * surface.lines.length
        low, high = np.where(above, u, low), np.where(above, high, u)
    return LevelBorder(phi, (low + high) / 2, np.ones(len(phi)))


def _latitude(
    borders: Sequence[LevelBorder], radii: Sequence[float], phi: np.ndarray, rho: np.ndarray
) -> np.ndarray:
    """Latitude at the bullseye's radius rho in the mesher's coordinates: it rises towards the pole
    wherever the `borders` (three `LevelBorder`s, at rho = radii) do."""
    # Below the lowest border 1 / g^2 of the gap g to the pole goes over from a cone's, which is the
    # same all around, to the border's own: g grows with f whatever the two are, and its variation
    # with the angle fades towards the pole like f^3.
    f = np.minimum(rho / radii[-1], 1)
    cone, own = QUARTER - borders[-1].mean, QUARTER - borders[-1](phi)
    u = QUARTER - f / np.sqrt((1 - f**2) / cone**2 + f**2 / own**2)
    outer_radius, outer = 1.0, np.zeros_like(phi)
    for border, radius in zip(borders, radii, strict=True):
        here = border(phi)
        share = (rho - radius) / (outer_radius - radius)
        inside = (rho >= radius) & (rho <= outer_radius)
        u = np.where(inside, here + share * (outer - here), u)
        outer_radius, outer = radius, here
    return u


def _level_of(segment: int | np.ndarray) -> np.ndarray:
    """Level 0-3 from base to apex of AHA numbers."""
    return np.searchsorted([numbers[-1] for numbers in LEVELS.values()], segment)


def _level_borders(
    mesh: Mesh, facets: np.ndarray, segment: np.ndarray, lines: WallLines
) -> list[LevelBorder]:
    """The three `LevelBorder`s of a surface, from the edges between facets of two levels."""
    level = _level_of(segment)
    edges = np.sort(facets[:, [[0, 1], [1, 2], [2, 3], [3, 0]]].reshape(-1, 2), axis=1)
    sides = np.repeat(level, 4)
    order = np.lexsort((sides, edges[:, 1], edges[:, 0]))
    edges, sides = edges[order], sides[order]
    twin = np.flatnonzero((edges[1:] == edges[:-1]).all(axis=1))
    borders = []
    for k in range(3):
        here = twin[(sides[twin] == k) & (sides[twin + 1] == k + 1)]
        if len(here) < 2 * HARMONICS + 1:
            names = list(LEVELS)
            raise InputError(
                f"the imported mesh has {len(here)} facets' edges between the {names[k]} and the "
                f"{names[k + 1]} level; segments of neighbouring levels must touch all around"
            )
        ends = mesh.points[edges[here]]
        phi, u, _ = lines.coordinates(ends.mean(axis=1))
        turn = np.diff(np.arctan2(ends[..., 1], ends[..., 0]), axis=1)[:, 0]
        # An edge counts for the angle that it spans: steps of a border count for nothing.
        borders.append(LevelBorder(phi, u, np.abs((turn + np.pi) % (2 * np.pi) - np.pi) + 1e-9))
    angle = np.linspace(-np.pi, np.pi, 361)
    rings = np.stack([0 * angle, *(b(angle) for b in borders), 0 * angle + QUARTER])
    if (np.diff(rings, axis=0) < 0.02).any():
        raise InputError(
            "the levels' borders touch each other; the segments must lie in four levels from base "
            "to apex"
        )
    return borders


def sector_table(mesh: Mesh, surfaces: FittedSurfaces, circumferential: int) -> pd.DataFrame:
    """Segment table (17 rows) of the borders read off a mesh's tags, for `meshing.write_gmsh`.

    Tags lie as `segment_tags.check_segment_places` wants them, which an import has checked.
    A sector's border is the angle that keeps the volumes of the two segments beside it.
    Borders of different levels that would leave less than `SNAP` of an element's width between
    them are made one. z_top_mm and z_bottom_mm only name the rings of `surfaces`.
    """
    corners = mesh.points[mesh.cells[:, :8]]
    angle = np.degrees(np.arctan2(corners[..., 1], corners[..., 0]))
    volume = cell_volumes(mesh)
    middle, lower = middle_angles(mesh, volume), {}
    for name, numbers in LEVELS.items():
        if name == "apex":
            continue
        for s in numbers:
            following, _ = beside(s)
            half = (middle[s] - middle[following]) % 360 / 2
            mine, theirs = mesh.segment == s, mesh.segment == following
            off = (angle - middle[following] - half + 180) % 360 - 180
            cut = _cut(off[mine], volume[mine], off[theirs], volume[theirs])
            lower[s] = (middle[following] + half + cut + 180) % 360 - 180
    return _sectors(joined_borders(lower, SNAP * 360 / circumferential), surfaces)


def _sectors(lower: Mapping[int, float], surfaces: FittedSurfaces) -> pd.DataFrame:
    """Segment table of the sectors' lower borders (by segment, degrees)."""
    heights = [0.0, *(surfaces.endo_apex * np.sin(QUARTER * (1 - surfaces.border_radii)))]
    heights.append(surfaces.endo_apex)
    rows = []
    for segment in SEGMENTS:
        level = int(_level_of(segment.number))
        numbers = list(LEVELS.values())[level]
        low, high = 0.0, 360.0
        if level < 3:
            low = lower[segment.number]
            before = numbers[(segment.number - numbers[0] - 1) % len(numbers)]
            high = low + (lower[before] - low) % 360
        rows.append((segment.number, low, high, heights[level], heights[level + 1]))
    columns = ["aha_segment", "angle_from_deg", "angle_to_deg", "z_top_mm", "z_bottom_mm"]
    return pd.DataFrame(rows, columns=columns)


def aha_sectors(surfaces: FittedSurfaces) -> pd.DataFrame:
    """Segment table (17 rows) of the AHA's sectors, for `meshing.write_gmsh`."""
    lower = {}
    for level, (width, first) in AHA_SECTORS.items():
        for i, segment in enumerate(LEVELS[level]):
            lower[segment] = (first - i * width + 180) % 360 - 180
    return _sectors(lower, surfaces)


def aha_segment_at(phi: float, share: float) -> int:
    """AHA number at an angle (rad) and a share of the cavity's length, as `aha_sectors` and
    `LEVEL_ENDS` divide."""
    level = list(LEVELS)[np.searchsorted(LEVEL_ENDS, share, side="right")]
    width, first = AHA_SECTORS.get(level, (360, 360))
    return LEVELS[level][int((first + width - np.degrees(phi)) % 360 // width)]


def _cut(
    above: np.ndarray, above_volume: np.ndarray, below: np.ndarray, below_volume: np.ndarray
) -> float:
    """Angle with as much volume of `above` below it as of `below` above it.

    `above`, `below` (m, 8): angles of elements' corners, between which their volume (m,) is spread
    evenly. So both sectors keep their volume. Elements further away than 45 degrees are strays,
    which no border can put right.
    """
    near = [(np.abs(corners) < 45).all(axis=1) for corners in (above, below)]
    sides = [(above[near[0]], above_volume[near[0]]), (below[near[1]], below_volume[near[1]])]
    cuts = np.unique(np.round(np.concatenate([corners.ravel() for corners, _ in sides]), 2))
    surplus = np.zeros(len(cuts))
    for wanted, (corners, volume) in zip((0, 1), sides, strict=True):
        first, last = corners.min(axis=1), corners.max(axis=1)
        under = np.clip((cuts[:, None] - first) / (last - first), 0, 1)
        surplus += (under - wanted) @ volume
    return float(np.interp(0.0, surplus, cuts))
