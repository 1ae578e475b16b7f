"""Names and orders: an exchange of segments would go through the whole study unseen."""

import numpy as np
import pytest

from regional_lv import aha
from regional_lv.channels import Channels
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.seeds import derive


def test_zones_are_those_of_the_paper():
    members = {zone: list(segments) for zone, segments in StiffnessInputs().zones.items()}
    assert members == {
        "anterior": [1, 7],
        "inferior": [4, 10],
        "lateral": [5, 6, 11, 12],
        "septal": [2, 3, 8, 9],
        "apical": [13, 14, 15, 16, 17],
    }


def test_published_order_is_a_permutation_and_converts_by_name():
    assert sorted(s.published_order for s in aha.SEGMENTS) == list(range(1, 18))
    published = np.array(
        [
            "basal inferoseptal",
            "basal anteroseptal",
            "basal anterior",
            "basal anterolateral",
            "basal inferolateral",
            "basal inferior",
            "mid inferoseptal",
            "mid anteroseptal",
            "mid anterior",
            "mid anterolateral",
            "mid inferolateral",
            "mid inferior",
            "apical septal",
            "apical anterior",
            "apical lateral",
            "apical inferior",
            "apex",
        ]
    )
    assert published[aha.published_to_aha].tolist() == [s.name for s in aha.SEGMENTS]
    round_trip = published[aha.published_to_aha][aha.aha_to_published]
    assert round_trip.tolist() == published.tolist()


def test_outputs_from_the_published_table_keep_volume_and_directions():
    row = np.arange(52.0)
    converted, outputs = aha.outputs_from_published(row), Channels.of().names
    assert converted[0] == 0
    assert converted[outputs.index("circumferential_01")] == 3  # basal anterior is third
    assert converted[outputs.index("radial_17")] == 1 + 17 + 16


def test_six_apical_walls_lie_in_the_four_sectors_of_the_aha():
    """By counting degrees: the anterior wall's middle is at 90 in all levels."""
    degrees = np.arange(0.5, 360)
    four = 13 + ((degrees - 45) // 90).astype(int) % 4
    six = 13 + ((degrees - 60) // 60).astype(int) % 6
    counted = {
        segment: {wall: (six[four == segment] == wall).mean() for wall in set(six[four == segment])}
        for segment in range(13, 17)
    }
    assert {s: pytest.approx(shares) for s, shares in counted.items()} == aha.APICAL_SHARES


def test_derived_seeds_depend_on_every_name():
    seeds = {derive(1), derive(2), derive(1, "a"), derive(1, "a", "b"), derive(1, "ab")}
    assert len(seeds) == 5
    assert all(0 <= seed < 2**31 for seed in seeds)
    assert derive(1, "a") == derive(1, "a")


def test_segments_that_share_a_border():
    pairs = {tuple(sorted(pair)) for n in range(1, 18) for pair in _bordering(n)}
    for one in range(1, 18):
        for two in range(1, 18):
            assert aha.adjoin(one, two) == (tuple(sorted((one, two))) in pairs)


def _bordering(n):
    """Within the level to the next, and down; written out from the AHA's figure."""
    following = {6: 1, 12: 7, 16: 13}.get(n, n + 1)
    below = {7: 13, 8: 14, 9: 14, 10: 15, 11: 16, 12: 16}
    yield from [(n, following)] if n < 17 else []
    yield from [(n, n + 6)] if n < 7 else []
    yield from [(n, below[n])] if n in below else []
    yield from [(n, 17)] if 12 < n < 17 else []
