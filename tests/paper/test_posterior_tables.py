"""Correlations, HPD widths, the choice, agreement, ranks, noise priors: against known answers."""

import json

import numpy as np
import pandas as pd
import pytest

from regional_lv.errors import InputError
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.posteriors.agreement import compare
from regional_lv.paper.posteriors.choice import choose_final
from regional_lv.paper.posteriors.classification import stiffness
from regional_lv.paper.posteriors.correlations import correlate, zone_correlation
from regional_lv.paper.posteriors.noise_prior import count_outside
from regional_lv.paper.posteriors.rank_calibration import tabulate, test_ranks
from regional_lv.paper.posteriors.resimulation import summarise

PARAMETERS = StiffnessInputs()

test_ranks.__test__ = False  # a function of the library, no test


def drawn(correlation: np.ndarray) -> np.ndarray:
    """Draws (M, P) of which the sample has exactly this correlation."""
    deviates = np.random.default_rng(13).normal(size=(400, len(correlation)))
    deviates -= deviates.mean(axis=0)
    white = np.linalg.qr(deviates)[0]
    return 2.0 + white @ np.linalg.cholesky(correlation).T


def test_zones_by_their_first_component():
    matrix = np.eye(10)
    matrix[0, 1] = matrix[1, 0] = -0.8
    matrix[2, 3] = matrix[3, 2] = -0.6
    # a1 - b1 against a2 - b2, each of variance 2 - 2 r
    matrix[0, 2] = matrix[2, 0] = 0.4
    found = zone_correlation(drawn(matrix), PARAMETERS)
    np.testing.assert_allclose(np.diag(found), 1.0)
    assert found[0, 1] == pytest.approx(0.4 / np.sqrt(3.6 * 3.2))
    matrix[2, 3] = matrix[3, 2] = 0.6  # now a2 + b2
    found = zone_correlation(drawn(matrix), PARAMETERS)
    assert found[0, 1] == pytest.approx(0.4 / np.sqrt(3.6 * 3.2))


def test_zone_component_is_the_leading_eigenvector():
    rng = np.random.default_rng(1)
    half = rng.normal(size=(10, 10))
    covariance = half @ half.T
    sd = np.sqrt(covariance.diagonal())
    matrix = covariance / np.outer(sd, sd)
    weights = np.zeros((5, 10))
    for zone in range(5):
        here = slice(2 * zone, 2 * zone + 2)
        vector = np.linalg.eigh(matrix[here, here])[1][:, -1]
        weights[zone, here] = vector * np.sign(vector[0])
    projected = weights @ matrix @ weights.T
    scale = np.sqrt(projected.diagonal())
    np.testing.assert_allclose(
        zone_correlation(drawn(matrix), PARAMETERS), projected / np.outer(scale, scale)
    )


def test_correlations_and_their_errors_over_cases():
    rng = np.random.default_rng(2)
    draws = rng.normal(size=(30, 2000, 10))
    draws[:, :, 1] = -0.6 * draws[:, :, 0] + 0.8 * draws[:, :, 1]
    between, zones = correlate(draws, PARAMETERS)
    row = between.set_index(["parameter_1", "parameter_2"]).loc[("C_a_anterior", "C_b_anterior")]
    assert row["mean"] == pytest.approx(-0.6, abs=0.02) and row["cases"] == 30
    assert row["se"] == pytest.approx((1 - 0.36) / np.sqrt(2000 * 30), rel=0.4)
    assert len(zones) == 25
    assert correlate(draws[:1], PARAMETERS)[0]["se"].isna().all()


def test_a_parameter_that_never_moved_has_no_correlations():
    draws = np.random.default_rng(3).normal(size=(3, 200, 10))
    draws[1, :, 1] = 1.3
    between, zones = correlate(draws, PARAMETERS)
    for table, name, still in ((between, "parameter", "C_b_anterior"), (zones, "zone", "anterior")):
        its = (table[f"{name}_1"] == still) | (table[f"{name}_2"] == still)
        assert (table.loc[its, "cases"] == 2).all() and (table.loc[~its, "cases"] == 3).all()
        assert np.isfinite(table[["mean", "se"]]).all(axis=None)
    assert correlate(draws[1:2], PARAMETERS)[1]["mean"].isna().sum() == 9


def candidate(folder, name, coverage, upper, crps):
    (folder / name / "test").mkdir(parents=True)
    (folder / f"{name}.pt").write_text(name)
    row = {"parameter": "all", "coverage95": coverage, "coverage95_lower": coverage - 0.02}
    row |= {"coverage95_upper": upper, "crps": crps, "mse": 0.01, "variance_ratio": 0.02}
    row |= {"failed": 0, "cases": 120}
    pd.DataFrame([row]).to_csv(folder / name / "test" / "coverage.csv", index=False)


