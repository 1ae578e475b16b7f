"""The whole criticism of hearts in closed form: what is injected is found, and nothing else."""

import json
import math
import typing
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch

from regional_lv import aha
from regional_lv.criticism.contract import Findings, read_findings
from regional_lv.criticism.critic import EVIDENCES, Critic, _by_sampling
from regional_lv.criticism.designs import label
from regional_lv.criticism.findings import write_findings
from regional_lv.criticism.fit import fit_from_nothing
from regional_lv.criticism.observations import observe
from regional_lv.criticism.report import write_report
from regional_lv.criticism.score import Misfit
from regional_lv.criticism.search import log_evidence
from regional_lv.criticism.study import Inputs, criticise
from regional_lv.criticism.verdict import CauseSet, Searched, Settings
from regional_lv.errors import InputError
from regional_lv.inputs.scales import Linear, Saturating
from tests.criticism.toy import (
    OUTPUTS,
    TAILS,
    THETA,
    Extension,
    Hypothesis,
    ToyEmulator,
    basal,
    bias,
    catalogue,
    measured,
    pattern,
    scars,
    simulate,
)

BASAL = tuple(f"_{segment:02d}" for segment in aha.LEVELS["basal"])
SETTINGS = Settings(
    bootstrap=119, level=0.05, draws=500, largest_set=3, sets=3, simulations=6, rounds=2
)

DEEP = pytest.mark.test_all("more hearts in closed form, a quarter of a minute each")


def inputs(tables, extensions, noises, settings, known_theta=None):
    return Inputs(
        *("heart", tables, ToyEmulator(), extensions, list(noises)),
        *(settings, 2.0, 1.0, 7, known_theta),
    )


def findings(table, extensions=None, noises=(TAILS,), settings=SETTINGS, interaction=0.0):
    extensions = catalogue() if extensions is None else extensions
    given = inputs({"heart": table}, extensions, noises, settings)
    return criticise(given, simulate(extensions, interaction))


def answered(found) -> set[str]:
    return {*found["named"], *(name for group in found["groups"] for name in group)}


def with_effects(*effects, seed=5, wave=0.0):
    """Measured table with several effects (extension, psi) and a wave of their interaction."""
    emulator = ToyEmulator()
    table = measured(emulator, seed=seed)
    for extension, psi in effects:
        change = extension.mean(None, THETA, torch.tensor(psi, dtype=torch.float64))
        table["value"] += change.numpy()
    table["value"] += wave * np.sin(np.arange(len(table)))
    return table


@pytest.fixture(scope="module")
def injected():
    return measured(ToyEmulator(), basal(), 0.8, seed=5)


@pytest.fixture(scope="module")
def found(injected):
    return findings(injected)


def test_injected_effect_is_named(found):
    assert found["named"] == ["basal_motion"] and found["groups"] == []
    assert found["misfit"]["detected"]
    (basal_motion,) = [h for h in found["hypotheses"] if h["name"] == "basal_motion"]
    low, high = basal_motion["interval95"]
    assert low < 0.8 < high
    assert found["gain"]["elpd"] > 2 * found["gain"]["elpd_se"]
    assert found["gain"]["rmse_after"] < found["gain"]["rmse_before"]
    assert found["remaining"]["p_value"] > 0.05


@DEEP
def test_an_effect_without_which_nothing_fits_is_named():
    """The base model's posterior lies at its bounds there, and its evidence is poorly known."""
    found = findings(measured(ToyEmulator(), basal(), 1.9, seed=5, strain=0.0005))
    assert found["named"] == ["basal_motion"] and found["sets"][0]["log_evidence"] > 1000
    assert found["unlisted_probability"] < 0.01


@DEEP
def test_a_cause_that_data_hardly_determine_competes():
    """One with a small range, and another with a large range that does much the same: if only that
    one were searched, it would stand in for the first."""
    shape = pattern("radial", range(1, 7), 0.1) + pattern("longitudinal", range(7, 13), -0.04)
    weak = Extension(Hypothesis("weak", 0.0, 0.0, 0.2), shape)
    other = shape + pattern("circumferential", range(7, 13), 0.004)
    strong = Extension(Hypothesis("strong", 0.0, -3.0, 3.0), other)
    table = with_effects((basal(), 0.8), (weak, 0.2))
    found = findings(table, [weak, strong, *catalogue()])
    by_name = {h["name"]: h for h in found["hypotheses"]}
    assert by_name["strong"]["identifiable"] and not by_name["weak"]["identifiable"]
    assert found["named"] == ["basal_motion"]
    assert [set(group) for group in found["groups"]] == [{"weak", "strong"}]
    # What follows from another set than the best one is an estimate, too.
    assert by_name["weak"]["fitted"] and by_name["strong"]["fitted"]
    sentences = " ".join(found["words"])
    assert "Nothing can be concluded about weak" not in sentences


