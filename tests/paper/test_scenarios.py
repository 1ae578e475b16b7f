"""Scenario designs, the noise of their twins, and telling stiff zones from healthy ones."""

import numpy as np
import pandas as pd
import pytest
from sklearn.metrics import roc_auc_score

from regional_lv.channels import Channels
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.posteriors.classification import (
    area,
    areas_of,
    auc_interval,
    curve_of,
    score_classification,
    stiffness,
)
from regional_lv.paper.posteriors.sets import add_noise
from regional_lv.paper.scenarios import draw_scenario, labels_of, write_scenario
from regional_lv.simulation.scenarios import scenario_size

PARAMETERS, CHANNELS = StiffnessInputs(), Channels.of()
HEALTHY = {"mean": 1.0, "sd": 0.05}
LOCAL = {"kind": "local", "mu": 2.0, "sd": 0.5, "samples_per_zone": 200, "samples": 100}
GLOBAL = LOCAL | {"kind": "global", "mu": 1.7}


def test_one_zone_is_stiff():
    table = draw_scenario("s", LOCAL, HEALTHY, PARAMETERS, 1)
    assert len(table) == scenario_size(LOCAL, PARAMETERS) == 1000
    assert table["zone"].value_counts().to_dict() == dict.fromkeys(PARAMETERS.zone_names, 200)
    for zone, part in table.groupby("zone"):
        stiff = [f"{c}_{zone}" for c in ("C_a", "C_b")]
        healthy = [name for name in PARAMETERS.names if name not in stiff]
        # Standard deviations, not variances.
        assert part[stiff].to_numpy().std() == pytest.approx(0.5, rel=0.1)
        assert part[stiff].to_numpy().mean() == pytest.approx(2.0, abs=0.1)
        assert part[healthy].to_numpy().std() == pytest.approx(0.05, rel=0.1)
        assert abs(np.corrcoef(part[stiff].T)[0, 1]) < 0.25


def test_all_zones_are_stiff_and_stay_within_the_bounds():
    wide = GLOBAL | {"sd": 2.0}
    table = draw_scenario("s", wide, HEALTHY, PARAMETERS, 1)
    values = table[list(PARAMETERS.names)].to_numpy()
    assert len(table) == 100 and (table["zone"] == "all").all()
    assert values.min() > 0.1 and values.max() < 5.0
    again = draw_scenario("s", wide, HEALTHY, PARAMETERS, 1)
    pd.testing.assert_frame_equal(table, again)
    assert not draw_scenario("t", wide, HEALTHY, PARAMETERS, 1)["C_a_apical"].equals(
        table["C_a_apical"]
    )


def test_scenarios_of_other_zones_and_factors(tmp_path):
    zones = {"free": [1, 4, 5, 6, 7, 10, 11, 12, 13, 15, 16, 17], "septal": [2, 3, 8, 9, 14]}
    two = StiffnessInputs(zones, law="guccione", bounds={"C_c": (0.1, 5.0), "C_b": (0.9, 2.5)})
    write_scenario("s", LOCAL, HEALTHY, two, 1, tmp_path / "s.parquet")
    table = pd.read_parquet(tmp_path / "s.parquet")
    assert len(table) == scenario_size(LOCAL, two) == 400
    assert list(table) == ["sample", "scale", *two.names, "zone"]
    for zone in zones:
        mine, other = table[table["zone"] == zone], table[table["zone"] != zone]
        assert mine[f"C_c_{zone}"].mean() == pytest.approx(2.0, abs=0.1)
        assert mine[f"C_b_{zone}"].between(0.9, 2.5).all() and mine[f"C_b_{zone}"].max() > 2.3
        assert other[f"C_c_{zone}"].mean() == pytest.approx(1.0, abs=0.02)


def test_scenarios_of_the_same_mean_go_by_their_names():
    sets = {"a": LOCAL, "b": GLOBAL, "c": LOCAL | {"sd": 0.2}}
    assert labels_of(sets) == {"a": "a", "b": "global, μ = 1.7", "c": "c"}


