"""How much of each quadrature point belongs to each AHA segment, whose borders may be turned."""

import numpy as np
from scipy import sparse

from regional_lv import aha

# Three Gauss points of [0, 1], and the intervals of which they are the means.
GAUSS = 0.5 + np.array([-1, 0, 1]) * np.sqrt(0.15)
INTERVALS = np.array([0, 5, 13, 18]) / 18


def membership(segment: np.ndarray, points: int) -> sparse.csr_matrix:
    """(17, cells * points): each of a cell's points belongs to the cell's segment (number less
    one) as a whole."""
    rows = np.repeat(segment, points)
    at = np.arange(len(rows))
    return sparse.csr_matrix((np.ones(len(rows)), (rows, at)), (len(aha.SEGMENTS), len(rows)))


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
