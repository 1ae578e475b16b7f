"""Sobol sets: in the box, balanced, reproducible, and independent of one another."""

import numpy as np
import pandas as pd
import pytest

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.simulation.sobol import further_points, make_design, sobol, write_stiffness_design

PARAMETERS = StiffnessInputs()
LOWER, UPPER = PARAMETERS.lower, PARAMETERS.upper
DESIGN = {"natural": 40, "log": 24, "test": 16}


def test_sets_have_the_asked_sizes_and_stay_in_the_box():
    sets = make_design(DESIGN, PARAMETERS, seed=1)
    assert {name: len(table) for name, table in sets.items()} == {"train": 64, "test": 16}
    train = sets["train"]
    assert list(train.columns) == ["sample", "scale", *PARAMETERS.names]
    assert train["scale"].value_counts().to_dict() == {"natural": 40, "log": 24}
    assert train["sample"].tolist() == list(range(64))
    theta = train[list(PARAMETERS.names)].to_numpy()
    assert theta.min() >= 0.1 and theta.max() <= 5.0


@pytest.mark.parametrize("scale", ["natural", "log"])
def test_each_parameter_is_spread_evenly_on_its_scale(scale):
    theta = sobol(64, LOWER, UPPER, scale, seed=3)
    place = theta if scale == "natural" else np.log(theta)
    low, high = (0.1, 5.0) if scale == "natural" else np.log([0.1, 5.0])
    # A balanced sequence of 64 has exactly four points in each sixteenth.
    counts = [np.histogram(column, 16, (low, high))[0] for column in place.T]
    assert np.all(np.array(counts) == 4)


def test_same_seed_same_points_and_sets_differ():
    again = make_design(DESIGN, PARAMETERS, seed=1)["train"]
    first = make_design(DESIGN, PARAMETERS, seed=1)["train"]
    other = make_design(DESIGN, PARAMETERS, seed=2)["train"]
    assert first.equals(again)
    assert not np.allclose(first["C_a_anterior"], other["C_a_anterior"])
    test = make_design(DESIGN, PARAMETERS, seed=1)["test"]
    assert not set(test["C_a_anterior"]) & set(first["C_a_anterior"])


def test_a_longer_design_begins_with_the_shorter_one():
    np.testing.assert_array_equal(
        sobol(20, LOWER, UPPER, "log", 5), sobol(100, LOWER, UPPER, "log", 5)[:20]
    )


def test_bounds_may_differ_between_factors(tmp_path):
    bounds = {"C_a": (0.5, 2.0), "C_b": (0.1, 10.0)}
    whole = StiffnessInputs({"wall": range(1, 18)}, bounds=bounds)
    files = tmp_path / "train.parquet", tmp_path / "test.parquet"
    write_stiffness_design(DESIGN, whole, 1, *files)
    train, test = map(pd.read_parquet, files)
    assert list(train.columns) == ["sample", "scale", "C_a_wall", "C_b_wall"] == list(test.columns)
    for name, (low, high) in {"C_a_wall": bounds["C_a"], "C_b_wall": bounds["C_b"]}.items():
        assert train[name].between(low, high).all()
        assert np.log(train[name]).max() - np.log(train[name]).min() > 0.9 * np.log(high / low)
    more = further_points(whole, 1, "more", 6, 2)
    assert more.shape == (8, 2) and (more > whole.lower).all() and (more < whole.upper).all()
    assert not set(more[:, 0]) & set(train["C_a_wall"])