def test_pressure_is_reported_as_absorbed(found):
    (pressure,) = [h for h in found["hypotheses"] if h["name"] == "end_diastolic_pressure"]
    assert not pressure["identifiable"]
    assert "C_a of all zones together" in pressure["why"]
    assert pressure["probability"] == 0.0


def assert_typed(value, kind, where: str) -> None:
    """`value` has the keys of a typed dictionary, and so have those inside it."""
    if typing.is_typeddict(kind):
        hints = typing.get_type_hints(kind)
        assert set(value) == set(hints), where
        for key, hint in hints.items():
            assert_typed(value[key], hint, f"{where}.{key}")
    elif typing.get_origin(kind) is list:
        assert isinstance(value, list), where
        for one in value:
            assert_typed(one, *typing.get_args(kind), where)
    elif typing.get_origin(kind) is dict:
        assert isinstance(value, dict), where
    elif options := typing.get_args(kind):  # one of several
        if value is not None:
            assert_typed(value, options[0], where)
        assert value is not None or type(None) in options, where
    elif kind is float:
        assert type(value) in (float, int), where
    else:
        assert type(value) is kind, where


def test_findings_keep_the_contract(found, tmp_path):
    write_findings(found, tmp_path / "findings.json")
    content = read_findings(tmp_path / "findings.json")
    assert_typed(content, Findings, "findings")
    assert len(content["misfit"]["channels"]) == 52
    assert all({"name", "passed", "says"} <= set(row) for row in content["data_checks"])
    total = sum(row["probability"] for row in content["sets"])
    assert total <= 1 + 1e-9


def test_misfit_has_the_sign_of_the_effect(found, injected):
    """The injected basal motion makes radial strains larger and circumferential ones more negative
    than the base model can, by 6 and 4 sd of the noise less what theta takes up."""
    rows = pd.DataFrame(found["misfit"]["channels"]).set_index("output")
    measured_values = injected.set_index("output")["value"]
    pd.testing.assert_series_equal(rows["observed"], measured_values, check_names=False)
    z = (rows["observed"] - rows["predicted"]) / rows["sd"]
    pd.testing.assert_series_equal(rows["z"], z, check_names=False)
    basal_z = rows[rows["segment"].isin(aha.LEVELS["basal"])].groupby("quantity")["z"]
    assert basal_z.min()["radial"] > 2 and basal_z.max()["circumferential"] < -2
    largest = {row["what"]: row["z"] for row in found["misfit"]["largest"]}
    assert largest["basal radial"] > 2 and largest["basal circumferential"] < -2
    assert largest["radial_02"] > 2 and largest["circumferential_01"] < -2


def test_the_steps_between_files_lose_nothing(injected):
    critic = inputs({"heart": injected}, catalogue(), (TAILS,), SETTINGS).critic()
    searched = critic.search()
    again = Searched.of(json.loads(json.dumps(searched.content())))
    assert json.dumps(again.content()) == json.dumps(searched.content())
    pd.testing.assert_frame_equal(critic.plan(again, None, 0), critic.plan(searched, None, 0))


def test_report_needs_nothing_but_itself(found, tmp_path):
    write_findings(found, tmp_path / "findings.json")
    figure, table = tmp_path / "residuals.png", tmp_path / "residuals.csv"
    write_report(tmp_path / "findings.json", tmp_path / "report.html", figure, table)
    page = (tmp_path / "report.html").read_text()
    assert "Named: basal motion" in page
    assert page.count("data:image/png;base64,") == 4
    assert 'src="http' not in page and 'href="http' not in page
    assert "<link" not in page and "<script" not in page
    shown = {
        name: pd.read_csv(tmp_path / f"{name}.csv") for name in ("residuals", "causes", "theta")
    }
    assert shown["residuals"]["output"].nunique() == 52
    assert set(shown["causes"]["name"]) == {h["name"] for h in found["hypotheses"]}
    assert set(shown["theta"]["parameter"]) == {t["parameter"] for t in found["theta"]}
    drawn = pd.read_csv(tmp_path / "parameters.csv")["name"]
    assert "basal_motion" in set(drawn)


def test_nothing_is_found_once_the_effect_is_removed():
    found = findings(measured(ToyEmulator(), seed=5))
    assert answered(found) == set() and found["confirmation"]["simulations"] == 0
    assert found["words"][0].startswith("The model fits")
    assert any("No cause was found" in s for s in found["words"])


def test_shuffled_channels_name_nothing(injected):
    """Within each direction: a mess that no listed cause explains."""
    shuffled = injected.copy()
    rng = np.random.default_rng(0)
    for _, rows in shuffled.groupby("quantity"):
        shuffled.loc[rows.index, "value"] = rng.permutation(rows["value"].to_numpy())
    found = findings(shuffled, noises=())
    assert found["misfit"]["detected"]
    assert answered(found) == set()
    assert any("No listed cause explains the misfit" in s for s in found["words"])


