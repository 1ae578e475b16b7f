"""Findings as sentences."""

import pytest

from regional_lv.criticism import words


def channel(subject, value):
    return {
        **{"subject": subject, "output": "volume_ml", "quantity": "volume", "segment": None},
        **{"observed": value, "predicted": value - 20.0, "sd": 1.5, "z": 6.0},
    }


def misfit_of(channels, *names):
    part = {
        **{"detected": True, "p_value": 0.001, "families": {"channel": 0.001}},
        "largest": [
            {"family": "channel", "what": name, "z": 6.0, "p_value": 0.001} for name in names
        ],
        "channels": channels,
    }
    return words.misfit(part)


def test_a_channel_of_several_hearts_is_that_of_its_own_heart():
    hearts = [channel("first", 180.0), channel("second", 220.0)]
    text = misfit_of(hearts, "second: volume_ml", "first: volume_ml")
    assert "second: the volume is 220 where 200 +- 1.5" in text
    assert "first: the volume is 180 where 160 +- 1.5" in text


def test_a_channel_of_one_heart_has_no_name_before_it():
    text = misfit_of([channel("first", 180.0)], "volume_ml")
    assert "Single channels: the volume is 180" in text


@pytest.mark.parametrize(
    ("output", "text"),
    [
        ("volume_ml", "the volume"),
        ("volume_ml@0.5", "the volume at 50 % of the end-diastolic pressure"),
        ("radial_07", "radial strain of segment 7 (mid anterior)"),
        (
            "radial_07@0.75",
            "radial strain of segment 7 (mid anterior) at 75 % of the end-diastolic pressure",
        ),
        ("torsion_basal-apical", "torsion basal-apical"),
        ("shortening", "the shortening"),
    ],
)
def test_channels_in_words(output, text):
    assert words.channel(output) == text


def test_what_was_not_simulated_is_not_confirmed():
    """Heavy tails are named; the sets beside them were simulated."""
    part = {"simulations": 90, "simulations_of_best": 60, "channels": []}
    part["largest_difference_sd"] = None
    assert words._confirmed({"confirmation": part}) == []
    (text,) = words._confirmed({"confirmation": part | {"largest_difference_sd": 0.4}})
    assert "60 simulations" in text and "0.4 sd" in text


@pytest.mark.parametrize(
    ("share", "failed", "elsewhere", "undecided", "told"),
    [
        (0.12, 0, 0, True, ["simulated have 12 % of the probability: more rounds", "tell more."]),
        (0.12, 0, 0, False, ["simulated have 12 % of the probability: more rounds", "estimates."]),
        (0.04, 0, 0.04, True, []),
        (0.0, 0.3, 0, True, ["did not converge have 30 %"]),
        (0.0, 0, 0.4, True, ["far from their estimates have 40 %", "may tell more."]),
    ],
)
def test_what_no_simulations_stand_behind(share, failed, elsewhere, undecided, told):
    part = {"probability_not_simulated": share, "probability_failed": failed}
    part["probability_elsewhere"] = elsewhere
    text = words._not_simulated({"confirmation": part, "least_probability": 0.95}, undecided)
    assert len(text) == bool(told) and all(piece in text[0] for piece in told)


@pytest.mark.parametrize(
    ("best", "base", "unlisted", "others", "why"),
    [
        (0.5, 0.4, 0.1, 0.0, "fits, but has a probability of 0.50 only, the model as it is 0.40"),
        (0.3, 0.1, 0.1, 0.5, "several sets do as well"),
        (0.3, 0.6, 0.1, 0.0, "the model as it is remains"),
        (0.2, 0.1, 0.7, 0.0, "a smooth departure of no listed shape fits better"),
    ],
)
def test_why_no_cause_is_named_where_the_best_set_fits(best, base, unlisted, others, why):
    sets = [{"causes": ["a"], "probability": best}, {"causes": ["b"], "probability": others}]
    content = {"sets": sets, "best": ["a"], "base_probability": base, "acts_like": []}
    content |= {"unlisted_probability": unlisted, "remaining": {"detected": False}}
    assert why in words._why_not(content)
