"""The score of hidden effects, against hearts counted by hand."""

import json

import numpy as np
import pandas as pd
import pytest
import torch
from statsmodels.regression.linear_model import GLS

from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.hidden_effects.blind import measured_of
from regional_lv.hidden_effects.rates import rate, weighted_rate
from regional_lv.hidden_effects.score import (
    OF_TRUE_MODEL,
    expected_scores,
    reliabilities,
    score_benchmark,
)
from regional_lv.inputs.space import Inputs, Role
from regional_lv.measured import read_measured, synthetic_subject, write_measured
from regional_lv.plots import hidden_effects
from tests.inference.toys import linear_problem, toy_inputs

CAUSES = ("septal_load", "basal_motion", "focal_scar")
TRUTH = 1.0


def found(named=(), groups=(), places=(), probability=None, stiffness=((0.8, 1.2), (1.1, 1.3))):
    """Findings of a heart, as of `blind.reduced`."""
    places, probability = dict(places), probability or {}
    causes = [
        {
            "name": name,
            "component": places.get(name, "7" if name == "focal_scar" else None),
            "probability": probability.get(name, 0.999 if name in named else 0.001),
            "component_probability": 1.0,
            "estimate": 2.0,
            "interval95": [1.0, 3.0],
            "at_bound": False,
            "identifiable": True,
            "z": 4.0,
            "p_value": 0.01,
        }
        for name in CAUSES
    ]
    intervals = dict(zip(("averaged", "as_it_is"), stiffness, strict=True))
    one = {"name": "C_a_septal"} | {k: {"interval95": list(v)} for k, v in intervals.items()}
    return {
        **{"named": list(named), "groups": [list(group) for group in groups], "acts_like": []},
        **{"explained": bool(named), "trusted": True, "best": list(named), "detected": bool(named)},
        **{"base_probability": 0.5, "unlisted_probability": 0.1, "stiffness": [one], "ess": 900.0},
        **{"misfit_p_value": 0.5, "remaining_p_value": None, "causes": causes},
        "confirmation": {"simulations": 8, "agrees": True, "largest_error_sd": 1.0},
        **{"seconds": 20.0, "simulation_seconds": 30.0},
    }


class Hearts:
    """Files of a benchmark, heart by heart."""

    def __init__(self):
        self.found, self.truth, self.models = {}, [], []

    def add(self, group, findings, effects=(), unlisted="", stiffness=True):
        """effects: (cause, place, value, expected score)."""
        name = f"subject-{len(self.truth):04d}"
        self.found[name] = findings
        truth = {"subject": name, "group": group, "unlisted": unlisted, "detail": ""}
        self.truth.append(truth | {"has_stiffness": stiffness})
        known = {"subject": name, "low": 0.9, "high": 1.1, "p_value": (len(self.truth) % 20) / 20}
        if unlisted:
            known |= {"low": np.nan, "high": np.nan, "p_value": np.nan}
        for cause, place, value, score in effects:
            row = {"input": cause + place, "role": "effect", "cause": cause, "place": place}
            self.models.append(known | row | {"value": value, "expected_z": score})
        if stiffness:
            row = {"input": "C_a_septal", "role": "inferred", "cause": "C_a_septal", "place": ""}
            self.models.append(known | row | {"value": TRUTH})

    def write(self, folder):
        files = [folder / name for name in ("found.json", "truth.parquet", "models.parquet")]
        files[0].write_text(json.dumps(self.found))
        pd.DataFrame(self.truth).to_parquet(files[1])
        pd.DataFrame(self.models, columns=OF_TRUE_MODEL).to_parquet(files[2])
        return files


LOAD, MOTION = ("septal_load", "", 2.0, 6.0), ("basal_motion", "", 5.0, 4.0)


@pytest.fixture(scope="module")
def score(tmp_path_factory):
    """Folder with the score of a benchmark whose rates are known."""
    hearts = Hearts()
    for i in range(10):
        hearts.add("singles", found([LOAD[0] if i < 8 else MOTION[0]]), [LOAD])
    for _ in range(5):
        hearts.add("singles", found(), [(*LOAD[:3], 1.5)])
    hearts.add("singles", found(["focal_scar"]), [("focal_scar", "7", 2.0, 9.0)])
    hearts.add("singles", found(["focal_scar"]), [("focal_scar", "8", 2.0, 9.0)])
    hearts.add("pairs", found(["basal_motion"], [["septal_load", "focal_scar"]]), [LOAD, MOTION])
    hearts.add("pairs", found(["septal_load"]), [LOAD, MOTION])
    for i in range(20):
        hearts.add("nulls", found(["basal_motion"] if i == 3 else []))
    hearts.add("misread", found(stiffness=((0.5, 0.9), (0.5, 0.9))))
    hearts.add("unlisted", found([], [["septal_load", "basal_motion"]]), (), "other_law", False)
    hearts.add("unlisted", found(), (), "smooth_bias")
    folder = tmp_path_factory.mktemp("score")
    given = [[file] for file in hearts.write(folder)]
    names = ("cases.csv", "stiffness.csv", "confusion.csv", "reliability.csv", "summary.json")
    score_benchmark(*given, *(folder / name for name in names))
    return folder


