"""Smooth endocardium and epicardium through the figures of a segment table.

A point of the wall's two surfaces is named by a latitude `u` (0 at the base, pi/2 at
the apex) and an angle `phi`, or by its place on the bullseye: the unit disk with the apex in the
centre and the base as its rim,

    X = (1 - 2 u / pi) cos(phi),        Y = (1 - 2 u / pi) sin(phi).

With the endocardial apex at z = -c the endocardium is a generalised ellipsoid

    r = R(X, Y) cos(u),                 z = -c sin(u),

and the epicardium lies at the wall thickness T(X, Y) from it, along the line that would join the
points of equal latitude of two ellipsoids of revolution, the epicardial one with its apex at
z = -c_epi and the table's mean thickness:

    r_epi = r + T cos(w),   z_epi = z - T sin(w),   tan(w) = (c_epi - c) / mean(T) tan(u).

R and T are polynomials in X and Y, softly kept positive: on such a disk an angular harmonic of
order m fades at least like the m-th power of the distance from the pole, so both surfaces are
smooth there. Their coefficients minimise the energy of a thin plate under tension, subject to the
table's averages and, for T, to the distance of the two apices with zero slope at the pole.

What the table's figures mean: `endo_radius_mm` is the endocardium's distance from the long
axis and `wall_thickness_mm` is T; both are means over the segment's range of angle and latitude.
"""

from collections.abc import Callable
from functools import cache, lru_cache
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np
import pandas as pd
from numpy.polynomial import chebyshev, legendre
from scipy import sparse
from scipy.linalg import eigh

from regional_lv.errors import InputError

# Polynomials of this degree resolve six sectors and four levels; more changes nothing visible.
DEGREE = 12
# Weight of the squared slope beside the squared second derivatives, and the softness of the bound
# that keeps R and T positive, as a share of their mean: both against overshoot.
TENSION = 100.0
SOFTNESS = 0.2
QUARTER = np.pi / 2
RING = np.linspace(0, 4 * QUARTER, 90, endpoint=False)  # angles around a border
STEP = 1e-5  # rad, of differences along the latitude
VOLUME_NODES = 40  # along the latitude, of the volumes