def choose(folder, names, wanted="auto"):
    """The final emulator's name; its coverage lies in `folder` then."""
    coverages = [folder / name / "test" / "coverage.csv" for name in names]
    choose_final(
        [folder / f"{name}.pt" for name in names],
        coverages,
        wanted,
        folder / "final.pt",
        folder / "final.json",
        coverages,
        [folder / "coverage.csv"],
    )
    return json.loads((folder / "final.json").read_text())["final"]


def test_the_rule(tmp_path):
    candidate(tmp_path, "narrow", 0.87, 0.89, 0.01)
    candidate(tmp_path, "good", 0.95, 0.97, 0.03)
    candidate(tmp_path, "wide", 0.99, 1.00, 0.08)
    assert choose(tmp_path, ["narrow", "good", "wide"]) == "good"
    candidate(tmp_path, "sharp", 0.92, 0.938, 0.003)  # a little narrow, and ten times as exact
    assert choose(tmp_path, ["sharp", "good", "wide"]) == "sharp"
    why = {
        c["emulator"]: c["why"]
        for c in json.loads((tmp_path / "final.json").read_text())["candidates"]
    }
    assert "somewhat too narrow" in why["sharp"] and "narrow" not in why["wide"]
    choose(tmp_path, ["narrow", "good", "wide"])
    assert (tmp_path / "final.pt").read_text() == "good"
    report = json.loads((tmp_path / "final.json").read_text())
    assert report["final"] == "good" and "CRPS" in report["rule"]
    assert [c["eligible"] for c in report["candidates"]] == [False, True, True]
    assert pd.read_csv(tmp_path / "coverage.csv")["crps"].iloc[0] == 0.03
    assert choose(tmp_path, ["narrow", "good"], "narrow") == "narrow"
    assert choose(tmp_path, ["narrow"]) == "narrow"  # none covers: the highest
    with pytest.raises(InputError, match="wide is not on the shortlist"):
        choose(tmp_path, ["good"], "wide")
    with pytest.raises(InputError, match=r"emulators\.shortlist: it is empty"):
        choose(tmp_path, [])


def test_agreement_of_samplers():
    rng = np.random.default_rng(4)
    a, b = rng.normal(size=(2, 2, 4000, 10))
    fast = {name: a[..., i] for i, name in enumerate(PARAMETERS.names)}
    rows = pd.DataFrame(compare("test", "7", fast, b))
    assert rows["parameter"].tolist() == [*PARAMETERS.names]
    assert rows["agrees"].all() and rows["monte_carlo_error"].between(0.01, 0.03).all()
    a[..., 0] += 0.3
    a[..., 1] *= 1.3
    rows = pd.DataFrame(compare("test", "7", fast, b))
    assert rows["agrees"].tolist() == [False] * 2 + [True] * 8


def ranks(shape, cases=400, draws=99):
    rng = np.random.default_rng(5)
    rows = [
        (str(i), name, int(rank), draws)
        for name in PARAMETERS.names
        for i, rank in enumerate(np.floor(shape(rng.random(cases)) * (draws + 1)))
    ]
    return pd.DataFrame(rows, columns=["case", "parameter", "rank", "draws"])


def test_uniform_ranks_pass_and_others_do_not():
    table = test_ranks(ranks(lambda u: u), 1)
    assert table["parameter"].tolist() == [*PARAMETERS.names, "all"]
    assert table["passed"].all()
    for wrong in (lambda u: u**1.3, lambda u: 0.5 + 0.35 * np.sign(u - 0.5) * abs(2 * u - 1)):
        assert not test_ranks(ranks(wrong), 1)["passed"].iloc[-1]


def test_histogram_of_ranks():
    table = tabulate(ranks(lambda u: u))
    assert table.groupby("parameter")["count"].sum().loc["all"] == 4000
    np.testing.assert_allclose(table.groupby("parameter")["expected"].sum().loc["all"], 4000)
    first = table[table["parameter"] == "C_a_apical"]
    assert first["lower_rank"].iloc[0] == 0 and first["upper_rank"].iloc[-1] == 99


def test_p_values_are_corrected_over_all_tests_of_all_parameters():
    """Holm by hand: ordered, times the number that is left, never falling."""
    table = test_ranks(ranks(lambda u: u**1.15), 1).iloc[:-1]
    p = table[["p_chi2", "p_ecdf"]].to_numpy().ravel()
    order = np.argsort(p)
    expected = np.empty(20)
    expected[order] = np.maximum.accumulate(p[order] * np.arange(20, 0, -1)).clip(max=1)
    assert 0 < (expected < 0.05).sum() < 20
    np.testing.assert_allclose(table["p_holm"], expected.reshape(-1, 2).min(axis=1))


