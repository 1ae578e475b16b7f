"""The whole way on a coarse heart: hide effects with the simulator, find them through the rules.

On the heart of the small study and with its emulator (`tests/small.py`). Four subjects: a pair of
causes, a single one, none, and one whose cause is not suspected.
"""

import json

import numpy as np
import pandas as pd
import pytest

from regional_lv.inference.posteriors import load
from regional_lv.session import Study
from tests.small import edit_config
from tests.workflow.project import run

THETA = {
    **{"C_a_anterior": 1.0, "C_b_anterior": 1.0, "C_a_inferior": 1.1, "C_b_inferior": 0.9},
    **{"C_a_lateral": 1.4, "C_b_lateral": 1.2, "C_a_septal": 0.9, "C_b_septal": 1.1},
    **{"C_a_apical": 1.0, "C_b_apical": 1.0},
}
NOISE = {"strain": 0.01, "volume": 1.0}
BASE = {"basal_motion": 0.0, "fibre_rotation": 0.0, "septal_load": 0.0}
PAIR, SINGLE = {"basal_motion": 6.0, "fibre_rotation": -11.0}, {"septal_load": 4.0}
SUBJECTS = {
    "moving_base": {"effects": PAIR, "seed": 11},
    "septum": {"effects": SINGLE, "seed": 13},
    "healthy": {"seed": 12},
    "scarred": {"effects": {"focal_scar_8": 4.0}, "seed": 13},
}


def hide(config: dict) -> None:
    """Make the small study one of these subjects, without the paper's part of it."""
    config["evaluation"] = False
    config["emulators"] |= {"names": ["gradient_gp"], "final": "gradient_gp"}
    config["criticism"] = {
        **{"bootstrap": 199, "largest_set": 3},
        "confirmation": {"sets": 3, "simulations": 6, "rounds": 1},
    }
    config["subjects"] = {name: {"source": "synthetic"} for name in SUBJECTS}
    same = {"theta": THETA, "noise": NOISE, "mesh": "study"}
    config["synthetic_subjects"] = {name: same | own for name, own in SUBJECTS.items()}


@pytest.fixture(scope="module")
def project(small_study, tmp_path_factory):
    copy = small_study.copy(tmp_path_factory.mktemp("hidden") / "project").project
    edit_config(copy, hide)
    run(copy, "--cores", "2", "pages")
    return copy


@pytest.fixture(scope="module")
def results(project):
    return project / "results" / "smoke"


def findings(results, subject):
    return json.loads((results / "criticism" / subject / "findings.json").read_text())


def answered(found) -> set[str]:
    return {*found["named"], *(name for group in found["groups"] for name in group)}


@pytest.mark.parametrize(("subject", "effects"), [("moving_base", PAIR), ("septum", SINGLE)])
def test_hidden_effects_are_found_through_the_rules(results, subject, effects):
    """They are in the answer, intervals exclude the nominal value and hold the truth, and the gain
    is there, confirmed by simulations."""
    found = findings(results, subject)
    assert found["explained"] and found["trusted"] and set(effects) <= answered(found)
    # In a group, one of the others may be what is at work; named, all are.
    assert set(found["named"]) <= set(effects)
    by_name = {h["name"]: h for h in found["hypotheses"]}
    for name, truth in effects.items():
        low, high = by_name[name]["interval95"]
        assert low < truth < high
        assert not low < BASE[name] < high
    (best,) = [s for s in found["sets"] if s["causes"] == found["best"]]
    assert best["confirmed"] and best["misfit_p_value"] > 0.02 * len(effects)
    assert found["confirmation"]["agrees"] and found["confirmation"]["simulations"] >= 6
    assert found["gain"]["elpd"] > 2 * found["gain"]["elpd_se"] > 0
    assert found["gain"]["rmse_after"] < found["gain"]["rmse_before"]


def covered(results, which: str, subjects) -> list[bool]:
    """Whether 95 % intervals of the stiffness hold the truth."""
    return [
        row[which]["interval95"][0] < THETA[row["name"]] < row[which]["interval95"][1]
        for subject in subjects
        for row in findings(results, subject)["stiffness"]
    ]


def test_stiffness_survives_the_criticism(results):
    """Averaged over models, three of thirty may be missed; the model as it is misses many more."""
    assert sum(covered(results, "averaged", ["moving_base", "septum", "healthy"])) >= 27
    assert sum(covered(results, "as_it_is", ["moving_base", "septum"])) <= 15


def test_files_say_what_the_findings_do(results):
    found = findings(results, "septum")
    data = load(results / "criticism" / "septum" / "posterior.nc")
    for row in found["stiffness"]:
        draws = data.posterior["value"].sel(input=row["name"]).to_numpy()
        assert abs(draws.mean() - row["averaged"]["mean"]) < 0.2 * row["averaged"]["sd"]
        assert sum(row["sources"].values()) == pytest.approx(1.0)
    assert "as_it_is" in data.children
    replicated = data.posterior_predictive["y"].to_numpy()[0]
    low, high = np.quantile(replicated, [0.005, 0.995], axis=0)
    observed = data.observed_data["y"].to_numpy()
    assert ((observed > low) & (observed < high)).mean() > 0.9


@pytest.mark.test_all("a simulation that is made by the rules in other tests")
def test_a_session_simulates_the_same_subject(project, results, tmp_path, monkeypatch):
    monkeypatch.chdir(project)
    study = Study("config/smoke.yaml", tmp_path)
    study.make_heart()
    measured = study.measure("moving_base")
    by_rules = pd.read_csv(results / "measured" / "moving_base.csv", comment="#")
    pd.testing.assert_frame_equal(pd.read_csv(measured, comment="#"), by_rules, rtol=1e-9)


def test_pressure_is_never_found(results):
    found = findings(results, "septum")
    (pressure,) = [h for h in found["hypotheses"] if h["name"] == "end_diastolic_pressure"]
    assert not pressure["identifiable"] and pressure["probability"] == 0
    assert "C_a of all zones together" in pressure["why"]


def test_nothing_is_found_in_the_heart_without_effects(results):
    found = findings(results, "healthy")
    assert answered(found) == set() and not found["misfit"]["detected"]


def test_what_is_not_suspected_is_not_explained_away(results):
    found = findings(results, "scarred")
    assert found["misfit"]["detected"]
    assert found["named"] == []


def test_pages_are_there(results):
    for subject in SUBJECTS:
        page = (results / "pages" / f"{subject}.html").read_text()
        assert "data:image/png;base64," in page
