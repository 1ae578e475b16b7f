"""Where to simulate: what inputs of every role are spread over."""

import numpy as np
import pytest

from regional_lv import config
from regional_lv.inputs.space import Inputs, sections_of
from regional_lv.simulation.design import FEW, MOST_ON, REACH, draw_inputs

N = 512


def inputs_of(**roles):
    return Inputs.from_config(sections_of(config.load({"study": "design", "inputs": roles})))


def drawn(**roles):
    """Inputs, and their scaled coordinates between the ends of their ranges (N, K)."""
    found = inputs_of(**roles).simulated
    space = found.coordinates
    low, high = space.scaled(space.lower), space.scaled(space.upper)
    return found, (space.scaled(draw_inputs(found, N, seed=4)) - low) / (high - low)


def even(shares):
    """Whether shares (n,) are spread evenly over 0 to 1: each quarter has its part."""
    counts, _ = np.histogram(shares, 4, (0, 1))
    return counts.sum() == len(shares) and np.abs(counts / len(shares) - 0.25).max() < 0.06


def test_inferred_inputs_are_spread_over_their_ranges():
    _, places = drawn()
    assert places.shape == (N, 10)
    assert all(even(column) for column in places.T)


def test_measured_inputs_are_spread_around_what_is_measured():
    given = {"role": "measured", "sd_mm": 1.0, "value": 75.0}
    found = inputs_of(length=given, wall_thickness_3={"role": "measured", "sd_mm": 8.0})
    values = draw_inputs(found, N, seed=4)
    length = values[:, found.names.index("length")]
    assert length.min() == pytest.approx(75 - REACH, abs=0.1)
    assert length.max() == pytest.approx(75 + REACH, abs=0.1)
    # Never beyond the range of what is plausible.
    place = found.names.index("wall_thickness_3")
    thickness = values[:, place]
    assert thickness.min() == pytest.approx(found[place].low, rel=0.01)
    assert thickness.max() == pytest.approx(found[place].high, rel=0.01)


@pytest.mark.parametrize("count", [3, 14])
def test_suspected_inputs_are_mostly_off(count):
    names = [
        *("septal_load", "basal_motion", "helix_endo", "helix_epi", "anisotropy", "length"),
        *("exponent_ratio", "sheet_angle", "basal_twist", "basal_axial", "compressibility"),
        *("strain_measure", "line_strain", "segment_rotation"),
    ][:count]
    found, places = drawn(**dict.fromkeys(names, "suspected"))
    at_rest = (found.coordinates.scaled(found.nominal)) - found.coordinates.scaled(found.lower)
    at_rest /= found.coordinates.scaled(found.upper) - found.coordinates.scaled(found.lower)
    on = ~np.isclose(places, at_rest, atol=1e-12)[:, 10:]
    assert on.mean(axis=0) == pytest.approx(min(MOST_ON, FEW / count) / 2, abs=0.05)
    assert 0.1 < (~on.any(axis=1)).mean() < 0.5
    for column, mask in zip(places[:, 10:].T, on.T, strict=True):
        counts, _ = np.histogram(column[mask], 4, (0, 1))
        assert counts.min() > 0.15 * mask.sum()


def test_at_most_two_scars():
    found = inputs_of(focal_scar="suspected")
    scars = draw_inputs(found, N, seed=4)[:, 10:]
    on = (scars != 1).sum(axis=1)
    assert set(on) == {0, 1, 2}
    assert (scars != 1).any(axis=0).all()
    assert np.isclose((scars != 1).sum(), MOST_ON * N, rtol=0.1)


def test_the_seed_says_it_all():
    found = inputs_of(septal_load="suspected")
    one, again, other = (draw_inputs(found, 16, seed) for seed in (1, 1, 2))
    assert (one == again).all() and (one != other).any()
