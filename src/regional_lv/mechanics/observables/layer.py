"""Which part of the wall's depth is sampled: a window from one depth to another.

Depth is the transmural coordinate of the unloaded wall, 0 at the endocardium and 1 at the
epicardium.
"""

import numpy as np

from regional_lv.errors import InputError
from regional_lv.geometry.elements import gauss, gauss_shares

THINNEST = 1e-6
"""A window narrower than this is the surface (or the depth) itself."""


def check_layer(inner: float, outer: float) -> None:
    """Raise InputError unless 0 <= inner <= outer <= 1."""
    if not 0 <= inner <= outer <= 1:
        raise InputError(
            f"observables.layer: [{inner:g}, {outer:g}] is no window of the wall; give the inner "
            "depth first, both between 0 (endocardium) and 1 (epicardium)"
        )


def window_weights(depth: np.ndarray, inner: float, outer: float, points: int) -> np.ndarray:
    """What each quadrature point counts for in the mean over a window of depth, (cells, q).

    depth: (cells, 8) of the corners of the reference hexahedra, in VTK's order. points: Gauss
    points along each edge, q = points^3 in the order of `geometry.elements.gauss`. A point's weight
    is 1 if the window holds its cell.

    Along the edges that run through the wall the polynomial through the Gauss points is integrated
    over the part that the window covers: averages change smoothly with the window, and for one that
    shrinks to a surface they become the values there, extrapolated.
    """
    check_layer(inner, outer)
    cells, q = len(depth), points**3
    if inner == 0 and outer == 1:
        return np.ones((cells, q))
    x = gauss(1, points)[0][:, 0]
    low, high, axis = _depths_of_columns(depth, x)
    weights = np.zeros((cells, points, points, points))
    # Reference coordinates, in [-1, 1], between which the window covers each column.
    span = high - low
    width = max(outer - inner, THINNEST)
    begin = min(inner, 1 - width)
    first, last = (np.clip(2 * (edge - low) / span - 1, -1, 1) for edge in (begin, begin + width))
    first, last = np.minimum(first, last), np.maximum(first, last)
    for i, share in enumerate(gauss_shares(first, last, points)):
        for along in range(3):
            mine = axis == along
            at: list[slice | int] = [slice(None)] * 3
            at[along] = i
            weights[(mine, *at)] = share[mine]
    return weights.reshape(cells, q)


def _depths_of_columns(depth: np.ndarray, x: np.ndarray):
    """Depth where a column of Gauss points begins and ends (cells, points, points), and the axis
    (cells,) of the reference hexahedron that runs through the wall."""
    # Corners in VTK's order by their reference coordinates: cube[cell, x, y, z].
    cube = depth[:, [0, 4, 3, 7, 1, 5, 2, 6]].reshape(-1, 2, 2, 2)
    rise = np.stack([np.abs(np.diff(cube, axis=1 + d)).mean(axis=(1, 2, 3)) for d in range(3)], -1)
    axis = rise.argmax(axis=-1)
    shape = np.stack([(1 - x) / 2, (1 + x) / 2])
    low, high = (np.empty((len(depth), len(x), len(x))) for _ in range(2))
    for along in range(3):
        mine = axis == along
        faces = np.moveaxis(cube[mine], 1 + along, 1)
        low[mine], high[mine] = (
            np.einsum("eab,ap,bq->epq", faces[:, side], shape, shape) for side in (0, 1)
        )
    # A column that does not change its depth lies in the window or outside as a whole.
    flat = np.abs(high - low) < THINNEST
    return low, np.where(flat, low + THINNEST, high), axis