def test_a_cause_that_is_not_listed():
    """A wave that none of the causes resembles."""
    sign = np.tile([1.0, -1.0], 9)[:17]
    wave = sum(pattern("longitudinal", [s], 0.05 * sign[s - 1]) for s in range(1, 18))
    cause = Extension(Hypothesis("unheard_of", 0.0, 0.0, 2.0), wave)
    found = findings(measured(ToyEmulator(), cause, 1.0, seed=5), noises=())
    assert found["misfit"]["detected"]
    assert answered(found) == set()
    assert any("No listed cause explains the misfit" in s for s in found["words"])


@pytest.mark.parametrize("scale", [Linear(), Saturating(1.0)])
def test_causes_that_look_alike_are_named_together(injected, scale):
    """A twin with the same signature but for a hair in one channel, and on a scale of its own."""
    twin = basal()
    twin = Extension(
        replace(twin.hypothesis, name="twin", scale=scale),
        twin.pattern + pattern("radial", [17], 0.01),
    )
    found = findings(injected, [bias(), basal(), twin])
    assert found["named"] == []
    assert [set(group) for group in found["groups"]] == [{"basal_motion", "twin"}]
    assert found["separating"][0]["channels"][0]["output"] == "radial_17"


def test_a_lower_load_tells_apart_what_end_diastole_cannot(injected):
    """A twin with the same signature, of an effect that shrinks with the load as springs do."""
    twin = basal()
    twin = Extension(replace(twin.hypothesis, name="twin", load_power=1.0), twin.pattern)
    settings = replace(SETTINGS, load_fractions=(0.75, 0.5))
    found = findings(injected, [bias(), basal(), twin], settings=settings)
    assert [set(group) for group in found["groups"]] == [{"basal_motion", "twin"}]
    best = found["separating"][0]["channels"][0]
    assert best["load_fraction"] == 0.5 and best["output"].endswith(BASAL)
    assert any("at 50 % of the end-diastolic pressure" in sentence for sentence in found["words"])


def test_a_scar_is_found_in_its_segment():
    found = findings(measured(ToyEmulator(), scars()[9], 0.8, seed=5))
    assert found["named"] == ["focal_scar"]
    (scar,) = [h for h in found["hypotheses"] if h["name"] == "focal_scar"]
    assert scar["component"] == "10" and scar["component_probability"] > 0.95
    assert not any("of that for this" in sentence for sentence in found["words"])


def test_a_cause_of_two_kinds_that_look_alike_says_how_sure_the_kind_is(injected):
    """The cause is certain, which of its kinds is at work is not; both never stand in one set."""
    like = basal()
    kind = Extension(like.hypothesis, like.pattern + pattern("radial", [17], 0.01), component="two")
    found = findings(injected, [bias(), like, kind])
    assert found["named"] == ["basal_motion"]
    (moved,) = [h for h in found["hypotheses"] if h["name"] == "basal_motion"]
    assert 0.1 < moved["component_probability"] < 0.9
    assert any("of that for this kind" in sentence for sentence in found["words"])
    assert all(s["causes"].count("basal_motion") <= 1 for s in found["sets"])


def test_three_effects_are_found_together():
    effects = (basal(), 1.0), (bias(), 0.5), (scars()[9], 1.0)
    found = findings(with_effects(*effects))
    assert set(found["named"]) == {"basal_motion", "radial_scale", "focal_scar"}
    by_name = {h["name"]: h for h in found["hypotheses"]}
    for extension, psi in effects:
        low, high = by_name[extension.hypothesis.name]["interval95"]
        assert low < psi < high
    assert found["explained"] and found["remaining"]["p_value"] > 0.01


def test_nothing_is_named_that_was_not_simulated(injected):
    found = criticise(inputs({"heart": injected}, catalogue(), (TAILS,), SETTINGS), None)
    assert found["misfit"]["detected"] and not found["explained"]
    assert answered(found) == set()
    assert any("no set was confirmed" in s for s in found["words"])
    assert any("By the emulators alone" in s and "basal motion" in s for s in found["words"])


@DEEP
def test_simulations_correct_what_effects_do_to_each_other():
    """A pair that interacts: without the simulations it does not fit, with them it does."""
    effects = (basal(), 1.0), (bias(), 0.5)
    table = with_effects(*effects, wave=0.02)
    found = findings(table, interaction=0.02)
    assert set(found["named"]) == {"basal_motion", "radial_scale"} and found["explained"]
    assert found["confirmation"]["largest_difference_sd"] == pytest.approx(2.0, abs=0.1)
    best = found["sets"][0]
    assert best["confirmed"] and best["misfit_p_value"] > 0.01
    assert set(best["beyond_sd"]) == {"basal_motion", "radial_scale"}
    assert max(map(abs, best["beyond_sd"].values())) < 10
    alone = findings(table, interaction=0.0)
    assert not alone["explained"] or set(alone["named"]) != {"basal_motion", "radial_scale"}