def test_hearts_without_effects_are_scored_alone(tmp_path):
    hearts = Hearts()
    for i in range(4):
        hearts.add("nulls", found(["basal_motion"] if i == 3 else []))
    given = [[file] for file in hearts.write(tmp_path)]
    names = ("cases.csv", "stiffness.csv", "confusion.csv", "reliability.csv", "summary.json")
    score_benchmark(*given, *(tmp_path / name for name in names))
    content = json.loads((tmp_path / "summary.json").read_text())
    assert content["nulls"]["wrong_named"]["hits"] == 1
    assert content["singles"]["effects_found"]["of"] == 0
    tables = {f"{name}_file": tmp_path / f"{name}.csv" for name in ("cases", "stiffness")}
    reliability = tmp_path / "reliability.csv"
    hidden_effects.draw(
        **tables, reliability_file=reliability, png=tmp_path / "a.png", csv=tmp_path / "a.csv"
    )


def test_a_benchmark_without_hearts_names_its_key(tmp_path):
    with pytest.raises(InputError, match=r"criticism\.benchmark\.hearts: no heart was criticised"):
        score_benchmark([], [], [], *[tmp_path / "any"] * 5)


@pytest.fixture(scope="module")
def summary(score):
    return json.loads((score / "summary.json").read_text())


def test_effects_that_can_be_seen_are_found(summary):
    assert [summary["singles"]["found"][key] for key in ("hits", "of")] == [9, 12]
    assert [summary["pairs"]["found"][key] for key in ("hits", "of")] == [1, 2]
    assert [summary["pairs"]["effects_found"][key] for key in ("hits", "of")] == [3, 4]
    assert summary["triples"]["hearts"] == 0 and summary["triples"]["found"]["share"] is None


def test_what_is_absent_is_wrong_in_its_place_or_at_all(summary):
    # Two with another cause, and a scar in another segment; a group of which one is there is right.
    assert [summary["absent_named"][key] for key in ("hits", "of")] == [3, 19]
    assert summary["nulls"]["wrong_named"] == rate(pd.Series([True] + [False] * 19))
    assert [summary["unlisted"]["wrong_named"][key] for key in ("hits", "of")] == [1, 2]
    assert summary["unlisted_by_kind"]["other_law"]["wrong_named"]["hits"] == 1
    assert summary["misread"]["wrong_named"]["hits"] == 0


def test_intervals_hold_what_is_true_as_often_as_they_do(summary):
    # Of twelve in the answer, basal motion is 5 where its interval ends at 3.
    assert (summary["coverage"]["hits"], summary["coverage"]["of"]) == (11, 12)
    nulls = summary["nulls"]["stiffness"]
    assert (nulls["averaged"]["hits"], nulls["as_it_is"]["hits"], nulls["true"]["of"]) == (
        20,
        0,
        20,
    )
    assert summary["nulls"]["width_ratio"] == pytest.approx(2.0)
    assert summary["misread"]["stiffness"]["averaged"]["hits"] == 0
    # Under another law there is no such stiffness, and without a true model no such width.
    unlisted = summary["unlisted"]["stiffness"]
    assert (unlisted["averaged"]["of"], unlisted["true"]["of"]) == (1, 0)
    assert summary["unlisted"]["width_ratio"] is None


def test_p_values_of_true_models_are_judged_once_a_heart(summary):
    rejected = summary["true_model"]["rejected"]
    # 39 hearts whose p-values are 0, 0.05, ... in turn.
    assert (rejected["hits"], rejected["of"]) == (1, 39)
    assert summary["true_model"]["uniform_p_value"] > 0.5
    assert (summary["seconds"], summary["simulations"]) == (20.0, 8.0)