def test_noise_of_a_twin():
    noise = {"volume": 2.0, "circumferential": 0.02, "radial": 0.05, "longitudinal": None}
    y = np.zeros((300, 52))
    samples = [str(i) for i in range(300)]
    noisy, sd = add_noise(y, CHANNELS, samples, noise, 1, "s-noisy")
    assert len(sd) == 52 and np.isfinite(sd).sum() == 35
    for direction, expected in (("circumferential", 0.02), ("radial", 0.05), ("longitudinal", 0)):
        here = [name.startswith(direction) for name in CHANNELS.names]
        assert noisy[:, here].std() == pytest.approx(expected, rel=0.05, abs=1e-12)
    assert noisy[:, 0].std() == pytest.approx(2.0, rel=0.15)
    alone, _ = add_noise(y[7:8], CHANNELS, ["7"], noise, 1, "s-noisy")
    np.testing.assert_array_equal(alone[0], noisy[7])


def test_stiffness_of_the_zones():
    theta = np.arange(1.0, 11.0)
    found = stiffness(theta[None], PARAMETERS)[0]
    np.testing.assert_allclose(found[1], [3.0, 4.0, np.sqrt(12.0)])


def test_roc_and_area():
    label = np.array([True, True, True, False, False])
    score = np.array([0.9, 0.8, 0.3, 0.3, 0.1])
    assert area(label, score) == pytest.approx(5.5 / 6)
    curve = curve_of(label, score)
    assert curve["threshold"].tolist() == [np.inf, 0.9, 0.8, 0.3, 0.1]
    assert curve["false_positive_rate"].tolist() == [0, 0, 0, 0.5, 1]
    assert curve["true_positive_rate"].tolist() == pytest.approx([0, 1 / 3, 2 / 3, 1, 1])
    # The trapezoids under the curve are the same area.
    false, true = curve["false_positive_rate"].to_numpy(), curve["true_positive_rate"].to_numpy()
    assert np.sum(np.diff(false) * (true[1:] + true[:-1]) / 2) == pytest.approx(5.5 / 6)
    # Rows may count several times, or not at all.
    twice = np.array([0, 0, 2, 1, 1])
    assert areas_of(label, score, twice[None]) == pytest.approx(0.75)
    assert np.isnan(area(label[:3], score[:3])) and np.isnan(
        areas_of(label, score, label[None] * 1)
    )
    alone = curve_of(label[:3], score[:3])
    assert alone["false_positive_rate"].isna().all()
    assert alone["true_positive_rate"].tolist() == pytest.approx([0, 1 / 3, 2 / 3, 1])


def test_areas_of_resamples_are_those_of_scikit_learn():
    rng = np.random.default_rng(1)
    label = rng.random(80) < 0.3
    score = np.round(rng.normal(size=80) + label, 1)  # with ties
    counts = rng.integers(4, size=(20, 80))
    each = [roc_auc_score(label, score, sample_weight=row) for row in counts]
    assert areas_of(label, score, counts) == pytest.approx(each, abs=1e-12)


def test_interval_of_an_area_that_is_known():
    rng = np.random.default_rng(3)
    label = np.tile([True, False, False, False, False], 60)
    score = rng.normal(size=300) + 1.5 * label
    low, high = auc_interval(label, score, np.repeat(np.arange(60), 5).astype(str), rng)
    assert low < 0.8556 < high and high - low < 0.15  # Phi(1.5 / sqrt 2)


def classified(stiffened, probability, path):
    rows = [
        {"case": str(i), "zone": zone, "quantity": q, "stiffened": s, "probability": p}
        for i, (s, p) in enumerate(zip(stiffened, probability, strict=True))
        for zone in PARAMETERS.zone_names
        for q in ("C_a", "C_b", "both")
    ]
    pd.DataFrame(rows).to_csv(path, index=False)
    return path


def test_global_stiffening_is_compared_with_healthy_zones_elsewhere(tmp_path, monkeypatch):
    # None of them is checked here.
    monkeypatch.setattr("regional_lv.paper.posteriors.classification.RESAMPLES", 20)
    own = classified([True] * 3, [0.9, 0.8, 0.4], tmp_path / "global.csv")
    local = classified([True, False, False], [0.1, 0.5, 0.2], tmp_path / "local.csv")
    score_classification(own, [local], tmp_path / "roc.csv", tmp_path / "auc.csv", 1)
    auc = pd.read_csv(tmp_path / "auc.csv")
    assert (auc["negatives_from"] == "local").all()
    both = auc[(auc["quantity"] == "both") & (auc["zone"] == "septal")].iloc[0]
    assert both["auc"] == pytest.approx(5 / 6) and both["positives"] == 3
    assert both["negatives"] == 2
    score_classification(own, [], tmp_path / "roc.csv", tmp_path / "auc.csv", 1)
    assert pd.read_csv(tmp_path / "auc.csv")["auc"].isna().all()
