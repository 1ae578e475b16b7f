"""The population of hearts: against populations that are known."""

import numpy as np
import pytest

from regional_lv.hearts import hierarchy
from regional_lv.hearts.hierarchy import infer_population
from regional_lv.hearts.likelihoods import NormalLikelihood
from tests.hearts.cohorts import LOWER, UPPER, likelihood, measured, posterior

MEAN, SD = np.array([0.0, 0.2, 0.3, -0.2]), np.array([0.3, 0.2, 0.4, 0.1])
LOW, HIGH = np.full(4, LOWER), np.full(4, UPPER)


def inside(quantiles, truth) -> np.ndarray:
    return (quantiles[0] < truth) & (truth < quantiles[-1])


@pytest.fixture(scope="module")
def cohort():
    truth, centre, covariance = measured(MEAN, SD, 40, 3)
    return truth, centre, covariance, infer_population(likelihood(centre, covariance), LOW, HIGH, 0)


def test_mean_and_spread(cohort):
    *_, found = cohort
    assert found.rhat < 1.1
    for draws, truth in ((found.mean, MEAN), (found.sd, SD)):
        assert (np.abs(draws.mean(0) - truth) < 3 * draws.std(0)).all()
    # Ridges say a lot of sums: the population's median is known along them, and is not prior.
    along = found.mean @ np.array([0.8, 0.6, 0, 0])
    assert along.std() < 0.1 and abs(along.mean() - MEAN[:2] @ [0.8, 0.6]) < 3 * along.std()
    table = found.table(list("abcd"), 0)
    assert (table["hearts_lower95"] < table["mean_lower95"]).all()
    assert (table["hearts_upper95"] > table["mean_upper95"]).all()


def test_hearts_are_known_better_together(cohort):
    truth, centre, _, found = cohort
    assert 0.9 <= inside(found.heart_quantiles, truth).mean() <= 1.0
    by_itself, given_others = (
        np.sqrt(np.square(each - truth).mean()) for each in (centre, found.heart_quantiles[1])
    )
    assert given_others < by_itself / 2
    assert (found.shrinkage > 0).all() and (found.shrinkage < 1).all()


def test_shrinkage_of_independent_factors_is_the_textbooks(monkeypatch):
    """s^2 / (s^2 + t^2), as in Gelman et al. (Bayesian Data Analysis, section 5.4)."""
    monkeypatch.setattr(hierarchy, "DRAWS", 1500)
    rng = np.random.default_rng(0)
    truth = 0.3 * rng.standard_normal((300, 2))
    noise = np.tile([0.05, 0.6], (300, 1))
    centre = truth + noise * rng.standard_normal(noise.shape)
    hearts = likelihood(centre, noise[:, :, None] ** 2 * np.eye(2))
    found = infer_population(hearts, LOW[:2], HIGH[:2], 0)
    expected = [0.05**2 / (0.05**2 + 0.3**2), 0.6**2 / (0.6**2 + 0.3**2)]
    np.testing.assert_allclose(found.shrinkage.mean(0), expected, atol=0.08)


def test_a_heart_that_says_nothing_is_the_population(cohort, monkeypatch):
    monkeypatch.setattr(hierarchy, "DRAWS", 1500)
    *_, centre, covariance, _ = cohort
    hearts = likelihood(centre, covariance)
    silent = NormalLikelihood(
        np.concatenate([hearts.linear, np.zeros((1, 4))]),
        np.concatenate([hearts.precision, np.zeros((1, 4, 4))]),
    )
    found = infer_population(silent, LOW, HIGH, 1)
    np.testing.assert_allclose(found.shrinkage[-1], 1.0)
    np.testing.assert_allclose(found.heart_quantiles[1][-1], found.mean.mean(0), atol=0.08)


def test_same_seed_same_answer(cohort, monkeypatch):
    monkeypatch.setattr(hierarchy, "DRAWS", 100)
    _, centre, covariance, _ = cohort
    hearts = likelihood(centre, covariance)
    first, again, other = (infer_population(hearts, LOW, HIGH, seed) for seed in (0, 0, 1))
    assert np.array_equal(first.mean, again.mean) and first.rhat == again.rhat
    assert not np.array_equal(first.mean, other.mean)


@pytest.mark.test_all("posteriors of 240 hearts; `make test` has exact likelihoods")
def test_intervals_hold_from_draws_of_each_heart(monkeypatch):
    """Of populations: 95 % intervals of mean and spread, and of hearts; what the sampler of a heart
    leaves is draws within a range."""
    monkeypatch.setattr(hierarchy, "DRAWS", 1500)
    mean, sd, of_hearts = [], [], []
    for replicate in range(20, 32):
        truth, centre, covariance = measured(MEAN, SD, 20, 100 + replicate)
        hearts = NormalLikelihood.stack(
            [
                NormalLikelihood.of_draws(posterior(c, s, 1000, 100 * replicate + i), LOW, HIGH)
                for i, (c, s) in enumerate(zip(centre, covariance, strict=True))
            ]
        )
        found = infer_population(hearts, LOW, HIGH, replicate)
        mean.append(inside(np.quantile(found.mean, [0.025, 0.975], axis=0), MEAN))
        sd.append(inside(np.quantile(found.sd, [0.025, 0.975], axis=0), SD))
        of_hearts.append(inside(found.heart_quantiles, truth))
    assert np.mean(mean) >= 0.87 and np.mean(sd) >= 0.87
    assert np.mean(of_hearts) >= 0.92
