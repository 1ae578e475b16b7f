"""Findings as sentences."""

import pytest

from regional_lv.channels import Channels
from regional_lv.criticism import words
from tests.criticism.findings_example import example, misfit, one_set

OUTPUTS = Channels.of().names


def verdict(**changes) -> str:
    return " ".join(example(**changes)["words"])


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


@pytest.mark.parametrize(
    ("name", "text", "source"),
    [
        ("wall_thickness_3", "wall thickness of segment 3", "geometry"),
        ("endo_radius_17", "endo radius of segment 17", "geometry"),
        ("end_diastolic_pressure", "end diastolic pressure", "pressure"),
        ("helix_endo", "helix endo", "fibres"),
        ("models", "models", "doubt about the model"),
        ("from_a_plugin", "from a plugin", "from a plugin"),
    ],
)
def test_inputs_and_sources_of_variance_in_words(name, text, source):
    assert words.input_in_words(name) == text
    assert words.variance_source(name) == source


@pytest.mark.parametrize(
    ("probability", "text"),
    [
        (0.0, "less than 0.1 %"),
        (0.0049, "0.5 %"),
        (0.364, "36 %"),
        (0.996, "99.6 %"),
        (1.0, "more than 99.9 %"),
    ],
)
def test_no_probability_is_certain(probability, text):
    assert words.percent(probability) == text


def test_a_confirmed_set_is_named_with_its_estimates():
    text = verdict()
    assert "Named: septal load, size of the effect 2.1 mmHg (95 % interval" in text
    assert "Named: focal scar in segment 7 (mid anterior)" in text
    assert "90 % of that for this segment" in text
    assert "agrees with 12 simulations" in text and "8 of them of the best set" in text
    assert "Suspected" not in text
    assert words.answer(example()).startswith("Named: septal load and focal scar in segment 7")


def test_a_cause_in_two_places_is_confirmed_as_one():
    causes = ["septal_load", "focal_scar", "focal_scar"]
    two = {**example()["sets"][0], "causes": causes, "components": ["", "7", "8"]}
    text = verdict(sets=[two])
    assert "Named: focal scar in segment 7" in text and "Suspected" not in text


def test_a_set_in_other_places_that_is_not_confirmed_hides_no_best_set():
    """Two scars are as probable; simulations confirm the second one, on which the answer stands."""
    first = one_set(["focal_scar"], ["7"], 0.50)
    best = one_set(["focal_scar"], ["8"], 0.46, confirmed=True)
    found = example(best=["focal_scar"], named=["focal_scar"], sets=[first, best])
    found["sets"][0]["best"], found["sets"][1]["best"] = False, True
    found["hypotheses"][1]["component"] = "8"
    assert words.answer(found).startswith("Named: focal scar in segment 8")
    assert "not confirmed" not in " ".join(words.verdict(found))


def test_what_no_simulation_confirms_is_suspected():
    found = example()
    best = {**found["sets"][0], "confirmed": False}
    sets, part = [best, *found["sets"][1:]], found["confirmation"]
    differs = {**part, "agrees": False, "emulator_error_sd": [3.5, 2.6]}
    text = verdict(sets=sets, confirmation=differs)
    assert "Suspected: septal load" in text and "Named" not in text
    assert "does not agree with 12 simulations" in text and "is 2.6 times the sds" in text
    few = verdict(sets=sets)
    assert "Suspected" in few and "too few simulations of it are known" in few
    none = {**part, "simulations": 0, "failed": 3, "emulator_error_sd": [], "channels": []}
    alone = example(sets=sets, confirmation=none)
    assert "3 simulations did not converge. No simulation stands" in " ".join(alone["words"])
    assert "rests on the emulator alone" in " ".join(alone["words"])
    assert words.answer(alone).startswith("Suspected")


@pytest.mark.parametrize(("share", "told"), [(0.12, True), (0.04, False)])
def test_what_no_simulations_stand_behind(share, told):
    part = {**example()["confirmation"], "probability_not_simulated": share, "failed": 2}
    text = verdict(confirmation=part)
    assert ("Sets that were never simulated have 12 % of the probability" in text) == told
    assert "2 simulations did not converge." in text


def test_other_answers_that_are_probable_are_told():
    text = verdict(base_probability=0.04, unlisted_probability=0.08)
    assert "A smooth departure of no listed shape has a probability of 8 %." in text
    assert "The model as it is has" not in text


