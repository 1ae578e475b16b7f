"""How much of each quadrature point belongs to each AHA segment, whose borders may be turned."""

import numpy as np
from scipy import sparse

from regional_lv import aha
from regional_lv.geometry.elements import POINTS_PER_EDGE, gauss, gauss_shares


def membership(segment: np.ndarray, points: int) -> sparse.csr_matrix:
    """(17, cells * points): each of a cell's points belongs to the cell's segment (number less
    one) as a whole."""
    rows = np.repeat(segment, points)
    at = np.arange(len(rows))
    return sparse.csr_matrix((np.ones(len(rows)), (rows, at)), (len(aha.SEGMENTS), len(rows)))


def turned_membership(angle, cell, corner_angle, segment, rotation: float) -> sparse.csr_matrix:
    """Share (17, points) of each quadrature point that lies in each segment, borders turned.

    angle (points,) rad and cell (points,) of the points; corner_angle (cells, 8); segment (cells,)
    number less one; rotation in rad. Around the axis, the polynomial through a cell's Gauss points
    is integrated over the part that a segment's turned arc covers, as `layer.window_weights` does
    over the depth: the averages change smoothly with the rotation, and at 0 they are the cells' if
    mesh lines lie on the segments' borders. Segments keep their level, the apex (17) is one whole.
    """
    centre = np.angle(np.exp(1j * corner_angle).mean(axis=1))
    extent = _wrapped(corner_angle - centre[:, None])
    low, high = extent.min(axis=1), extent.max(axis=1)
    half, middle = (high - low) / 2, centre + (low + high) / 2
    reference = _wrapped(angle - middle[cell]) / half[cell]
    which = np.abs(reference[:, None] - gauss(1, POINTS_PER_EDGE)[0].T).argmin(axis=1)

    table = np.zeros((len(aha.SEGMENTS), len(angle)))
    for numbers in aha.LEVELS.values():
        level = np.isin(segment, np.array(numbers) - 1)
        mine = level[cell]
        if len(numbers) == 1:
            table[numbers[0] - 1, mine] = 1.0
            continue
        # Places of the level's cells among themselves.
        at_level = (np.cumsum(level) - 1)[cell[mine]]
        for number in numbers:
            own = segment == number - 1
            at = np.angle(np.exp(1j * centre[own]).mean())
            first = (_wrapped(centre[own] - at) + low[own]).min()
            last = (_wrapped(centre[own] - at) + high[own]).max()
            # Reference coordinates, in [-1, 1], between which the arc covers the cells.
            gap = _wrapped(middle[level] - at - rotation)
            begin, end = (np.clip((edge - gap) / half[level], -1, 1) for edge in (first, last))
            shares = gauss_shares(begin, end, POINTS_PER_EDGE)
            table[number - 1, mine] = shares[which[mine], at_level]
    return sparse.csr_matrix(table / table.sum(axis=0))


def _wrapped(angle):
    """To (-pi, pi]."""
    return np.pi - (np.pi - angle) % (2 * np.pi)