def test_observations_outside_the_predictive_interval():
    rng = np.random.default_rng(7)
    predictive = rng.normal(size=(2, 3000, 4))
    assert count_outside(predictive, np.array([0.0, 1.5, 2.5, -3.0])) == (2, 4)


def test_errors_at_posterior_draws():
    long = pd.DataFrame(
        {
            "case": "1",
            "draw": 3,
            "output": ["volume_ml", "radial_01", "radial_02"],
            "mean": [100.0, 0.3, 0.3],
            "simulator": [102.0, 0.3, 0.5],
            "z": [1.0, 0.0, 3.0],
        }
    )
    table = summarise(long, {"volume_ml": 20.0, "radial_01": 0.1, "radial_02": 0.1}).set_index(
        "output"
    )
    assert table.loc["volume_ml", "rmse_standardised"] == pytest.approx(0.1)
    assert table.loc["radial", "coverage95"] == 0.5
    assert table.loc["all", "draws"] == 1
    assert table.loc["all", "z_sd"] == pytest.approx(np.sqrt(10 / 3))


# -------------------------------------------------------------------- other zones and factors

SEGMENTS = StiffnessInputs({f"segment_{i:02d}": (i,) for i in range(1, 18)}, factors=("C_a",))
WHOLE = StiffnessInputs({"whole": range(1, 18)}, law="guccione")


def correlations(size: int, seed: int) -> np.ndarray:
    half = np.random.default_rng(seed).normal(size=(size, 2 * size))
    return np.corrcoef(half)


def test_zones_of_one_factor_are_that_factor():
    matrix = correlations(17, 8)
    np.testing.assert_allclose(zone_correlation(drawn(matrix), SEGMENTS), matrix, atol=1e-12)
    draws = np.random.default_rng(9).normal(size=(2, 50, 17))
    between, zones = correlate(draws, SEGMENTS)
    np.testing.assert_allclose(between["mean"], zones["mean"])
    assert zones["zone_1"].iloc[-1] == "segment_17"


def test_one_zone_of_any_factors_correlates_with_itself():
    assert len(WHOLE.zones) == 1
    matrix = correlations(len(WHOLE), 10)
    np.testing.assert_allclose(zone_correlation(drawn(matrix), WHOLE), [[1.0]])


def test_components_of_more_factors_are_leading_eigenvectors():
    class Three:
        """Two zones of three factors, which no material law has yet."""

        zones = ("a", "b")
        blocks = (slice(0, 3), slice(3, 6))

    matrix = correlations(6, 11)
    found = zone_correlation(drawn(matrix), Three())
    weights = np.zeros((2, 6))
    for row, block in zip(weights, Three.blocks, strict=True):
        vector = np.linalg.eigh(matrix[block, block])[1][:, -1]
        row[block] = vector * np.sign(vector[0])
    projected = weights @ matrix @ weights.T
    scale = np.sqrt(projected.diagonal())
    np.testing.assert_allclose(found, projected / np.outer(scale, scale), atol=1e-10)


@pytest.mark.parametrize("parameters", [PARAMETERS, SEGMENTS, WHOLE])
def test_stiffness_is_the_factors_and_their_geometric_mean(parameters):
    theta = np.random.default_rng(12).uniform(0.2, 4.0, (3, 4, len(parameters)))
    found, factors = stiffness(theta, parameters), len(parameters.factors)
    assert found.shape == (3, 4, len(parameters.zones), factors + 1)
    np.testing.assert_array_equal(found[..., :-1].reshape(theta.shape), theta)
    np.testing.assert_allclose(found[..., -1], np.exp(np.log(found[..., :-1]).mean(-1)))


def test_errors_at_posterior_draws_of_other_quantities():
    names = ["torsion_basal-apical", "volume_ml@0.5", "volume_ml"]
    long = pd.DataFrame(
        {
            **{"case": "1", "draw": 3, "output": names, "mean": 1.0},
            **{"simulator": [1.1, 3.0, 1.0], "z": [1.0, 2.0, 0.0]},
        }
    )
    table = summarise(long, dict(zip(names, (0.1, 10.0, 10.0), strict=True)))
    assert table["output"].tolist() == ["all", "torsion", "volume_ml"]
    np.testing.assert_allclose(table["rmse_standardised"].iloc[1:], [1.0, 0.2 / np.sqrt(2)])