def test_a_cause_that_the_emulators_have_wrong_gets_its_simulations():
    """A rival resembles the truth, of which the emulators know little: by them alone the rival is
    certain. One round has to simulate what is most probable without it."""
    true, settings = basal(), replace(SETTINGS, rounds=1)
    rival = Extension(
        Hypothesis("fibre_rotation", 0.0, 0.0, 2.0),
        true.pattern + pattern("radial", (1, 3, 5), 0.04),
    )
    badly = Extension(
        true.hypothesis, true.pattern + pattern("circumferential", range(7, 13), 0.045)
    )
    table = with_effects((true, 1.0))
    given = inputs({"heart": table}, [badly, rival], (), settings)
    shares = {}
    for emulated in given.critic().search().sets:
        shares[emulated["members"][0][0]] = emulated["log_evidence"]
    assert shares["fibre_rotation"] > shares["basal_motion"] + 10
    found = criticise(given, simulate([true, rival]))
    assert found["named"] == ["basal_motion"] and found["explained"]
    (row,) = [h for h in found["hypotheses"] if h["name"] == "basal_motion"]
    assert row["interval95"][0] < 1.0 < row["interval95"][1]


@pytest.fixture(scope="module")
def simulated_elsewhere():
    """The emulator has twice the effect, so that its estimate is half of the truth, and the first
    round's simulations are all about that: what is planned and simulated in two rounds."""
    true = basal()
    badly = Extension(true.hypothesis, 2 * true.pattern)
    table = with_effects((true, 1.0))
    critic = inputs({"heart": table}, [badly], (), replace(SETTINGS, rounds=1)).critic()
    searched, made = critic.search(), []
    for turn in range(critic.settings.turns):
        planned = critic.plan(searched, pd.concat(made) if made else None, turn)
        made.append(simulate([true])(planned))
    return critic, searched, made


def test_what_was_simulated_elsewhere_is_simulated_again(simulated_elsewhere):
    _, _, (first, again) = simulated_elsewhere
    assert len(again) == SETTINGS.simulations
    values = [
        [json.loads(text)["basal_motion"][0] for text in made["effects"]] for made in (first, again)
    ]
    assert np.allclose(values[0], 0.5, atol=0.15) and np.allclose(values[1], 1.0, atol=0.15)


def test_a_set_is_confirmed_about_its_estimates_only(simulated_elsewhere):
    critic, searched, (first, again) = simulated_elsewhere
    before = critic.conclude(searched, first)
    (one,) = [s for s in before.sets if s.names == ("basal_motion",)]
    assert one.simulations == SETTINGS.simulations and one.elsewhere and not one.confirmed
    assert before.named == [] and before.best is not one
    after = critic.conclude(searched, pd.concat([first, again]))
    (one,) = [s for s in after.sets if s.names == ("basal_motion",)]
    assert one.simulations == 2 * SETTINGS.simulations and one.confirmed
    assert after.named == ["basal_motion"] and after.explained


def test_the_last_round_has_nothing_to_do_where_all_was_simulated_in_place(injected):
    critic = inputs({"heart": injected}, catalogue(), (), SETTINGS).critic()
    searched = critic.search()
    made = simulate(catalogue())(critic.plan(searched, None, 0))
    assert len(critic.plan(searched, made, 1)) > 0
    assert len(critic.plan(searched, made, SETTINGS.rounds)) == 0


@DEEP
def test_the_best_set_of_every_smaller_size_gets_its_simulations():
    """One cause whose emulator is off, beside two pairs of others that do what it does: neither the
    best set's own parts nor the best sets without one of them are the truth."""
    true, extra = basal(), pattern("radial", (2, 9), 0.01)
    around = pattern("circumferential", range(1, 7), -0.05)
    halves = {
        "fibre_rotation": around,
        "radial_scale": true.pattern - around,
        "septal_load": around + extra,
        "wall_thickness": true.pattern - around - extra,
    }
    badly = Extension(
        true.hypothesis, true.pattern + pattern("circumferential", range(7, 13), 0.03)
    )
    rivals = [Extension(Hypothesis(name, 0.0, 0.0, 2.0), half) for name, half in halves.items()]
    given = inputs({"heart": with_effects((true, 1.0))}, [badly, *rivals], (), SETTINGS)
    best = {name for name, _ in given.critic().search().sets[0]["members"]}
    assert best <= set(halves) and len(best) == 2
    found = criticise(given, simulate([true, *rivals]))
    assert "basal_motion" in answered(found)
    (one,) = [s for s in found["sets"] if s["causes"] == ["basal_motion"]]
    assert one["confirmed"] and one["simulations"] > 0


def test_what_simulations_do_to_a_set_is_expected_of_its_rivals():
    """Two causes do nearly the same, and the emulators have both wrong in the same way. Only one is
    simulated; that it then fits says nothing against the other."""
    true, settings = basal(), replace(SETTINGS, sets=1, rounds=1)
    wrong = pattern("circumferential", range(7, 13), 0.04)
    name = "fibre_rotation"
    other = Extension(Hypothesis(name, 0.0, 0.0, 2.0), true.pattern + pattern("radial", [3], 0.005))
    known = [
        Extension(cause.hypothesis, cause.pattern + wrong, component=cause.component)
        for cause in (true, other)
    ]
    given = inputs({"heart": with_effects((true, 1.0))}, known, (), settings)
    found = criticise(given, simulate([true, other]))
    assert [s["confirmed"] for s in found["sets"]].count(True) == 1
    assert found["named"] == [] and answered(found) == {"basal_motion", name}


