"""Ventricles of all kinds: within their ranges, in the same order, with smooth surfaces."""

import numpy as np
import pandas as pd
import pytest

from regional_lv.aha import LEVELS
from regional_lv.data import VOLUNTEER
from regional_lv.geometry.shape import LEVEL_KEYS
from regional_lv.geometry.table import read_segments
from regional_lv.hearts import population
from regional_lv.hearts.population import COLUMNS, HEART, KINDS, SegmentAngles, draw, is_smooth

LENGTH = 74.4


@pytest.fixture(scope="module")
def table():
    return read_segments(VOLUNTEER)


@pytest.fixture(scope="module")
def drawn(table):
    return draw(table, LENGTH, 64, seed=1)


def test_the_first_of_more_are_the_same(table, drawn):
    pd.testing.assert_frame_equal(draw(table, LENGTH, 12, seed=1), drawn.iloc[:12])
    assert not draw(table, LENGTH, 4, seed=2).equals(drawn.iloc[:4])


def test_a_longer_ventricle_is_a_larger_one(table, drawn):
    longer = table.assign(**{z: 1.5 * table[z] for z in ("z_top_mm", "z_bottom_mm")})
    other = draw(longer, 1.5 * LENGTH, 8, seed=1)
    columns, shares = list(COLUMNS[:-3]), list(LEVEL_KEYS)
    np.testing.assert_allclose(other[columns], 1.5 * drawn[columns].iloc[:8], rtol=1e-9)
    np.testing.assert_allclose(other[shares], drawn[shares].iloc[:8], rtol=1e-9)


def test_kinds_are_what_they_are_called(drawn):
    thickness = drawn[[f"wall_thickness_{s}" for s in range(1, 18)]].to_numpy()
    radius = drawn[[f"endo_radius_{s}" for s in LEVELS["mid"]]].to_numpy().mean(axis=1)
    kind = drawn[HEART]
    assert set(kind) == set(KINDS)
    share = kind.value_counts(normalize=True)
    assert all(abs(share[name] - expected) < 0.1 for name, (expected, *_) in KINDS.items())
    low, high = (LENGTH * end for end in population.THICKNESS)
    assert (thickness >= low - 1e-9).all() and (thickness <= high + 1e-9).all()
    thinned = thickness[kind == "infarct"].min(axis=1)
    assert (thinned <= LENGTH * population.INFARCT[1] + 1e-9).all()
    middle = np.median(thickness, axis=1)
    assert middle[kind == "hypertrophied"].mean() > 1.4 * middle[kind == "plain"].mean()
    assert radius[kind == "dilated"].mean() > 1.25 * radius[kind == "plain"].mean()


def test_figures_of_a_level_go_together(drawn):
    """A wall is thick or thin as a whole; radii vary by level and wall alone."""
    thickness = np.log(drawn[drawn[HEART] == "plain"][[f"wall_thickness_{s}" for s in (7, 8, 10)]])
    assert np.corrcoef(thickness.T)[0, 1:].min() > 0.3


def test_shapes_without_a_smooth_surface_are_left_out(table, drawn, monkeypatch):
    angles = SegmentAngles(table, LENGTH)
    shapes = drawn[list(COLUMNS)].to_numpy(float)
    assert all(is_smooth(angles, shape) for shape in shapes[:8])
    spoiled = shapes[0].copy()
    spoiled[6] = 0.5  # between walls of a centimetre
    assert not is_smooth(angles, spoiled)
    kept = [shape for shape in shapes[:16] if shape[0] > 12]
    monkeypatch.setattr(
        population,
        "is_smooth",
        lambda angles, shape: is_smooth(angles, shape) and shape[0] > 12,
    )
    found = draw(table, LENGTH, len(kept), seed=1)[list(COLUMNS)].to_numpy(float)
    np.testing.assert_array_equal(found, kept)
