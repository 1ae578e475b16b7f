"""Inequalities that strains of a wall that keeps its volume obey."""

import numpy as np
import pandas as pd
import pytest

from regional_lv.channels import Channels
from regional_lv.measured import synthetic_subject
from regional_lv.measured.data_checks import DIRECTIONS, check
from regional_lv.quantities.seth_hill import Measure

CHANNELS = Channels.of()


def strains(exponent: float, shear: float = 0.1, thinning: float = 0.15, dilation: float = 1.0):
    """Measured table of walls of random deformations with det F = `dilation`, without noise."""
    rng, values = np.random.default_rng(0), np.empty((3, 17))
    for segment in range(17):
        f = np.diag([1 - thinning / 2, 1.0, 1 - thinning / 2])
        f += shear * rng.uniform(-1, 1, (3, 3))
        rest = np.linalg.det(f[np.ix_([0, 2], [0, 2])])
        f[1, 1] += (dilation - np.linalg.det(f)) / rest
        assert np.linalg.det(f) == pytest.approx(dilation)
        size, axes = np.linalg.eigh(f.T @ f)
        power = np.log(size) / 2 if exponent == 0 else (size ** (exponent / 2) - 1) / exponent
        values[:, segment] = np.diag(axes @ np.diag(power) @ axes.T)
    outputs = np.concatenate([[150.0], values.ravel()])
    noise = {"strain": 0.002, "volume": 1.0}
    return synthetic_subject(outputs, CHANNELS, noise, np.zeros(len(outputs)))


def of(checks, name):
    (found,) = [c for c in checks if c["name"] == name]
    return found


@pytest.mark.parametrize("exponent", [-2.0, 0.0, 1.0, 2.0])
def test_a_wall_that_keeps_its_volume_passes(exponent):
    checks = check(strains(exponent), Measure(exponent))
    assert all(c["passed"] for c in checks)


@pytest.mark.parametrize(("exponent", "dilation"), [(-2.0, 1.1), (1.0, 0.9), (2.0, 0.9)])
def test_a_wall_that_does_not_is_seen(exponent, dilation):
    """Measures of positive exponents see a wall that shrinks, the others one that grows."""
    table = strains(exponent, shear=0.02, dilation=dilation)
    found = of(check(table, Measure(exponent)), "volume_preserving")
    assert not found["passed"] and "keeps its volume" in found["says"]


def test_another_measure_shows_and_is_named():
    """Logarithmic strains add up to zero; read as Green's they lose volume."""
    found = of(check(strains(0.0, shear=0.0), Measure()), "volume_preserving")
    assert not found["passed"]
    assert "logarithmic" in found["says"] and " Green" not in found["says"]


def test_of_strains_of_a_known_measure_no_other_one_is_asked_for():
    found = of(check(strains(0.0, shear=0.0), Measure(), converted=True), "volume_preserving")
    assert not found["passed"] and "the directions of the columns" in found["says"]
    assert "logarithmic" not in found["says"] and "measure" not in found["says"]


def test_logarithmic_strains_that_add_up_to_nothing_hide_no_other_segment():
    table = strains(0.0, shear=0.02, dilation=1.1)
    for quantity, value in (("circumferential", -0.15), ("radial", 0.3), ("longitudinal", -0.15)):
        row = (table["quantity"] == quantity) & (table["segment"] == 1)
        table.loc[row, "value"] = value
    assert not of(check(table, Measure(0.0)), "volume_preserving")["passed"]


def test_without_three_directions_there_is_nothing_to_check():
    table = strains(2.0)
    assert not check(table[table["quantity"] != "longitudinal"], Measure())


@pytest.mark.parametrize("share", [0.5, 1.0])
@pytest.mark.parametrize("exponent", [-2.0, 0.0, 1.0])
def test_lines_of_a_sheared_wall_get_longer(exponent, share):
    """As the components of a tensor these strains could not be."""
    table, rng = strains(2.0), np.random.default_rng(2)
    for segment in range(1, 18):
        f = np.eye(3) + np.triu(rng.uniform(0.2, 0.5, (3, 3)), 1)  # det 1
        lines = np.sqrt(np.diag(f.T @ f))
        value = np.log(lines) if exponent == 0 else (lines**exponent - 1) / exponent
        for quantity, each in zip(DIRECTIONS, value, strict=True):
            table.loc[(table["quantity"] == quantity) & (table["segment"] == segment), "value"] = (
                each
            )
    assert of(check(table, Measure(exponent, share)), "volume_preserving")["passed"]
    if exponent <= 0:
        assert not of(check(table, Measure(exponent)), "volume_preserving")["passed"]
    table.loc[table["quantity"].isin(DIRECTIONS), "value"] *= -1
    assert not of(check(table, Measure(exponent, 1.0)), "volume_preserving")["passed"]


def test_a_channel_that_shrinks_with_the_load():
    table = strains(2.0)
    torsion = {"output": "torsion", "quantity": "torsion", "segment": np.nan}
    rows = [torsion | {"load_fraction": load, "value": 0.06 * (1 - load)} for load in (0.5, 1.0)]
    turned = pd.DataFrame(rows).assign(sd=0.001)  # it may turn either way
    assert of(check(turned, Measure()), "grows_with_load")["passed"]
    half = table.assign(load_fraction=0.5, value=0.6 * table["value"])
    both = table._append(half, ignore_index=True)
    assert of(check(both, Measure()), "grows_with_load")["passed"]
    both.loc[both["load_fraction"] == 0.5, "value"] *= 2
    assert not of(check(both, Measure()), "grows_with_load")["passed"]


@pytest.mark.parametrize("exponent", [-2.0, 0.0, 1.0, 2.0])
def test_noise_alone_is_seldom_refused(exponent):
    """At the level of the check, 1 %, with noise of ten times the size."""
    table, rng, refused = strains(exponent, shear=0.0), np.random.default_rng(3), 0
    strain = table["quantity"] != "volume"
    table.loc[strain, "sd"] = 0.02
    for _ in range(200):
        noisy = table.copy()
        noisy.loc[strain, "value"] += 0.02 * rng.standard_normal(strain.sum())
        refused += not of(check(noisy, Measure(exponent)), "volume_preserving")["passed"]
    assert refused <= 12
