"""Sobol sets: in the box, balanced, reproducible, and independent of one another."""

import numpy as np
import pytest

from regional_lv import aha
from regional_lv.design import make_design, sobol

DESIGN = {"lower": 0.1, "upper": 5.0, "natural": 40, "log": 24, "test": 16}


def test_sets_have_the_asked_sizes_and_stay_in_the_box():
    sets = make_design(DESIGN, seed=1)
    assert {name: len(table) for name, table in sets.items()} == {"train": 64, "test": 16}
    train = sets["train"]
    assert list(train.columns) == ["sample", "scale", *aha.PARAMETERS]
    assert train["scale"].value_counts().to_dict() == {"natural": 40, "log": 24}
    assert train["sample"].tolist() == list(range(64))
    theta = train[list(aha.PARAMETERS)].to_numpy()
    assert theta.min() >= 0.1 and theta.max() <= 5.0


@pytest.mark.parametrize("scale", ["natural", "log"])
def test_each_parameter_is_spread_evenly_on_its_scale(scale):
    theta = sobol(64, 0.1, 5.0, scale, seed=3)
    place = theta if scale == "natural" else np.log(theta)
    low, high = (0.1, 5.0) if scale == "natural" else np.log([0.1, 5.0])
    # A balanced sequence of 64 has exactly four points in each sixteenth.
    counts = [np.histogram(column, 16, (low, high))[0] for column in place.T]
    assert np.all(np.array(counts) == 4)


def test_same_seed_same_points_and_sets_differ():
    again = make_design(DESIGN, seed=1)["train"]
    first = make_design(DESIGN, seed=1)["train"]
    other = make_design(DESIGN, seed=2)["train"]
    assert first.equals(again)
    assert not np.allclose(first["C_a_anterior"], other["C_a_anterior"])
    test = make_design(DESIGN, seed=1)["test"]
    assert not set(test["C_a_anterior"]) & set(first["C_a_anterior"])


def test_a_longer_design_begins_with_the_shorter_one():
    np.testing.assert_array_equal(
        sobol(20, 0.1, 5.0, "log", 5), sobol(100, 0.1, 5.0, "log", 5)[:20]
    )