def test_what_separates_two_causes_is_corrected_by_simulations():
    """They do the same but in one channel; the emulator of one says that they differ elsewhere."""
    true = basal()
    twin = Extension(
        Hypothesis("fibre_rotation", 0.0, 0.0, 2.0), true.pattern + pattern("radial", [17], 0.01)
    )
    wrong = Extension(twin.hypothesis, twin.pattern + pattern("circumferential", [9], 0.03))
    given = inputs({"heart": with_effects((true, 1.0))}, [true, wrong], (), SETTINGS)
    found = criticise(given, simulate([true, twin]))
    assert [set(group) for group in found["groups"]] == [{"basal_motion", "fibre_rotation"}]
    by_pair = {str(one["pair"]): one["channels"] for one in found["separating"]}
    best, *others = by_pair["[['basal_motion'], ['fibre_rotation']]"]
    assert best["output"] == "radial_17" and abs(best["difference_in_noise_sd"]) < 1
    assert "circumferential_09" not in {channel["output"] for channel in others}


def test_sets_that_cannot_be_simulated_do_not_keep_others_from_it():
    """Two effects; simulations of one cause alone do not converge."""
    extensions = [bias(), basal(), *scars()[:3]]
    table = with_effects((basal(), 0.8), (bias(), 0.4))
    critic = inputs({"heart": table}, extensions, (), replace(SETTINGS, sets=2)).critic()
    searched = critic.search()
    first = critic.plan(searched, None, 0)
    tried = first["set"].unique()
    made = simulate(extensions)(first)
    made.loc[made["set"] == tried[1], list(OUTPUTS)] = np.nan
    again = critic.plan(searched, made, 1)["set"].unique()
    assert tried[0] == again[0] and tried[1] not in again
    found = {s.members: s for s in critic._weighed(searched, made)[0]}
    assert [label(m) for m, s in found.items() if s.failed] == [tried[1]]


@pytest.mark.parametrize("simulated", [1, 2])
def test_a_rival_is_refuted_by_its_own_simulations(simulated):
    """Both emulators are off in the same way. With simulations of both the rival is 40 times less
    probable; what simulations change in the other cause says less of it."""
    true, settings = basal(), replace(SETTINGS, sets=simulated, rounds=1, largest_set=1)
    pattern_of_rival = true.pattern + pattern("radial", [3], 0.03)
    rival = Extension(Hypothesis("fibre_rotation", 0.0, 0.0, 2.0), pattern_of_rival)
    wrong = pattern("circumferential", range(7, 13), 0.03)
    known = [Extension(cause.hypothesis, cause.pattern + wrong) for cause in (true, rival)]
    given = inputs({"heart": with_effects((true, 1.0))}, known, (), settings)
    found = criticise(given, simulate([true, rival]))
    assert [s["confirmed"] for s in found["sets"]] == [True, simulated == 2]
    first, second = (s["log_evidence"] for s in found["sets"])
    assert (first - second > math.log(25)) == (simulated == 2)
    assert found["named"] == (["basal_motion"] if simulated == 2 else [])
    assert "basal_motion" in answered(found)
    share = found["confirmation"]["probability_not_simulated"]
    assert share == (found["sets"][1]["probability"] if simulated == 1 else 0)


def test_evidence_that_is_not_known_is_averaged_over():
    rng, sets = np.random.default_rng(1), []
    for name, evidence, sd in (("first", 1.0, 0.0), ("second", -5.0, 3.0)):
        change = torch.as_tensor(sd * rng.standard_normal(EVIDENCES)) if sd else None
        sets.append(CauseSet(((name, ""),), None, None, evidence, -1.0, uncertain=change))
    searched = SimpleNamespace(unlisted_approximated=-50.0, unlisted_prior=-50.0)
    found, *rest = Critic._probabilities(SimpleNamespace(), searched, sets)
    nodes, weights = np.polynomial.hermite_e.hermegauss(60)
    expected = weights @ (1 / (1 + np.exp(6 - 3 * nodes))) / weights.sum()
    assert found[1].names == ("second",) and max(rest) < 1e-9
    assert found[1].probability == pytest.approx(expected, abs=0.007)
    assert found[0].probability + found[1].probability == pytest.approx(1)