Changes: TypeAlias = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Of bullseye points X, Y (n,): derivatives (n, m) of a field with respect to m figures."""


class Latitudes(NamedTuple):
    """Of lines through the wall: latitudes (n,) of their ends on endocardium and epicardium, of the
    `plane`, where the epicardium meets the plane of their level or of the last one above them, and
    of the `ring`, the same at the angles `RING` around the last level's end; None if no line lies
    below it."""

    endo: np.ndarray
    epi: np.ndarray
    plane: np.ndarray
    ring: np.ndarray | None


class Wall(Protocol):
    """What a mesh is moved onto: `Surfaces`, or `fitted.FittedSurfaces`. endo_apex: its z (mm)."""

    endo_apex: float

    def wall(
        self, phi: np.ndarray, rho: np.ndarray, t: np.ndarray, rho_border: float, /
    ) -> np.ndarray:
        """Points (n, 3), as of `Surfaces.wall`."""


def polynomials(
    x: np.ndarray, y: np.ndarray, dx: int = 0, dy: int = 0, degree: int = DEGREE
) -> np.ndarray:
    """Chebyshev products of this total degree at (n,) points, or a derivative: (n, basis)."""
    px, py = (_chebyshev(at, order, degree) for at, order in ((x, dx), (y, dy)))
    return np.concatenate([row * py[: degree + 1 - i] for i, row in enumerate(px)]).T


def _chebyshev(x: np.ndarray, order: int, degree: int) -> np.ndarray:
    """Derivatives (degree + 1, n) of this order of the polynomials at (n,) points."""
    values = chebyshev.chebvander(x, degree - order).T
    return chebyshev.chebder(np.eye(degree + 1), order).T @ values if order else values


def powers(degree: int) -> list[tuple[int, int]]:
    """Orders (i, j) of the Chebyshev products of this total degree."""
    return [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]


def bullseye(phi: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rho = 1 - u / QUARTER
    return rho * np.cos(phi), rho * np.sin(phi)


@cache
def _smooth_modes() -> tuple[np.ndarray, np.ndarray]:
    """(modes, energies): combinations of the polynomials, orthonormal on the disk, by roughness.

    The energy is that of a thin plate under tension: the integral over the unit disk of
    f_XX^2 + 2 f_XY^2 + f_YY^2 + TENSION (f_X^2 + f_Y^2).
    """
    nodes, weights = legendre.leggauss(DEGREE + 2)
    radius, angle = np.meshgrid((nodes + 1) / 2, np.arange(4 * DEGREE) * QUARTER / DEGREE)
    weight = np.broadcast_to(weights * (nodes + 1), radius.shape).ravel()
    x, y = (radius * np.cos(angle)).ravel(), (radius * np.sin(angle)).ravel()

    def gram(*order: int) -> np.ndarray:
        values = polynomials(x, y, *order)
        return (values * weight[:, None]).T @ values

    plate = gram(2, 0) + 2 * gram(1, 1) + gram(0, 2)
    energies, modes = eigh(plate + TENSION * (gram(1, 0) + gram(0, 1)), gram(0, 0))
    # The constant has no energy; this little (the next has 345) lets one divide by it.
    return modes, np.maximum(energies, 1.0)


def _totals(average: sparse.csr_matrix) -> np.ndarray:
    """Sums of the rows (m,) of a sparse matrix."""
    return np.asarray(average.sum(axis=1)).ravel()


class Field:
    """Positive smooth function on the bullseye with given averages.

    F = s log(1 + exp(f / s)), which is f where f is well above s, with the polynomial f of least
    energy for which `average @ F` equals `values`. `average` (m, q), sparse, holds weights at the q
    bullseye points where the smooth modes are `basis` (q, modes). `apex` optionally fixes F in the
    centre, with zero slope. `settled` tells whether such a function was found. `sharp` makes it
    that of least energy to round-off, which derivatives need: the averages are met, to the square
    of what it still moves, long before.
    """

    def __init__(
        self,
        basis: np.ndarray,
        average: sparse.csr_matrix,
        values: np.ndarray,
        apex: float | None = None,
        sharp: bool = False,
    ) -> None:
        modes, energies = _smooth_modes()
        self._mean = (values / _totals(average)).mean()
        self._scale = SOFTNESS * self._mean
        fixed, right = np.zeros((0, len(energies))), np.zeros(0)
        if apex is not None:
            centre, orders = np.zeros(1), ((0, 0), (1, 0), (0, 1))
            fixed = np.concatenate([polynomials(centre, centre, *o) for o in orders]) @ modes
            centre_value = self._scale * np.log(np.expm1(apex / self._scale))
            right = np.array([centre_value - self._mean, 0.0, 0.0])
        # f is sought as a deviation from the mean, so that the constant's share stays small.
        f = np.full(len(basis), self._mean)
        coefficients = None
        last: np.ndarray | float = np.inf
        self._problem = basis, energies, average, fixed, apex
        # Least energy under the constraints linearised about the last f, until they hold.
        for _ in range(200):
            slope = average.multiply(self._slope(f)).tocsr()
            gap = values - average @ self._bend(f)
            still = not sharp or np.abs(f - last).max() < 1e-11 * self._mean
            if coefficients is not None and np.abs(gap).max() < 1e-8 * values.max() and still:
                break
            last = f
            rows = np.concatenate([slope @ basis, fixed])
            target = np.concatenate([gap + slope @ (f - self._mean), right])
            scaled = rows / energies
            self._multipliers = np.linalg.solve(scaled @ rows.T, target)
            coefficients = scaled.T @ self._multipliers
            f = self._mean + basis @ coefficients
        self.settled = bool(np.abs(gap).max() < 1e-4 * values.max())
        self._coefficients = modes @ coefficients

    def _bend(self, f: np.ndarray) -> np.ndarray:
        return self._scale * np.logaddexp(0, f / self._scale)

    def __call__(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return self._bend(self._mean + polynomials(x, y) @ self._coefficients)

    def changes(self) -> Changes:
        """Derivatives of the field with respect to its values (m), and to `apex` if it has one.

        Returns a function of bullseye points X, Y (n,) that gives them, (n, m) or (n, m + 1). They
        follow from the conditions of the least energy, differentiated.
        """
        basis, energies, average, fixed, apex = self._problem
        values, pinned = average.shape[0], len(fixed)
        f = self._mean + basis @ np.linalg.solve(_smooth_modes()[0], self._coefficients)
        scale, slope = self._scale, self._slope(f)
        # The mean of the values moves f and the softness; each value has its part in it.
        of_mean = np.concatenate([1 / _totals(average) / values, np.zeros(int(pinned > 0))])
        bent = slope + SOFTNESS * self._by_scale(f)
        curved = slope * (1 - slope) / scale
        load = average.T @ self._multipliers[:values]
        rows = np.concatenate([average.multiply(slope).tocsr() @ basis, fixed])
        tangent = np.diag(energies) - (basis.T * (load * curved)) @ basis
        zeros = np.zeros((len(rows), len(rows)))
        right = np.zeros((len(energies) + len(rows), len(of_mean)))
        right[: len(energies)] = np.outer(
            basis.T @ (load * curved * (1 - SOFTNESS * f / scale)), of_mean
        )
        right[len(energies) :][:values, :values] = np.eye(values)
        right[len(energies) :][:values] -= np.outer(average @ bent, of_mean)
        if pinned:
            ratio = apex / scale
            by_apex = 1 / -np.expm1(-ratio)
            right[len(energies) + values, -1] = by_apex
            by_mean = SOFTNESS * (np.log(np.expm1(ratio)) - ratio * by_apex) - 1
            right[len(energies) + values] += by_mean * of_mean
        matrix = np.block([[tangent, -rows.T], [rows, zeros]])
        moved = _smooth_modes()[0] @ np.linalg.solve(matrix, right)[: len(energies)]

        def at(x: np.ndarray, y: np.ndarray) -> np.ndarray:
            basis = polynomials(x, y)
            f = self._mean + basis @ self._coefficients
            by_mean = self._slope(f) + SOFTNESS * self._by_scale(f)
            return self._slope(f)[:, None] * (basis @ moved) + np.outer(by_mean, of_mean)

        return at

    def _slope(self, f: np.ndarray) -> np.ndarray:
        """dF/df."""
        return 1 / (1 + np.exp(-f / self._scale))

    def _by_scale(self, f: np.ndarray) -> np.ndarray:
        """dF/ds."""
        return self._bend(f) / self._scale - self._slope(f) * f / self._scale


@lru_cache(maxsize=8)
def _averages(
    parts: tuple[tuple[float, float, float, float], ...],
) -> tuple[np.ndarray, np.ndarray, sparse.csr_matrix, np.ndarray]:
    """Gauss points of segments from angle to angle and from latitude to latitude, `parts`, m of
    them: angles and latitudes (q,), weights of the averages (m, q), and the smooth modes
    (q, modes)."""
    nodes, weights = legendre.leggauss(12)
    points = []
    for i, (low, high, top, bottom) in enumerate(parts):
        pieces = max(1, round((high - low) / np.radians(60)))
        edges = np.linspace(low, high, pieces + 1)
        angles = ((edges[1:] + edges[:-1])[:, None] + np.diff(edges)[:, None] * nodes) / 2
        phi, u = np.meshgrid(angles.ravel(), (top + bottom + (bottom - top) * nodes) / 2)
        weight = np.outer(weights, np.tile(weights, pieces))
        points.append([a.ravel() for a in (phi, u, weight, np.full(phi.shape, i))])
    phi, u, weight, row = (np.concatenate(column) for column in zip(*points, strict=True))
    weight = weight / np.bincount(row, weight)[row]
    average = sparse.csr_matrix((weight, (row, np.arange(len(phi)))))
    return phi, u, average, polynomials(*bullseye(phi, u)) @ _smooth_modes()[0]


class Surfaces:
    """Smooth endocardium and epicardium through the averages of a segment table.

    Arguments: the table of `read_segments` and the z of the two apices (mm). Methods take arrays
    of angles `phi` (rad) and latitudes `u` (rad, 0 base to pi/2 apex) of one shape and give mm.
    `sharp` is for those that are differentiated (`Field`).
    Raises InputError if the smoothest surfaces leave no cavity or no wall somewhere.
    """

    def __init__(
        self, table: pd.DataFrame, endo_apex_z_mm: float, epi_apex_z_mm: float, sharp: bool = False
    ) -> None:
        self.endo_apex, self.epi_apex = endo_apex_z_mm, epi_apex_z_mm
        thickness = table["wall_thickness_mm"].to_numpy(float)
        self._tilt = (endo_apex_z_mm - epi_apex_z_mm) / thickness.mean()
        _, u, average, basis = _averages(self._parts(table))
        radius = table["endo_radius_mm"].to_numpy(float)
        self._radius = Field(basis, average.multiply(np.cos(u)).tocsr(), radius, sharp=sharp)
        # At the pole T is the distance of the apices and has no slope, so that both surfaces are
        # perpendicular to the long axis there.
        apex = endo_apex_z_mm - epi_apex_z_mm
        self._thickness = Field(basis, average, thickness, apex, sharp)
        for what, field in (
            ("endo_radius_mm", self._radius),
            ("wall_thickness_mm", self._thickness),
        ):
            if not field.settled:
                raise InputError(
                    f"segment table: no smooth surface goes through the {what} column; look for a "
                    "value that differs too much from its neighbours'"
                )

    def _parts(self, table: pd.DataFrame) -> tuple[tuple[float, float, float, float], ...]:
        """Angles and latitudes of a table's segments, as `_averages` takes them."""
        angles = np.radians(table[["angle_from_deg", "angle_to_deg"]].to_numpy(float)).T.tolist()
        # Shapes of one table differ by round-off here, and share what is made of it.
        ends = (self.latitude(table[z]).round(13).tolist() for z in ("z_top_mm", "z_bottom_mm"))
        return tuple(zip(*angles, *ends, strict=True))

    def segment_means(
        self, table: pd.DataFrame
    ) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Means of thickness and endocardial radius (m,) over the segments of another table, and
        their derivatives with respect to the own figures (m, own) of the same kind."""
        phi, u, average, _ = _averages(self._parts(table))
        at, cos = bullseye(phi, u), np.cos(u)
        thickness, radius = self._thickness.changes()(*at), self._radius.changes()(*at)
        return (
            (average @ self.thickness(phi, u), average @ thickness[:, :-1]),
            (average @ self.radius(phi, u), average @ (cos[:, None] * radius)),
        )

    def latitude(self, z: np.ndarray) -> np.ndarray:
        """Latitude of the endocardium at height z; pi/2 below its apex."""
        return np.arcsin(np.clip(z / self.endo_apex, 0, 1))

    def radius(self, phi: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Distance of the endocardium from the long axis."""
        return self._radius(*bullseye(phi, u)) * np.cos(u)

    def thickness(self, phi: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Wall thickness T."""
        return self._thickness(*bullseye(phi, u))

    def endocardium(self, phi: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(r, z) of the endocardium."""
        return self.radius(phi, u), self.endo_apex * np.sin(u)

    def epicardium(self, phi: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(r, z) of the epicardium."""
        cosine, sine = np.cos(u), self._tilt * np.sin(u)
        length = np.hypot(cosine, sine)
        thickness = self.thickness(phi, u)
        r, z = self.endocardium(phi, u)
        return r + thickness * cosine / length, z - thickness * sine / length

    def volumes(self) -> tuple[float, float]:
        """Of the cavity and of the wall (mL), between the surfaces and the base plane."""
        nodes, weights = legendre.leggauss(VOLUME_NODES)
        phi, u = np.meshgrid(RING, QUARTER * (nodes + 1) / 2)
        weight = (weights * QUARTER / 2)[:, None] * (4 * QUARTER / len(RING))
        found = []
        for surface in (self.endocardium, self.epicardium):
            along = (surface(phi, u - STEP)[1] - surface(phi, u + STEP)[1]) / (2 * STEP)
            found.append(float((weight * surface(phi, u)[0] ** 2 / 2 * along).sum()) / 1e3)
        return found[0], found[1] - found[0]

    def _epicardial_height(self, phi: np.ndarray, u: np.ndarray) -> np.ndarray:
        cosine, sine = np.cos(u), self._tilt * np.sin(u)
        return self.endo_apex * np.sin(u) - self.thickness(phi, u) * sine / np.hypot(cosine, sine)

    def epicardial_latitude(self, phi: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Latitude at which the epicardium crosses the height z, by the Illinois algorithm (Dowell
        and Jarratt 1971, doi 10.1007/BF01934364): a bracket's line, halved where one end stays."""
        low, high = np.zeros(np.shape(phi)), np.full(np.shape(phi), QUARTER)
        at_low, at_high = (self._epicardial_height(phi, u) - z for u in (low, high))
        before = None
        for _ in range(50):
            gap = at_low - at_high
            share = np.divide(at_low, gap, np.zeros_like(gap), where=gap > 0)
            middle = low + share * (high - low)
            here = self._epicardial_height(phi, middle) - z
            if np.abs(here).max(initial=0.0) < 1e-13 * np.abs(self.endo_apex):
                break
            above = here > 0
            if before is not None:
                at_high = np.where(above & before, at_high / 2, at_high)
                at_low = np.where(~above & ~before, at_low / 2, at_low)
            low, at_low = np.where(above, middle, low), np.where(above, here, at_low)
            high, at_high = np.where(above, high, middle), np.where(above, at_high, here)
            before = above
        return middle

    def wall(
        self, phi: np.ndarray, rho: np.ndarray, t: np.ndarray, rho_border: float
    ) -> np.ndarray:
        """Points (n, 3) at angle phi, distance rho from the bullseye's centre, transmural depth t.

        From the base (rho = 1) to `rho_border` the lines through the wall are horizontal, so that
        the borders between levels are short-axis planes. Below, they fan out and join the apices.
        """
        (r0, z0), (r1, z1) = self.ends(phi, rho, rho_border)
        r, z = (1 - t) * r0 + t * r1, (1 - t) * z0 + t * z1
        return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)

    def ends(
        self, phi: np.ndarray, rho: np.ndarray, rho_border: float
    ) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """(r, z) of both ends, on endocardium and epicardium, of the lines through the wall."""
        at = self.latitudes(phi, rho, rho_border)
        return self.endocardium(phi, at.endo), self.epicardium(phi, at.epi)

    def latitudes(self, phi: np.ndarray, rho: np.ndarray, rho_border: float) -> Latitudes:
        """`Latitudes` of the lines through the wall at angle phi and place rho on the bullseye."""
        u_endo = QUARTER * (1 - rho)
        u_border = QUARTER * (1 - rho_border)
        plane = self.endo_apex * np.sin(np.minimum(u_endo, u_border))
        u_epi = u_plane = self.epicardial_latitude(phi, plane)
        u_ring = None
        lower = rho < rho_border
        if lower.any():
            z_border = np.full(len(RING), self.endo_apex * np.sin(u_border))
            u_ring = self.epicardial_latitude(RING, z_border)
            mean = QUARTER - u_ring.mean()
            # The angular variation of the epicardial border fades towards the pole like f^3.
            f = rho / rho_border
            gap = f * mean + f**3 * (QUARTER - u_epi - mean)
            u_epi = np.where(lower, QUARTER - gap, u_epi)
        return Latitudes(u_endo, u_epi, u_plane, u_ring)

    # ------------------------------------------- derivatives with respect to the table

    def changes_of_ends(
        self, phi: np.ndarray, rho: np.ndarray, rho_border: float, latitudes: Latitudes
    ) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Derivatives of what `ends` gives with respect to the table's figures: ((r, z), (r, z)),
        each (n, 2 m + 2).

        The figures are the wall thickness (m) and the endocardial radius (m) of the segments, the
        length, with which all heights of levels go, and the thickness of the wall at the apex.
        latitudes: what `latitudes` gave of the same places.
        """
        radius, thickness = self._radius.changes(), self._thickness.changes()
        u_endo, u_epi, u_plane, u_ring = latitudes
        u_border = QUARTER * (1 - rho_border)

        def at_plane(phi: np.ndarray, u: np.ndarray, u_endo: float | np.ndarray) -> np.ndarray:
            """Derivatives of the epicardial latitude `u` at the height of an endocardial one."""
            _, z, _, z_along = self._epicardial_changes(phi, u, radius, thickness)
            z[:, -2] += np.sin(u_endo)  # the plane goes down with the length
            return -z / z_along[:, None]

        along = at_plane(phi, u_plane, np.minimum(u_endo, u_border))
        if u_ring is not None:
            f = np.minimum(rho / rho_border, 1.0)[:, None]
            mean = at_plane(RING, u_ring, u_border).mean(axis=0)
            along = np.where(f < 1, f * mean + f**3 * (along - mean), along)
        r, z, r_along, z_along = self._epicardial_changes(phi, u_epi, radius, thickness)
        outer = r + r_along[:, None] * along, z + z_along[:, None] * along
        return self._endocardial_changes(phi, u_endo, radius, outer[0].shape), outer

    def _endocardial_changes(
        self, phi: np.ndarray, u: np.ndarray, radius: Changes, shape: tuple[int, int]
    ) -> tuple[np.ndarray, np.ndarray]:
        r, z = np.zeros(shape), np.zeros(shape)
        segments = shape[1] // 2 - 1
        r[:, segments:-2] = radius(*bullseye(phi, u)) * np.cos(u)[:, None]
        z[:, -2] = -np.sin(u)
        return r, z

    def _epicardial_changes(
        self, phi: np.ndarray, u: np.ndarray, radius: Changes, thickness: Changes
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives of (r, z) at given latitudes with respect to the figures, and along the
        latitude."""
        by_thickness = thickness(*bullseye(phi, u))
        segments = by_thickness.shape[1] - 1
        r, z = self._endocardial_changes(phi, u, radius, (len(u), 2 * segments + 2))
        cosine, sine = np.cos(u), np.sin(u)
        length = np.hypot(cosine, self._tilt * sine)
        # Of the thickness and of the tilt, which goes with the mean thickness and the apex.
        mean = (self.endo_apex - self.epi_apex) / self._tilt
        tilt = np.append(np.full(segments, -self._tilt / mean / segments), 1 / mean)
        by_tilt = self.thickness(phi, u) * cosine * sine / length**3
        at = [*range(segments), -1]
        r[:, at] += by_thickness * (cosine / length)[:, None]
        r[:, at] -= np.outer(by_tilt * self._tilt * sine, tilt)
        z[:, at] -= by_thickness * (self._tilt * sine / length)[:, None]
        z[:, at] -= np.outer(by_tilt * cosine, tilt)
        ahead, behind = self.epicardium(phi, u + STEP), self.epicardium(phi, u - STEP)
        along = ((a - b) / (2 * STEP) for a, b in zip(ahead, behind, strict=True))
        return r, z, *along
