"""Scores and intervals against what is known in closed form."""

import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy import stats

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.posteriors.recovery import (
    ANY_SOFT,
    clustered_interval,
    coverage,
    map_errors,
    recovery,
)
from regional_lv.paper.sampler.files import Posterior

PARAMETERS = StiffnessInputs()


def recovered(draws: np.ndarray, truth: np.ndarray) -> pd.DataFrame:
    """`recovery` of draws (10, M) of the ten parameters of one case."""
    names = list(PARAMETERS.names)
    theta = xr.Dataset(
        {"theta": (("parameter", "chain", "draw"), draws[:, None])},
        {"parameter": names},
        {"parameters": json.dumps(PARAMETERS.spec())},
    )
    known = xr.Dataset({key: ("parameter", truth) for key in ("theta_true", "theta_map")})
    posterior = Posterior("1", {"posterior": theta, "constant_data": known})
    return recovery([posterior], pd.DataFrame({"case": ["1"], "verdict": ["passed"]}))


def test_crps_of_a_gaussian():
    draws = stats.norm(1.0, 2.0).ppf((np.arange(20000) + 0.5) / 20000)
    for truth in (-1.0, 1.0, 3.5):
        z = (truth - 1.0) / 2.0
        phi, density = stats.norm.cdf(z), stats.norm.pdf(z)
        expected = 2.0 * (z * (2 * phi - 1) + 2 * density - 1 / np.sqrt(np.pi))
        found = recovered(np.tile(draws, (10, 1)), np.full(10, truth))["crps"]
        assert found.to_numpy() == pytest.approx(expected, rel=1e-3)


def test_crps_is_the_double_sum():
    """Of tied draws as well, and of a truth among them."""
    draws = np.random.default_rng(1).normal(size=(10, 50))
    draws[:5] = draws[:5].round(1)
    truth = np.append(draws[:5, 7], np.full(5, 0.3))
    double = np.abs(draws[:, :, None] - draws[:, None]).sum(axis=(1, 2)) / (2 * 50**2)
    expected = np.abs(draws - truth[:, None]).mean(axis=1) - double
    assert recovered(draws, truth)["crps"].to_numpy() == pytest.approx(expected)


def test_recovery_of_an_exponential_posterior():
    """Every column in closed form, at truths on both sides of the ends of each interval."""
    below = np.array([0.01, 0.02, 0.03, 0.09, 0.11, 0.24, 0.26, 0.89, 0.97, 0.98])
    draws = np.tile(stats.expon.ppf((np.arange(4000) + 0.5) / 4000), (10, 1))
    found = recovered(draws, stats.expon.ppf(below))
    assert found["rank"].tolist() == pytest.approx(4000 * below, abs=1)
    for level in (50, 80, 95):
        inside = np.abs(below - 0.5) <= level / 200
        assert 0 < inside.sum() < 10 and found[f"covered{level}"].tolist() == inside.tolist()
    expected = {"mean": 1.0, "sd": 1.0, "median": np.log(2), "variance_ratio": 12 / 4.9**2}
    expected |= dict(zip(("lower95", "upper95"), stats.expon.interval(0.95), strict=True))
    expected |= {"hpd_lower95": 0.0, "hpd_upper95": np.log(20), "hpd_width95": np.log(20)}
    for name, value in expected.items():
        assert found[name].to_numpy() == pytest.approx(value, rel=5e-3, abs=5e-4), name


def exact(hits: int, trials: int) -> tuple[float, float]:
    """Clopper and Pearson's 95 % interval."""
    found = stats.binomtest(hits, trials).proportion_ci(method="exact")
    return found.low, found.high


@pytest.mark.parametrize("cases, hits", [(10, 0), (10, 10), (120, 114)])
def test_interval_of_a_coverage_is_exact(cases, hits):
    table = _recovered(cases)
    table["covered95"] = table["case"].astype(int) < hits
    row = coverage(table).set_index("parameter").loc["C_a_apical"]
    ends = exact(hits, cases)
    assert (row["coverage95_lower"], row["coverage95_upper"]) == pytest.approx(ends)
    if not hits:
        assert ends == pytest.approx((0, 1 - 0.025**0.1))