def test_differences_are_counted_in_noise_where_there_is_noise():
    """Twice the noise in a strain; a volume that is taken as exact, and a channel not observed."""
    model = SimpleNamespace(
        emulator=SimpleNamespace(
            correction=SimpleNamespace(value=torch.tensor([[0.02, 3.0, 9.0]]))
        ),
        observations=SimpleNamespace(present=torch.tensor([[True, True, False]])),
        noise_variance=lambda x: torch.tensor([[[1e-4, 0.0, 1.0]]]),
    )
    one = CauseSet((("cause", ""),), model, SimpleNamespace(x=None), 0.0, 0.0)
    assert one.difference_sds[0, 0] == pytest.approx(2.0)
    assert one.difference_sds[0, 1].isnan()
    assert one.difference_sd == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("probabilities", "p_values", "best", "tested"),
    [
        ((0.5, 0.3, 0.2), (0.003, 0.2, 0.5), 1, 2),  # the first that fits
        ((0.5, 0.3), (0.3, 0.9), 0, 1),
        ((0.5, 0.3, 0.2), (0.003, 0.01, 0.02), 0, 3),  # none fits
        ((0.9, 0.04), (0.003, 0.5), 0, 1),  # one that fits, but is refuted by the evidence
    ],
)
def test_the_best_set_is_one_that_fits(probabilities, p_values, best, tested):
    sets = [
        CauseSet((("cause", ""),), None, None, 0.0, 0.0, share, p)
        for share, p in zip(probabilities, p_values, strict=True)
    ]
    asked = []

    def misfit_of(sampled, name):
        asked.append(sampled)
        return Misfit(sampled, {}, [])

    assert Critic._best(SimpleNamespace(_misfit_of=misfit_of), sets) is sets[best]
    assert asked == list(p_values[:tested])


def test_sets_beyond_the_first_few_are_sampled_where_none_of_those_fits():
    sets = [CauseSet(((str(i), ""),), None, None, 0.0, 0.0, 0.2) for i in range(5)]
    for one in sets[:3]:
        one.sampled = 0.001
    critic = SimpleNamespace(
        _in_earnest=lambda model, fit, name: 0.5 if name == "4" else 0.002,
        _misfit_of=lambda sampled, name: Misfit(sampled, {}, []),
    )
    assert Critic._best(critic, sets) is sets[4]


def test_an_estimate_at_the_end_of_its_range_is_not_named():
    """The effect is twice what its range holds."""
    short = Extension(replace(basal().hypothesis, high=0.5), basal().pattern)
    found = findings(measured(ToyEmulator(), basal(), 1.0, seed=5), [bias(), short], noises=())
    assert "basal_motion" not in answered(found)
    assert found["acts_like"] == ["basal_motion"]
    assert not any("is present" in sentence for sentence in found["words"])
    (basal_motion,) = [h for h in found["hypotheses"] if h["name"] == "basal_motion"]
    assert basal_motion["at_bound"]


def test_outliers_of_single_channels_are_the_last_resort():
    table = measured(ToyEmulator(), seed=5)
    for output, sds in (("radial_03", 9), ("circumferential_12", -8), ("longitudinal_08", 10)):
        row = table["output"] == output
        table.loc[row, "value"] += sds * table.loc[row, "sd"]
    found = findings(table, [bias(), basal()])
    assert found["named"] == ["heavy_tails"]


def test_heavy_tails_are_named_only_if_they_are_certain():
    """One channel is off by a little more than noise is: the model as it is may be right."""
    table = measured(ToyEmulator(), seed=1)
    row = table["output"] == "circumferential_12"
    table.loc[row, "value"] += 5.5 * table.loc[row, "sd"]
    found = findings(table, [bias(), basal()])
    assert found["misfit"]["detected"] and found["named"] == [] and not found["explained"]
    (tails,) = [s for s in found["sets"] if s["causes"] == ["heavy_tails"]]
    assert 0.2 < tails["probability"] < 0.95 and 0.05 < found["base_probability"] < 0.8
    (row,) = [h for h in found["hypotheses"] if h["name"] == "heavy_tails"]
    assert row["probability"] == pytest.approx(tails["probability"])
    total = sum(s["probability"] for s in found["sets"]) + found["base_probability"]
    assert total + found["unlisted_probability"] == pytest.approx(1, abs=1e-6)


def lone_channels():
    """A cause that moves three channels far apart, and a heart with it."""
    outputs = {"radial_03": 0.09, "circumferential_12": -0.08, "longitudinal_08": 0.1}
    shape = torch.tensor([outputs.get(name, 0.0) for name in OUTPUTS], dtype=torch.float64)
    cause = Extension(Hypothesis("three_channels", 0.0, -3.0, 3.0), shape)
    return cause, measured(ToyEmulator(), cause, 1.0, seed=5)


@pytest.mark.parametrize("simulated", [True, False])
def test_heavy_tails_do_not_stand_in_for_a_better_set_that_was_not_confirmed(simulated):
    cause, table = lone_channels()
    extensions = [bias(), cause]
    given = inputs({"heart": table}, extensions, (TAILS,), SETTINGS)
    found = criticise(given, simulate(extensions) if simulated else None)
    assert found["named"] == (["three_channels"] if simulated else [])