def test_causes_that_replace_each_other_are_one_group():
    gap = {"output": "volume_ml", "load_fraction": 0.5, "noise": 1.0, "difference_in_noise_sd": -4}
    gap["subject"] = "anna"
    pair = {"pair": [["septal_load"], ["fibre_rotation"]], "components": [[""], [""]]}
    separating = [pair | {"channels": [gap]}]
    group = {"named": [], "groups": [["septal_load", "fibre_rotation"]], "separating": separating}
    found = example(**group, best=["septal_load"])
    text = " ".join(found["words"])
    assert "One of septal load or fibre rotation is present" in text
    assert "The most probable is septal load" in text
    assert (
        "The volume at 50 % of the end-diastolic pressure would separate septal load from fibre "
        "rotation best: they differ there by 4.0 sd of a noise of 1 mL." in text
    )
    assert "one of septal load or fibre rotation" in words.answer(found)
    assert "anna" not in text
    check = {"name": "volume_preserving", "passed": False, "says": "as Almansi strains they can"}
    several = example(
        **group,
        best=["septal_load"],
        subjects=["anna", "ben"],
        data_checks=[check | {"subject": "ben"}],
    )
    text = " ".join(several["words"])
    assert "anna: The volume at 50 %" in text and "ben: As Almansi strains they can." in text


def test_where_no_model_fits_this_is_said_first():
    lost = {"trusted": False, "explained": False, "named": [], "outliers": "three in ten are"}
    found = example(**lost, remaining=misfit(OUTPUTS, 2.5))
    first = found["words"][0]
    assert first.startswith("No stiffness of this heart can be trusted")
    tried = "septal load and focal scar in segment 7 (mid anterior) (p = 0.003) is the best"
    for what in ("the model as it is (p = 0.003)", tried, "smooth departure", "heavy tails"):
        assert what in first
    assert "no cause is named" in words.answer(found)
    assert words.untrusted(example()) == ""


def test_a_heart_without_causes_to_try():
    nothing = {"hypotheses": [], "sets": [], "named": [], "best": None, "remaining": None}
    lost = example(**nothing, explained=False, trusted=False, gain=example()["gain"])
    assert "No listed cause explains the misfit: there was none to try." in lost["words"]
    assert "listed causes" not in lost["words"][0]
    nothing |= {"explained": False, "misfit": misfit(OUTPUTS, 0.8)}
    quiet = example(**nothing, base_probability=0.9, unlisted_probability=0.1)
    searched = "No cause was searched: the emulator knows no input that is suspected."
    assert quiet["words"][1:] == [searched]
    improbable = example(**nothing, base_probability=0.02, unlisted_probability=0.98)
    (sentence,) = improbable["words"][1:]
    assert sentence.startswith(f"{searched} But the model as it is has a probability of 2 % only")
    assert sentence.endswith("A smooth departure of no listed shape has 98 %.")


def test_an_improbable_model_without_a_misfit():
    found = example(misfit=misfit(OUTPUTS, 0.8), base_probability=0.02)
    text = " ".join(found["words"])
    assert "No cause was found" not in text and "has a probability of 2 % only" in text
    assert "septal load and focal scar in segment 7" in text
    assert words.answer(found).startswith("The tests find no misfit, but other models are far")
    smooth = {"base_probability": 0.02, "unlisted_probability": 0.95}
    found = example(misfit=misfit(OUTPUTS, 0.8), **smooth)
    assert "smooth departure of no listed shape has 95 %." in " ".join(found["words"])
    probable = example(misfit=misfit(OUTPUTS, 0.8), base_probability=0.3)
    assert "No cause was found." in probable["words"]
    assert words.answer(probable).startswith("The model as it is fits the measurements.")


def test_at_the_end_of_its_range_a_cause_acts_like():
    found = {"named": ["focal_scar"], "acts_like": ["septal_load"]}
    assert "Something else acts like septal load" in verdict(**found)
    text = verdict(**found | {"named": []}, explained=False)
    assert "Of the listed causes septal load" in text and "it is not named" in text


@pytest.mark.parametrize(
    ("best", "base", "unlisted", "why"),
    [
        (0.5, 0.4, 0.1, "fits, but has a probability of 0.50 only, the model as it is 0.40"),
        (0.3, 0.1, 0.1, "several sets do as well"),
        (0.3, 0.6, 0.1, "the model as it is remains"),
        (0.2, 0.1, 0.7, "a smooth departure of no listed shape fits better"),
    ],
)
def test_why_no_cause_is_named_where_the_best_set_fits(best, base, unlisted, why):
    sets = [{**example()["sets"][0], "probability": best}]
    nothing = {"named": [], "explained": False, "sets": sets}
    text = verdict(**nothing, base_probability=base, unlisted_probability=unlisted)
    assert why in text
