"""Strains averaged over the AHA segments, whose borders may be turned against the mesh."""

import numpy as np
import ufl
from scipy import sparse

from regional_lv import aha
from regional_lv.mechanics import dolfinx_api as api

# Three Gauss points of [0, 1], and the intervals of which they are the means.
GAUSS = 0.5 + np.array([-1, 0, 1]) * np.sqrt(0.15)
INTERVALS = np.array([0, 5, 13, 18]) / 18


class Averages:
    """Volume averages over the segments of UFL strains, and of their derivatives.

    Parameters
    ----------
    segment: number of each cell's segment less one.
    strains: three scalar expressions; weight: 1 where the wall counts, else 0.
    fields: the field that the strains depend on, and the function along which derivatives are
        taken.
    rotation_deg: angle by which the segments' borders are turned, counter-clockwise seen from the
        base; 0 takes cells as a whole.
    """

    def __init__(self, domain, segment, strains, weight, dx, fields, rotation_deg=0.0):
        self._segment, turned = segment, rotation_deg != 0
        make = api.quadrature_space if turned else _cellwise_space
        test = ufl.TestFunction(make(domain, dx, 3))
        strain = weight * ufl.inner(ufl.as_vector(strains), test) * dx
        self._strain = api.compile_form(strain)
        self._derivative = api.compile_form(ufl.derivative(strain, *fields))
        scalar = make(domain, dx, 1)
        self._size = len(api.fem.Function(scalar).x.array)
        volumes = self._assembled(weight * ufl.TestFunction(scalar) * dx)
        self._membership = None
        if turned:
            self._membership = turned_membership(
                *_sample_points(domain, scalar, dx, self._size), segment, np.deg2rad(rotation_deg)
            )
        self.volume = self._sums(volumes)

    def means(self) -> np.ndarray:
        """(51,): each strain in turn, by segment."""
        return self._means(self._strain)

    def derivatives(self) -> np.ndarray:
        """(51,): derivatives of `means` along the second of the fields."""
        return self._means(self._derivative)

    def _means(self, form) -> np.ndarray:
        values = api.assemble_vector(np.zeros(3 * self._size), form).reshape(-1, 3)
        return (np.stack([self._sums(column) for column in values.T]) / self.volume).ravel()

    def _assembled(self, form) -> np.ndarray:
        return api.assemble_vector(np.zeros(self._size), api.compile_form(form))

    def _sums(self, values: np.ndarray) -> np.ndarray:
        """Sums (17,) over the segments of integrals over cells, or about quadrature points."""
        if self._membership is None:
            return np.bincount(self._segment, values, minlength=len(aha.SEGMENTS))
        return self._membership @ values


def _cellwise_space(domain, dx, components: int):
    return api.space(domain, "DG", 0, components)


def _sample_points(domain, scalar, dx, size: int):
    """Angles (points,) of the quadrature points, and the cell (points,) of each."""
    x, test = ufl.SpatialCoordinate(domain), ufl.TestFunction(scalar)
    sums = [api.assemble_vector(np.zeros(size), api.compile_form(x[i] * test * dx)) for i in (0, 1)]
    cells = len(domain.topology.original_cell_index)
    cell = np.empty(size, dtype=int)
    for c in range(cells):
        cell[scalar.dofmap.cell_dofs(c)] = c
    corners = api.cell_corners(domain)
    return np.arctan2(sums[1], sums[0]), cell, np.arctan2(corners[..., 1], corners[..., 0])


def turned_membership(angle, cell, corner_angle, segment, rotation: float) -> sparse.csr_matrix:
    """Share (17, points) of each quadrature point that lies in each segment, borders turned.

    angle (points,) rad and cell (points,) of the points; corner_angle (cells, 8); segment (cells,)
    number less one; rotation in rad. A point stands for the part of its cell's angular extent of
    which it is the Gauss point, and counts with the share of it that a segment's turned arc covers:
    the averages change continuously with the rotation, and at 0 they are the cells' if mesh lines
    lie on the segments' borders. Segments keep their level, the apex (17) is one whole.
    """
    centre = np.angle(np.exp(1j * corner_angle).mean(axis=1))
    extent = _wrapped(corner_angle - centre[:, None])
    low, high = extent.min(axis=1), extent.max(axis=1)
    share = (_wrapped(angle - centre[cell]) - low[cell]) / (high - low)[cell]
    which = np.abs(share[:, None] - GAUSS).argmin(axis=1)
    width = (high - low)[cell] * np.diff(INTERVALS)[which]
    middle = centre[cell] + low[cell]
    middle += (high - low)[cell] * (INTERVALS[which] + INTERVALS[which + 1]) / 2

    table = np.zeros((len(aha.SEGMENTS), len(angle)))
    for numbers in aha.LEVELS.values():
        mine = np.isin(segment[cell], np.array(numbers) - 1)
        if len(numbers) == 1:
            table[numbers[0] - 1, mine] = 1.0
            continue
        for number in numbers:
            own = segment == number - 1
            at = np.angle(np.exp(1j * centre[own]).mean())
            first = (_wrapped(centre[own] - at) + low[own]).min()
            last = (_wrapped(centre[own] - at) + high[own]).max()
            gap = _wrapped(middle[mine] - at - rotation)
            half = width[mine] / 2
            covered = np.minimum(gap + half, last) - np.maximum(gap - half, first)
            table[number - 1, mine] = np.clip(covered / width[mine], 0.0, 1.0)
    return sparse.csr_matrix(table / table.sum(axis=0))


def _wrapped(angle):
    """To (-pi, pi]."""
    return np.angle(np.exp(1j * angle))