@pytest.mark.parametrize("p_value", [0.001, 0.015])
def test_a_set_that_data_refute_says_nothing_of_what_is_named(monkeypatch, p_value):
    """Two effects; the set with one of them is forced to be the most probable one, and rejected:
    clearly, or at a level at which right ones are rejected now and then."""
    table = with_effects((basal(), 0.6), (bias(), 0.25))

    def probabilities(self, searched, sets, base=0.0):
        for one in sets:
            one.probability = {1: 0.55, 2: 0.45}.get(len(one.members), 0.0)
            one.probability *= "basal_motion" in one.names
        return sorted(sets, key=lambda s: -s.probability), 0.0, 0.0

    def misfit_of(self, sampled, name):
        p = p_value if len(sampled.model.emulator.extensions) == 1 else 0.5
        return Misfit(p, {"overall": p}, [])

    monkeypatch.setattr(Critic, "_probabilities", probabilities)
    monkeypatch.setattr(Critic, "_misfit_of", misfit_of)
    found = findings(table, [bias(), basal()], noises=())
    assert found["named"] == ["basal_motion"] and len(found["best"]) == 2
    (alone,) = [s for s in found["sets"] if s["causes"] == ["basal_motion"]]
    (pair,) = [s for s in found["sets"] if len(s["causes"]) == 2]
    (moved,) = [h for h in found["hypotheses"] if h["name"] == "basal_motion"]
    of_pair = dict(zip(pair["causes"], pair["fit"], strict=True))["basal_motion"]
    of_pair_alone = abs(moved["estimate"] - of_pair) < abs(of_pair - alone["fit"][0]) / 4
    assert of_pair_alone == (p_value == 0.001)
    assert any("also holds radial scale" in sentence for sentence in found["words"])


def test_a_misfit_of_one_level_is_no_outlier():
    """A pattern of basal segments that is not in the catalogue is not put down to the noise."""
    wave = pattern("radial", range(1, 7), 0.08) - pattern("longitudinal", range(1, 4), 0.06)
    cause = Extension(Hypothesis("unheard_of", 0.0, 0.0, 2.0), wave)
    found = findings(measured(ToyEmulator(), cause, 1.0, seed=5), [bias()])
    assert found["misfit"]["detected"] and "heavy_tails" not in answered(found)


@DEEP
def test_noise_that_is_inferred():
    few = replace(SETTINGS, bootstrap=79, draws=250, rounds=1, largest_set=2)
    table = measured(ToyEmulator(), bias(), 1.0, seed=5, known=False)
    found = findings(table, [bias(), basal()], settings=few)
    assert found["named"] == ["radial_scale"]
    assert "overall" not in found["misfit"]["families"]
    assert {row["quantity"] for row in found["noise"]} == {
        "circumferential",
        "radial",
        "longitudinal",
    }


def test_few_channels_say_what_they_cannot():
    table = measured(ToyEmulator())
    table = table[table["quantity"].isin(["volume", "circumferential"])]
    table = table[table["segment"].isna() | (table["segment"] <= 6)]
    found = findings(table, [bias(), basal()])
    assert answered(found) == set()
    assert any("no radial strain" in s for s in found["limits"])
    assert any("no more channels than parameters" in s for s in found["limits"])
    assert found["words"][0] == "There are too few channels to test the model."


def test_a_set_that_cannot_be_tested_names_nothing():
    """Eleven channels: ten parameters and one cause leave nothing to test the cause by."""
    shape = pattern("radial", [1, 7, 14], 0.1) + pattern("radial", [2, 8], -0.1)
    cause = Extension(Hypothesis("radial_scale", 0.0, -8.0, 8.0), shape)
    segments = 1, 2, 3, 4, 7, 8, 10, 12, 14, 17
    table = measured(ToyEmulator(), cause, 4.0, seed=5)
    table = table[table["output"].isin(["volume_ml", *(f"radial_{s:02d}" for s in segments)])]
    found = findings(table, [cause], noises=())
    assert found["misfit"]["detected"] and answered(found) == set()
    assert not found["explained"] and found["remaining"] is None
    assert any("too few channels to test the best set" in sentence for sentence in found["words"])


def test_a_smooth_departure_rivals_causes_where_noise_is_inferred():
    """Its evidence by sampling: Laplace's approximation has the noise at the end of its range."""
    table = with_effects((basal(), 0.5))
    wave = 0.05 * np.cos(np.arange(1, 18))
    for direction in ("circumferential", "longitudinal"):
        rows = table["quantity"] == direction
        table.loc[rows, "value"] += wave
    table["sd"] = table["sd"].where(table["quantity"] == "volume")
    critic = inputs({"heart": table}, [bias(), basal()], (), SETTINGS).critic()
    model = critic._model(())
    best = fit_from_nothing(model, 1)
    reference = float(log_evidence(model, best)[0])
    sampled, laplace = critic._unlisted(model, best, reference, True)
    assert sampled > laplace + 1.0
    assert critic._unlisted(model, best, reference, False) == (laplace, laplace)


