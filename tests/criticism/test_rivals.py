"""Which sets of causes are simulated."""

from types import SimpleNamespace

import pytest

from regional_lv.criticism.rivals import elsewhere


def one(name, probability, elsewhere=False, confirmed=False):
    return SimpleNamespace(
        name=name, probability=probability, elsewhere=elsewhere, confirmed=confirmed
    )


@pytest.mark.parametrize(
    ("sets", "again"),
    [
        # Far behind the first, but still before all that are confirmed.
        ([one("a", 1.0, True), one("b", 0.0, True), one("c", 0.0, False, True)], ["a", "b"]),
        ([one("a", 0.9, False, True), one("b", 0.05, True), one("c", 0.001, True)], ["b"]),
        ([one("a", 0.9), one("b", 0.1, True)], ["b"]),
        ([one("a", 0.99, False, True), one("b", 0.01)], []),
    ],
)
def test_the_last_round_is_for_what_was_simulated_elsewhere_and_leads(sets, again):
    assert [s.name for s in elsewhere(sets)] == again
