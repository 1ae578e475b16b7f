"""Fields predicted from solutions and their tangents, on a field that is known everywhere."""

import numpy as np
import pytest
from scipy.stats import qmc

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.mechanics.derivative_kernel import joint_covariance
from regional_lv.mechanics.predictor import (
    Known,
    Predictor,
    load_predictors,
    save_predictors,
)

rng = np.random.default_rng(3)
# As in a ventricle, most of what moves comes from one zone, and a little from all others.
MIXES = rng.normal(size=(6, 10)) / 10
for zone in range(5):
    MIXES[zone, 2 * zone : 2 * zone + 2] *= 5
COORDINATES = StiffnessInputs().coordinates
SHAPES = rng.normal(size=(6, 300))


def field(theta):
    """A smooth field (300,) of theta (10,), and d(field)/d(log theta) (10, 300)."""
    logs = np.log(theta)
    bumps = np.exp(-0.5 * (MIXES @ logs))
    return bumps @ SHAPES, (-0.5 * bumps[:, None] * MIXES).T @ SHAPES


def points(n, seed):
    return np.exp(np.log(0.1) + np.log(50) * qmc.Sobol(10, seed=seed).random(n))


@pytest.fixture(scope="module")
def anchors():
    thetas = points(32, seed=1)
    solved = [field(theta) for theta in thetas]
    return thetas, np.stack([f for f, _ in solved]), np.stack([t for _, t in solved])


@pytest.fixture(scope="module")
def known(anchors):
    found = Known(300, COORDINATES)
    for theta, value, tangents in zip(*anchors, strict=True):
        found.add(theta, value, tangents)
    return found


def error(guess, thetas):
    exact = np.stack([field(theta)[0] for theta in thetas])
    guessed = np.stack([guess.field(theta) for theta in thetas])
    return np.linalg.norm(guessed - exact) / np.linalg.norm(exact)


def test_known_fields_are_found_again(known, anchors):
    assert error(known, anchors[0]) < 1e-4


def test_other_fields_are_near(known, anchors):
    """Far nearer than the nearest solution with its tangents, from which one would start else."""
    others = points(16, seed=2)

    class Nearest:
        def field(self, theta):
            way = np.log(theta) - np.log(anchors[0])
            row = (way**2).sum(axis=1).argmin()
            return anchors[1][row] + way[row] @ anchors[2][row]

    assert error(known, others) < 0.2 * error(Nearest(), others)


def test_the_compressed_predictor_says_the_same(known, anchors, tmp_path):
    predictor = Predictor.fit(*anchors, COORDINATES)
    save_predictors({1.0: predictor, 1 / 3: predictor}, tmp_path / "predictor.npz")
    loaded = load_predictors(tmp_path / "predictor.npz", COORDINATES)
    assert list(loaded) == [1.0, 1 / 3]
    again = loaded[1.0]
    for theta in points(4, seed=4):
        np.testing.assert_allclose(again.field(theta), known.field(theta), rtol=0, atol=1e-3)


def test_nearest_and_distance(known, anchors):
    beside = anchors[0][5] * np.exp(0.01)
    np.testing.assert_allclose(known.nearest(beside), anchors[0][5])
    assert known.distance(beside[None])[0] == pytest.approx(10 * 0.01**2)


def test_covariances_of_gradients_are_derivatives_of_the_kernel():
    x, y, scales, alpha, h = (
        rng.normal(size=(2, 3)),
        rng.normal(size=(3, 3)),
        [0.5, 1.0, 2.0],
        0.7,
        1e-5,
    )
    scales = np.array(scales)
    blocks = [slice(0, 2), slice(2, 3)]
    exact = joint_covariance(x, y, scales, alpha, blocks)

    def shifted(points, d, step):
        moved = points.copy()
        moved[:, d] += step
        return moved

    def value(a, b):
        return joint_covariance(a, b, scales, alpha, blocks)[:2, :3]

    for d in range(3):
        numeric = (value(shifted(x, d, h), y) - value(shifted(x, d, -h), y)) / (2 * h)
        np.testing.assert_allclose(exact[2 * (d + 1) : 2 * (d + 2), :3], numeric, atol=1e-9)
        numeric = (value(x, shifted(y, d, h)) - value(x, shifted(y, d, -h))) / (2 * h)
        np.testing.assert_allclose(exact[:2, 3 * (d + 1) : 3 * (d + 2)], numeric, atol=1e-9)
    both = (
        joint_covariance(shifted(x, 1, h), y, scales, alpha, blocks)
        - joint_covariance(shifted(x, 1, -h), y, scales, alpha, blocks)
    )[:2, 3 * 3 : 3 * 4] / (2 * h)
    np.testing.assert_allclose(exact[2 * 2 : 2 * 3, 3 * 3 : 3 * 4], both, atol=1e-9)