def test_a_poor_posterior_does_not_change_the_evidence():
    def sampled(evidence, poor):
        return SimpleNamespace(posterior=SimpleNamespace(log_evidence=evidence, poor=poor))

    searched = SimpleNamespace(base_evidence=100.0)
    sets = [CauseSet(((str(i), ""),), None, None, 5.0, 0.0) for i in range(3)]
    sets[0].sampled, sets[1].sampled = sampled(107.0, False), sampled(180.0, True)
    base = _by_sampling(searched, sets, sampled(101.0, False))
    assert [s.log_evidence for s in sets] == [7.0, 7.0, 7.0] and base == 1.0
    assert _by_sampling(searched, sets[1:2], sampled(101.0, False)) is None


def test_a_subject_without_strains(tmp_path):
    table = measured(ToyEmulator(), seed=5).query("output == 'volume_ml'")
    found = findings(table)
    assert found["words"][0] == "There are too few channels to test the model."
    assert found["base_probability"] is None and answered(found) == set()
    write_findings(found, tmp_path / "findings.json")
    figure, page = tmp_path / "residuals.png", tmp_path / "report.html"
    write_report(tmp_path / "findings.json", page, figure, tmp_path / "residuals.csv")
    assert "too few channels" in page.read_text()
    assert pd.read_csv(tmp_path / "residuals.csv")["output"].tolist() == ["volume_ml"]


# -------------------------------------------------------------------------- several together


def test_evidence_of_two_hearts_is_by_one_method():
    """The base model has as many coordinates as are sampled at most, and every set has more."""
    tables = {name: measured(ToyEmulator(), seed=i) for i, name in enumerate("ab")}
    critic = inputs(tables, [bias(), basal()], [], SETTINGS).critic()
    base = critic._model(())
    best = fit_from_nothing(base, 1)
    assert len(base.low) == 20
    evidence = float(log_evidence(base, best)[0])
    assert critic._draws(base, best, 1).log_evidence == pytest.approx(evidence)
    sampled, laplace = critic._unlisted(base, best, evidence, True)
    assert sampled == pytest.approx(laplace)


def test_a_departure_that_all_hearts_share_is_not_put_down_to_a_cause():
    """A wave that resembles a cause, in every heart alike: a defect of the simulator. It is as
    large as the noise: as another departure in each heart it would be next to impossible."""
    emulator, rng = ToyEmulator(), np.random.default_rng(2)
    thetas = torch.as_tensor(rng.uniform(0.6, 1.6, (4, 10)))
    departure = 0.3 * basal().pattern.numpy() + 0.01 * np.sin(np.arange(52))
    tables = {}
    for i, theta in enumerate(thetas):
        table = measured(emulator, seed=i, theta=theta)
        tables[f"heart{i}"] = table.assign(value=table["value"] + departure)
    extensions = [bias(), basal()]
    found = criticise(inputs(tables, extensions, [], SETTINGS, thetas), simulate(extensions))
    assert found["misfit"]["detected"] and answered(found) == set()
    assert found["unlisted_probability"] > 0.95
    assert not any("smooth departure" in text for text in found["limits"])


def together(known: bool):
    emulator, rng = ToyEmulator(), np.random.default_rng(2)
    thetas = torch.as_tensor(rng.uniform(0.6, 1.6, (3, 10)))
    scaled = thetas.clone()
    if known:
        scaled[:, 0::2] *= 1.3
        scaled[:, 1::2] *= 0.8
    tables = {
        f"heart{i}": measured(emulator, basal(), 0.3, seed=i, theta=theta)
        for i, theta in enumerate(scaled)
    }
    given = inputs(tables, [bias(), basal()], [], SETTINGS, thetas if known else None)
    return criticise(given, simulate([bias(), basal()]))


def test_known_hearts_on_an_unknown_material():
    found = together(known=True)
    assert found["named"] == ["basal_motion"]
    factors = {row["parameter"]: row["after"] for row in found["theta"]}
    for name, truth in (("factor C_a", 1.3), ("factor C_b", 0.8)):
        mean, sd = factors[name]
        assert mean == pytest.approx(truth, abs=4 * sd)
    assert {c["subject"] for c in found["misfit"]["channels"]} == {"heart0", "heart1", "heart2"}


def test_hearts_of_unknown_theta_share_the_cause():
    found = together(known=False)
    assert found["named"] == ["basal_motion"]
    (basal_motion,) = [h for h in found["hypotheses"] if h["name"] == "basal_motion"]
    assert basal_motion["estimate"] == pytest.approx(0.3, abs=0.1)


def test_known_noise_and_unknown_do_not_mix():
    emulator = ToyEmulator()
    tables = {"a": measured(emulator), "b": measured(emulator, known=False)}
    with pytest.raises(InputError, match="criticise them separately"):
        observe(tables, emulator, 1.0)


def test_known_thetas_need_room_for_common_factors():
    emulator = ToyEmulator()
    theta = torch.ones(2, 10).double()
    theta[0], theta[1] = 0.11, 4.9
    tables = {"a": measured(emulator), "b": measured(emulator)}
    with pytest.raises(InputError, match="nearer to its middle"):
        inputs(tables, [], [], SETTINGS, theta).critic()