def test_cases_that_fail_together_are_worth_less():
    apart = np.ones((40, 10))
    apart[:20, 0] = 0
    together = np.ones((40, 10))
    together[:2] = 0
    width = [np.diff(clustered_interval(hits))[0] for hits in (apart, together)]
    assert width[1] > 1.5 * width[0]
    assert clustered_interval(apart) == pytest.approx(exact(380, 400))


def test_cases_of_which_all_hit_are_no_more_than_cases():
    assert clustered_interval(np.ones((30, 10))) == pytest.approx(exact(30, 30))
    assert clustered_interval(np.zeros((30, 10))) == pytest.approx(exact(0, 30))


def test_one_case_is_one_trial_and_so_are_cases_that_are_alike():
    one = np.array([[1.0] * 9 + [0.0]])
    for cases in (1, 2):
        hits, misses = 0.9 * cases, 0.1 * cases
        low = stats.beta(hits, misses + 1).ppf(0.025)
        high = stats.beta(hits + 1, misses).ppf(0.975)
        assert clustered_interval(np.repeat(one, cases, axis=0)) == pytest.approx((low, high))


def test_clustered_interval_covers():
    rng = np.random.default_rng(2)
    inside = 0
    for _ in range(200):
        p = stats.beta(9, 1).rvs(60, random_state=rng)  # shared within a case; mean 0.9
        low, high = clustered_interval((rng.random((60, 10)) < p[:, None]).astype(float))
        inside += low <= 0.9 <= high
    assert inside >= 182


def _recovered(cases: int) -> pd.DataFrame:
    rows = [
        {
            "case": str(case),
            "parameter": name,
            "truth": 1.0,
            "mean": 1.2,
            "map": 1.1 if name == "C_a_apical" else 1.0,
            "covered50": case % 2 == 0,
            "covered80": True,
            "covered95": True,
            "crps": 0.1,
            "variance_ratio": 0.01,
            "hpd_width95": 0.3,
            "verdict": "passed" if case else "failed: R-hat 1.2 > 1.01",
        }
        for case in range(cases)
        for name in PARAMETERS.names
    ]
    return pd.DataFrame(rows)


def test_coverage_table():
    table = coverage(_recovered(20)).set_index("parameter")
    assert list(table.index) == [*PARAMETERS.names, "all"]
    assert (table["coverage50"] == 0.5).all() and (table["coverage95"] == 1).all()
    assert (table["coverage50_lower"] < 0.5).all() and (table["coverage50_upper"] > 0.5).all()
    assert (table["failed"] == 1).all()
    assert table.loc["C_a_apical", "bias"] == pytest.approx(0.1)
    assert table.loc["all", "mse"] == pytest.approx(0.001)
    assert table["mean_mse"].to_numpy() == pytest.approx(0.04)


def test_coverage_where_a_zone_is_soft():
    """All parameters of the cases that have a soft one, whatever the other cases are like."""
    recovered = _recovered(20)
    soft = recovered["case"].isin(["2", "3", "4"])
    recovered.loc[soft & (recovered["parameter"] == "C_b_septal"), "truth"] = 0.4
    recovered.loc[recovered["case"] == "3", "covered95"] = False
    row = coverage(recovered).set_index("parameter").loc[ANY_SOFT]
    assert row["cases"] == 3 and row["failed"] == 0
    assert row["coverage95"] == pytest.approx(2 / 3)
    assert row["coverage95_lower"] == pytest.approx(exact(2, 3)[0])


def test_map_errors_per_case():
    table = map_errors(_recovered(3))
    assert table["case"].tolist() == ["0", "1", "2"]
    np.testing.assert_allclose(table["mse"], 0.001)