def test_probabilities_are_compared_with_how_often_causes_are_present():
    rng = np.random.default_rng(0)
    probability = rng.uniform(size=4000)
    table = pd.DataFrame(
        {"probability": probability, "present": rng.uniform(size=4000) < probability}
    )
    calibrated = reliabilities(table.assign(size=1))
    assert (
        (calibrated["low"] < calibrated["probability"])
        & (calibrated["probability"] < calibrated["high"])
    ).all()
    assert calibrated["count"].sum() == 4000
    # Every number of causes counts the same: one present in all of few, and absent in all of many.
    few = pd.DataFrame({"probability": 0.5, "present": [True] * 10, "size": 1})
    many = pd.DataFrame({"probability": 0.5, "present": [False] * 1000, "size": 0})
    (row,) = reliabilities(pd.concat([few, many])).to_dict("records")
    assert row["share"] == pytest.approx(0.5) and row["low"] < 0.35


def test_rates_have_exact_intervals():
    """Clopper-Pearson for 5 of 100 is 1.64 to 11.28 %."""
    hits = pd.Series([True] * 5 + [False] * 95)
    wanted = (pytest.approx(0.0164, abs=1e-4), pytest.approx(0.1128, abs=1e-4))
    assert (rate(hits)["low"], rate(hits)["high"]) == wanted
    same = weighted_rate(hits, pd.Series(np.full(100, 3.0)))
    assert (same["low"], same["high"]) == wanted
    assert rate(pd.Series([False] * 10))["low"] == 0.0
    weights = np.random.default_rng(1).uniform(0.1, 1, 60)
    for size in range(2, 60):  # whose sums do not add up to the last digit
        all_hit = weighted_rate(pd.Series([True] * size), pd.Series(weights[:size]))
        assert all_hit["share"] == all_hit["high"] == 1.0


def test_expected_score_is_the_effect_over_its_standard_error():
    """That of generalised least squares in all that is free, by statsmodels."""
    inputs = toy_inputs(inferred=3, suspected=4)
    truth = np.array([0.2, -0.3, 0.1, 0.5, -0.4, 0.0, 0.0])
    potential, slopes, covariance = linear_problem(inputs, 12, truth)
    model = GLS(np.zeros(12), slopes[:, :5].numpy(), covariance.numpy())
    errors = np.sqrt(model.fit().normalized_cov_params.diagonal()[3:])
    on = [3, 4]
    scores = expected_scores(potential, torch.as_tensor(truth)[None], potential.free(on)[None], on)
    assert [scores[k] for k in on] == pytest.approx(abs(truth[3:5]) / errors, rel=1e-4)


def test_inputs_left_out_keep_their_nominal_values():
    """Those that the study gives, if it gives any."""
    members = toy_inputs(inferred=2, suspected=3)
    roles = dict.fromkeys(("c0", "c1", "c2"), Role("suspected", value=0.4))
    inputs = Inputs({}, members, roles).fixing(["c1"])
    assert inputs.names == ("t0", "t1", "c0", "c1", "c2")
    assert inputs.of_role("suspected").tolist() == [False, False, True, False, True]
    assert inputs.nominal.tolist()[2:] == [0.4] * 3


def test_injected_rows_are_measured_tables(tmp_path):
    channels, rng = Channels.of(), np.random.default_rng(1)
    outputs = np.r_[150.0, np.repeat([-0.12, 0.4, -0.14], 17)]
    noise = {"strain": 0.01, "volume": 1.0}
    table = synthetic_subject(outputs, channels, noise, rng.normal(size=52))
    row = {"subject": "a"} | dict(zip(table["output"], table["value"], strict=True))
    row |= {f"sd_{o}": sd for o, sd in zip(table["output"], table["sd"], strict=True)}
    found = measured_of(pd.Series(row))
    write_measured(table, tmp_path / "a.csv")
    read = read_measured(tmp_path / "a.csv")
    columns = ["output", "quantity", "segment", "load_fraction", "value", "sd"]
    pd.testing.assert_frame_equal(found[columns], read[columns], check_exact=False)


def test_figure_shows_what_was_scored(score, tmp_path):
    files = [score / f"{name}.csv" for name in ("cases", "stiffness", "reliability")]
    hidden_effects.draw(*files, tmp_path / "a.png", tmp_path / "a.csv")
    table = pd.read_csv(tmp_path / "a.csv", keep_default_na=False)
    cell = (table["effect"] == "septal_load") & (table["answer"] == "basal_motion")
    # Of the pairs, basal motion is the other effect of the heart.
    assert table.loc[cell, "count"].astype(float).tolist() == [2.0]
    power = table[(table["panel"] == "power") & (table["group"] == "singles")]
    assert power["share"].astype(float).tolist() == [0.0, 0.8, 0.5]
    covered = table[(table["panel"] == "stiffness") & (table["group"] == "nulls")]
    assert covered["share"].astype(float).tolist() == [1.0, 0.0, 1.0]
