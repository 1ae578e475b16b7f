"""What is asked of ArviZ is the same before and after its release 1."""

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import norm

from regional_lv.inference.arviz_arrays import autocorr, hdi95, kde, smoothed_weights

EVEN = (np.arange(20_000) + 0.5) / 20_000


@pytest.mark.parametrize("rate", [0.7, 0.5, 0.3])
def test_shape_of_a_known_tail(rate):
    """Draws of an exponential distribution for one that falls `rate` times as fast have weights
    with a Pareto tail of shape 1 - rate."""
    draws = np.random.default_rng(3).permutation(-np.log1p(-EVEN))
    log_weights = (1 - rate) * draws
    smoothed, k = smoothed_weights(log_weights)
    assert k == pytest.approx(1 - rate, abs=0.06)
    assert logsumexp(smoothed) == pytest.approx(0, abs=1e-9)
    assert np.array_equal(np.argsort(smoothed), np.argsort(log_weights))
    body = np.argsort(log_weights)[: len(draws) // 2]
    assert np.ptp(smoothed[body] - log_weights[body]) < 1e-9


def test_interval_is_the_narrowest():
    assert hdi95(norm.ppf(EVEN)) == pytest.approx((-1.96, 1.96), abs=0.01)
    assert hdi95(-np.log1p(-EVEN)) == pytest.approx((0, -np.log(0.05)), abs=0.01)


def test_density_holds_at_a_bound():
    draws = np.abs(np.random.default_rng(5).standard_normal(20_000))
    grid, density = kde(draws, grid_len=128, bound_correction=True)
    assert grid[0] == pytest.approx(0, abs=0.02)
    assert density == pytest.approx(2 * norm.pdf(grid), abs=0.05)


def test_correlation_of_a_known_sequence():
    noise = np.random.default_rng(4).standard_normal((2, 20_000))
    draws = np.zeros_like(noise)
    for t in range(1, noise.shape[1]):
        draws[:, t] = 0.8 * draws[:, t - 1] + noise[:, t]
    found = autocorr(draws)
    assert found.shape == draws.shape
    assert found[:, :4] == pytest.approx(np.tile(0.8 ** np.arange(4), (2, 1)), abs=0.03)
