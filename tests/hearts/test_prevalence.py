"""The share of hearts with a cause: against cohorts in which it is known, and in closed form."""

import numpy as np
import pytest
from scipy import special, stats

from regional_lv.hearts.prevalence import (
    SOME,
    default_prior,
    infer_prevalence,
    log_bayes_factors,
    weights_given_others,
)
from regional_lv.inference.averaging import average
from tests.inference.toys import linear_problem, toy_inputs


def factors(share: float, count: int, seed: int, effect: float = 2.5) -> tuple:
    """Which hearts have a cause, and log Bayes factors of it: it moves one number, known to 1, by a
    size that is normal about 0 with sd `effect`."""
    rng = np.random.default_rng(seed)
    has = rng.uniform(size=count) < share
    seen = rng.standard_normal(count) + has * effect * rng.standard_normal(count)
    wide = stats.norm(0, np.hypot(1, effect)).logpdf(seen)
    return has, wide - stats.norm(0, 1).logpdf(seen)


def test_certain_hearts_are_a_binomial():
    log_factors = np.where(np.arange(12) < 9, 400.0, -400.0)
    found = infer_prevalence(log_factors, (1.0, 1.0))
    expected = stats.beta(10, 4).ppf([0.025, 0.5, 0.975])
    np.testing.assert_allclose(found.share, expected, atol=2e-3)
    np.testing.assert_allclose(found.probability, (log_factors > 0) * 1.0, atol=1e-12)
    # With 9 of 12 present: the integral of f^9 (1 - f)^3, against f = 0.
    assert found.log_bayes_factor == pytest.approx(9 * 400 + special.betaln(10, 4), abs=1e-2)


def test_hearts_that_say_nothing_leave_the_prior():
    found = infer_prevalence(np.zeros(30), (2.0, 5.0))
    np.testing.assert_allclose(found.share, stats.beta(2, 5).ppf([0.025, 0.5, 0.975]), atol=1e-3)
    assert found.log_bayes_factor == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(found.probability, 2 / 7, atol=1e-3)


def test_intervals_of_the_share_hold():
    inside = []
    for seed in range(200):
        share = np.random.default_rng(seed).uniform()
        low, _, high = infer_prevalence(factors(share, 30, seed)[1], (1.0, 1.0)).share
        inside.append(low < share < high)
    assert 0.91 <= np.mean(inside) <= 0.985


def test_no_heart_has_it():
    """What is weak in every heart is weak in all together: false alarms are rare."""
    found = [infer_prevalence(factors(0.0, 50, seed)[1], (1.0, 1.0)) for seed in range(100)]
    assert np.mean([one.probability_any >= SOME for one in found]) <= 0.02
    assert np.median([one.log_bayes_factor for one in found]) < -1


def test_of_many_causes_none_is_found_by_chance():
    """Twenty causes in each of sixty cohorts of six hearts, and none is there."""
    found = [
        infer_prevalence(factors(0.0, 6, 1000 * cohort + cause)[1], (1.0, 1.0), among=20)
        for cohort in range(60)
        for cause in range(20)
    ]
    expected = np.sum([one.probability_any >= SOME for one in found]) / 60
    by_itself = np.sum([special.expit(one.log_bayes_factor) >= SOME for one in found]) / 60
    assert expected <= 0.05 < by_itself


def test_weak_hearts_are_strong_together():
    """Each of those that have it says less than strong evidence, and each gets the others' word."""
    has, log_factors = factors(0.8, 60, 5, effect=2.5)
    weak = log_factors < special.logit(SOME)
    found = infer_prevalence(log_factors[weak], (1.0, 1.0))
    assert found.log_bayes_factor > 0
    assert infer_prevalence(log_factors, (1.0, 1.0)).probability_any > 0.99
    together = infer_prevalence(log_factors, (1.0, 1.0)).probability
    assert together[has].mean() > special.expit(log_factors)[has].mean() + 0.05


def test_what_others_expect_of_a_heart():
    """Its own data are not in it, and with them it gives the probability that the heart has it."""
    _, log_factors = factors(0.5, 8, 2)
    found = infer_prevalence(log_factors, (1.0, 3.0))
    for k, expected in enumerate(found.expected):
        silent = np.append(np.delete(log_factors, k), 0.0)
        others = infer_prevalence(silent, (1.0, 3.0)).probability[-1]
        assert expected == pytest.approx(others, rel=1e-6)
    together = special.expit(special.logit(found.expected) + log_factors)
    np.testing.assert_allclose(found.probability, together, rtol=1e-6)


def test_evidence_of_one_heart():
    """Against the evidence of all sets, weighed by their prior, in closed form."""
    inputs = toy_inputs(2, suspected=3, half=2.0)
    potential, _, _ = linear_problem(inputs, 12, [0.5, -0.3, 0.0, 0.3, 0.0])
    data = average(potential, 2, 0).to_datatree(100, 0)
    found = log_bayes_factors(data)
    assert set(found) == {"c0", "c1", "c2"}
    models = data.sample_stats
    for cause, value in found.items():
        odds = np.log(models["probability"].to_numpy())
        holds = models["holds"].sel(cause=cause).to_numpy()
        posterior = special.logsumexp(odds[holds]) - special.logsumexp(odds[~holds])
        # All sizes up to two are equally probable, and all sets of a size.
        prior = (0 + 1 / 3 + 2 / 3) / 3
        assert value == pytest.approx(posterior - special.logit(prior), abs=1e-6)
    # A cause that no model may free says nothing.
    data = average(potential.without([2]), 2, 0).to_datatree(100, 0)
    assert set(log_bayes_factors(data)) == {"c1", "c2"}


def test_models_given_other_hearts():
    """As probable as the table says that a heart has a cause (`Prevalence.probability`)."""
    inputs = toy_inputs(2, suspected=3, half=2.0)
    potential, _, _ = linear_problem(inputs, 12, [0.5, -0.3, 0.0, 0.3, 0.0])
    data = average(potential, 2, 0).to_datatree(100, 0)
    own = data.sample_stats["probability"].to_numpy()
    holds = data.sample_stats["holds"].sel(cause="c1").to_numpy()
    found = infer_prevalence([15.0, 15.0, -0.5, log_bayes_factors(data)["c1"]], (1.0, 4.0))
    weighed = own * weights_given_others(data, {"c1": found.expected[-1]})
    weighed /= weighed.sum()
    assert weighed[holds].sum() == pytest.approx(found.probability[-1], abs=1e-6)
    # Models that differ in other causes alone stay as probable beside each other.
    for same in (holds, ~holds):
        np.testing.assert_allclose((weighed / own)[same], (weighed / own)[same][0])


def test_hearts_that_say_nothing_change_no_answer():
    found = infer_prevalence([2.0, 0.0, 0.0], default_prior(0.08))
    np.testing.assert_allclose(found.expected[0], 0.08, rtol=1e-3)
    alone = special.expit(special.logit(0.08) + 2.0)
    np.testing.assert_allclose(found.probability[0], alone, rtol=1e-3)
