"""What is expected of sets without simulations, against known answers."""

import numpy as np
import pytest

from regional_lv.criticism.gains import (
    FAR,
    MEAN_CAUSES,
    PRIOR_DEGREES,
    PRIOR_SD,
    PRIOR_SDS,
    Gains,
)


def design(rng, n):
    """Log evidence behind the best set, numbers of causes, and the columns of the regression."""
    behind, causes = -rng.uniform(0, FAR, n), rng.integers(1, 5, n)
    return behind, causes, np.column_stack([np.ones(n), behind, causes - MEAN_CAUSES])


def test_many_simulations_tell_the_law():
    rng = np.random.default_rng(1)
    behind, causes, x = design(rng, 400)
    law, noise = np.array([30.0, -0.1, -0.5]), 0.5
    found = Gains.fit(behind, causes, x @ law + noise * rng.standard_normal(400))
    assert np.all(np.abs(found.mean - law) < [0.2, 0.04, 0.1])
    asked = ([-8.0, 0.0], [1, 3])
    expected = found.expected(*asked)
    np.testing.assert_allclose(expected, [30 + 0.8 + 0.5, 30 - 0.5], atol=0.2)
    draws = found.draws(*asked, 20_000, 2)
    np.testing.assert_allclose(draws.mean(0), 0, atol=0.02)
    np.testing.assert_allclose(draws.std(0), noise, rtol=0.1)


def test_intervals_cover_where_the_prior_is_the_truth():
    """Six simulations of sets, and a seventh that is predicted."""
    rng, inside = np.random.default_rng(3), []
    for number in range(800):
        sd = PRIOR_SD * np.sqrt(PRIOR_DEGREES / rng.chisquare(PRIOR_DEGREES))
        behind, causes, x = design(rng, 7)
        law = sd * PRIOR_SDS * rng.standard_normal(3)
        gain = x @ law + sd * rng.standard_normal(7)
        found = Gains.fit(behind[:6], causes[:6], gain[:6])
        error = gain[6] - found.expected(behind[6:], causes[6:])[0]
        low, high = np.quantile(found.draws(behind[6:], causes[6:], 1000, number), [0.1, 0.9])
        inside.append(low < error < high)
    assert np.mean(inside) == pytest.approx(0.8, abs=0.045)  # three standard errors


def test_sets_far_behind_stay_there():
    """A slope of -1 would bring every set to the best one."""
    found = Gains.fit([0.0, -3.0, -6.0, -9.0, -10.0], [2] * 5, [0.0, 3.0, 6.0, 9.0, 10.0])
    near, far = found.expected([-FAR, -10 * FAR], [2, 2])
    assert near == far and near > 5


def test_changes_of_similar_sets_go_together():
    """Two sets of the same kind are known equally badly: what one gains, the other gains."""
    found = Gains.fit([0.0, -1.0], [3, 3], [4.0, 3.5])
    near, same, other = found.draws([-9.0, -9.5, 0.0], [1, 1, 3], 4000, 5).T
    together = np.corrcoef(near, same)[0, 1]
    assert together > 0.5 and together > np.corrcoef(near, other)[0, 1] + 0.2
