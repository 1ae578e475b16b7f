"""Climbing within bounds, against SciPy's bounded least squares."""

import numpy as np
import pytest
import torch
from scipy.optimize import lsq_linear

from regional_lv.inference.optimise import maximise

ROWS = 40


@pytest.mark.parametrize("size", [2, 8, 30])
@pytest.mark.parametrize("distance", [0.5, 1.5])
def test_maxima_at_the_ends_of_correlated_coordinates_are_found(size, distance):
    """A step that is merely cut off at an end can lead downhill where coordinates go together."""
    rng = np.random.default_rng(size)
    root = rng.normal(size=(ROWS, size, size)) * np.exp(1.5 * rng.normal(size=(ROWS, 1, size)))
    root = np.concatenate([root, np.broadcast_to(0.03 * np.eye(size), root.shape)], 1)
    top = distance * rng.normal(size=(ROWS, size))
    sides = np.einsum("mij,mj->mi", root, top)
    best = [
        -lsq_linear(a, b, (-1, 1), method="bvls").cost for a, b in zip(root, sides, strict=True)
    ]
    curvature, middle = torch.tensor(root.swapaxes(1, 2) @ root), torch.tensor(top)

    def value(rows, x):
        gap = x - middle[rows]
        return -0.5 * torch.einsum("mi,mij,mj->m", gap, curvature[rows], gap)

    def derivatives(rows, x):
        return -torch.einsum("mij,mj->mi", curvature[rows], x - middle[rows]), curvature[rows]

    one = torch.ones(size, dtype=torch.float64)
    x, found, left = maximise(value, derivatives, 0 * middle, -one, one, 50, 1e-6)
    assert not len(left)
    assert (x.abs() <= 1).all()
    np.testing.assert_allclose(found, best, rtol=1e-6, atol=1e-4)
    assert (x.abs() == 1).any()  # ends are part of the question


def test_a_row_whose_first_step_is_cut_to_nothing_goes_on():
    """At ends where the coordinates are pushed inwards one by one, but not all together."""
    root = np.array([[0.7, -1.4, -0.4], [1.9, -1.6, -2.3], [-0.2, 0.2, 0.3], [-0.7, 1.1, 0.8]])
    side = np.array([1.5, 8.0, -1.0, -2.6])
    curvature, gradient = torch.tensor(root.T @ root), torch.tensor(root.T @ side)
    start, zero = torch.tensor([[0.0, 1.0, 0.0]]).double(), torch.zeros(3).double()
    _, found, _ = maximise(
        lambda rows, x: ((gradient - 0.5 * x @ curvature) * x).sum(-1),
        lambda rows, x: (gradient - x @ curvature, curvature.repeat(len(x), 1, 1)),
        *(start, zero, zero + 1, 60, 1e-10),
    )
    best = lsq_linear(root, side, (0, 1), method="bvls")
    assert float(found[0]) == pytest.approx(0.5 * side @ side - best.cost, abs=1e-6)
