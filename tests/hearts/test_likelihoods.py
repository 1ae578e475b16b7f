"""What a heart's data say, out of draws of its posterior: against likelihoods that are known."""

import numpy as np
import pytest

from regional_lv.hearts.likelihoods import NormalLikelihood
from tests.hearts.cohorts import LOWER, UPPER, covariances, likelihood, posterior

LOW, HIGH = np.full(4, LOWER), np.full(4, UPPER)


def differ(found: NormalLikelihood, expected: NormalLikelihood) -> float:
    """Largest difference of two log likelihoods over points of the range that matter, beside their
    common level."""
    points = np.random.default_rng(1).uniform(np.log(LOWER), np.log(UPPER), (4000, 4))
    ours, theirs = (
        points @ one.linear - 0.5 * np.einsum("ni,ij,nj->n", points, one.precision, points)
        for one in (found, expected)
    )
    near = theirs > theirs.max() - 3
    gap = (ours - theirs)[near]
    return float(np.abs(gap - gap.mean()).max())


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_ridges_that_leave_the_range(seed):
    """Factors of a zone are known in one combination only, along which the range ends them."""
    rng = np.random.default_rng(seed)
    covariance = covariances(1, rng)[0]
    centre = rng.uniform(-0.8, 1.2, 4)
    draws = posterior(centre, covariance, 6000, seed)
    assert (draws.min(0) > LOWER).all() and (draws.max(0) < UPPER).all()
    expected = likelihood(centre, covariance)
    found = NormalLikelihood.of_draws(draws, LOW, HIGH)
    assert np.linalg.eigvalsh(found.precision).min() >= -1e-9
    assert differ(found, expected) < 0.6
    # The normal distribution with the draws' moments, without the prior, is another one.
    u = np.log(draws)
    precision = np.linalg.inv(np.cov(u.T))
    moments = NormalLikelihood(precision @ u.mean(0) - 1, precision)
    assert differ(moments, expected) > 2 * differ(found, expected)


def test_data_that_say_nothing():
    draws = np.random.default_rng(0).uniform(LOWER, UPPER, (20_000, 4))
    found = NormalLikelihood.of_draws(draws, LOW, HIGH)
    # Beside a population with an sd of 0.5, whose precision is 4.
    assert np.abs(found.precision).max() < 0.1 and np.abs(found.linear).max() < 0.1


def test_data_that_say_all_are_fitted_by_the_moments():
    rng = np.random.default_rng(0)
    root = np.array([[0.05, 0, 0], [0.02, 0.03, 0], [0.0, 0.01, 0.04]])
    u = rng.standard_normal((5000, 3)) @ root.T
    found = NormalLikelihood.of_draws(np.exp(u), LOW[:3], HIGH[:3])
    precision = np.linalg.inv(np.cov(u.T, ddof=0))
    np.testing.assert_allclose(found.precision, precision, rtol=1e-6)
    np.testing.assert_allclose(found.linear, precision @ u.mean(0) - 1, rtol=1e-6)


def test_a_weight_is_as_many_draws():
    rng = np.random.default_rng(0)
    draws = posterior(rng.uniform(-0.8, 1.2, 4), covariances(1, rng)[0], 1000, 0)
    counts = rng.integers(0, 4, 1000)
    weighted = NormalLikelihood.of_draws(draws, LOW, HIGH, 0.01 * counts)
    repeated = NormalLikelihood.of_draws(np.repeat(draws, counts, axis=0), LOW, HIGH)
    for ours, theirs in zip(weighted, repeated, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-8)
