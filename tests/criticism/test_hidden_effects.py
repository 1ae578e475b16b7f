"""The whole way on a coarse heart: hide effects with the simulator on a finer mesh, find them.

On the simulations of the small study (`tests/small.py`). Four hearts go through the rules: a pair
of causes, a single one, none, and one that is not in the catalogue; others, with more causes in the
catalogue, through the same functions.
"""

import gc
import json

import numpy as np
import pandas as pd
import pytest
from regional_lv.criticism.extension import read_extensions

from regional_lv import config as study_config
from regional_lv import emulators
from regional_lv.criticism.injection import Ventricles, read_effects, simulate_design, unit_noise
from regional_lv.criticism.study import Inputs, criticise, split
from regional_lv.criticism.verdict import Settings
from regional_lv.measured import synthetic_subject
from regional_lv.physics import physics_of
from regional_lv.study import Study
from tests.small import edit_config
from tests.workflow.project import run

THETA = {
    **{"C_a_anterior": 1.0, "C_b_anterior": 1.0, "C_a_inferior": 1.1, "C_b_inferior": 0.9},
    **{"C_a_lateral": 1.4, "C_b_lateral": 1.2, "C_a_septal": 0.9, "C_b_septal": 1.1},
    **{"C_a_apical": 1.0, "C_b_apical": 1.0},
}
NOISE = {"strain": 0.01, "volume": 1.0}
BASE = {"basal_motion": 0.0, "fibre_rotation": 0.0, "septal_load": 0.0, "epicardial_support": 0.0}
BASE |= {"anisotropy": 1.0, "wall_thickness": 1.0, "mixed_frames": 0.0}
HEARTS = {
    "moving_base": {"basal_motion": 6.0, "fibre_rotation": -11.0},
    "supported": {"epicardial_support": 0.06, "anisotropy": 0.4},
    "septum": {"septal_load": 4.0},
    "thin": {"wall_thickness": 0.77},
}
"""Pairs and single effects; of each pair the first version named one, or heavy tails."""

SCAR = {"focal_scar": {"segment": 8, "multiplier": 4.0}}
"""What the catalogue of this study does not have."""

CRITICISM = {
    "hypotheses": [
        *("end_diastolic_pressure", "fibre_rotation", "basal_motion", "septal_load"),
        *("radial_scale", "mixed_frames", "heavy_tails"),
    ],
    "bootstrap": 199,
    "draws": 800,
    "largest_set": 3,
    "confirmation": {"sets": 3, "simulations": 6, "rounds": 1},
}

MORE_CAUSES = ["anisotropy", "wall_thickness", "epicardial_support", "strain_measure"]

SUBJECTS = {
    "moving_base": {"effects": HEARTS["moving_base"], "seed": 11},
    "septum": {"effects": HEARTS["septum"], "seed": 13},
    "healthy": {"seed": 12},
    "scarred": {"effects": SCAR, "seed": 13},
}


def hide(config: dict) -> None:
    """Make the small study one of these subjects."""
    config["emulators"] |= {"names": ["gradient_gp"], "final": "gradient_gp"}
    config["criticism"] = CRITICISM
    config["subjects"] = {name: {"source": "synthetic"} for name in SUBJECTS}
    same = {"theta": THETA, "noise": NOISE, "mesh": "finer"}
    config["synthetic_subjects"] = {name: same | own for name, own in SUBJECTS.items()}


@pytest.fixture(scope="module")
def project(small_study, tmp_path_factory):
    copy = small_study.copy(tmp_path_factory.mktemp("hidden") / "project").project
    edit_config(copy, hide)
    run(copy, "--cores", "2", "criticism")
    return copy


@pytest.fixture(scope="module")
def results(project):
    return project / "results" / "smoke"


@pytest.fixture(scope="module")
def physics(project):
    return physics_of(study_config.load(project / "config" / "smoke.yaml"))


@pytest.fixture(scope="module")
def plant(results, physics):
    """Measured table of a heart with effects, on the finer mesh."""
    ventricles = Ventricles(results / "geometry" / "finer" / "mesh.vtu", physics)
    theta, simulated = np.array([*THETA.values()]), {}

    def planted(effects, seed=13, noise=NOISE):
        hidden, key = read_effects(effects), json.dumps(effects)
        if key not in simulated:
            simulated[key] = ventricles.outputs(theta, hidden)
        outputs = simulated[key]
        unit = unit_noise(hidden, len(outputs), np.random.default_rng(seed))
        return synthetic_subject(outputs, ventricles.channels, noise, unit)

    return planted


@pytest.fixture(scope="module")
def examine(project, results, physics):
    """The findings of a measured table, with more causes, in a catalogue that may lack some."""
    edit_config(project, lambda config: config["criticism"]["hypotheses"].extend(MORE_CAUSES))
    run(project, "--cores", "2", "extensions")
    files = sorted((results / "criticism" / "extensions").glob("*.pt"))
    emulator = emulators.load(results / "emulators" / "gradient_gp.pt")
    shorter = {"level": 0.05, "load_fractions": [], "bootstrap": 119}
    settings = Settings.from_config(CRITICISM | shorter)
    mesh, predictor = results / "geometry" / "mesh.vtu", results / "mechanics" / "predictor.npz"
    ventricles = Ventricles(mesh, physics, predictor)
    gc.freeze()  # as a job does

    def simulate(design):
        return simulate_design(design, ventricles, physics, emulator.parameters.names)

    def examined(table, without=()):
        extensions, noises = split(read_extensions([f for f in files if f.stem not in without]))
        inputs = Inputs(
            *("heart", {"heart": table}, emulator, extensions, noises, settings, 2.0, 1.0, 11)
        )
        return criticise(inputs, simulate)

    return examined


def findings(results, subject):
    return json.loads((results / "criticism" / subject / "findings.json").read_text())


def answered(found) -> set[str]:
    return {*found["named"], *(name for group in found["groups"] for name in group)}


def check(found, effects):
    """The planted causes are in the answer, the intervals exclude the base and hold the truth, and
    the gain is there and confirmed by simulations."""
    assert found["explained"] and set(effects) <= answered(found)
    # In a group, one of the others may be what is at work; named, all are.
    assert set(found["named"]) <= set(effects)
    by_name = {h["name"]: h for h in found["hypotheses"]}
    for name, truth in effects.items():
        low, high = by_name[name]["interval95"]
        assert low < truth < high
        assert not low < BASE[name] < high
    best = found["sets"][0]
    assert best["confirmed"] and best["misfit_p_value"] > 0.02 * len(effects)
    assert found["confirmation"]["simulations"] >= 6
    assert found["gain"]["elpd"] > 2 * found["gain"]["elpd_se"] > 0
    assert found["gain"]["rmse_after"] < found["gain"]["rmse_before"]


@pytest.mark.parametrize("subject", ["moving_base", "septum"])
def test_hidden_effects_are_found_through_the_rules(results, subject):
    check(findings(results, subject), HEARTS[subject])


@pytest.mark.test_all("a mesh and a simulation, both made by the rules in other tests")
def test_a_session_simulates_the_same_subject(project, results, tmp_path, monkeypatch):
    """`Study.measure` makes the finer mesh as the rules do."""
    monkeypatch.chdir(project)
    measured = Study("config/smoke.yaml", tmp_path).measure("moving_base")
    by_rules = pd.read_csv(results / "measured" / "moving_base.csv", comment="#")
    pd.testing.assert_frame_equal(pd.read_csv(measured, comment="#"), by_rules, rtol=1e-9)


def test_pressure_is_never_found(results):
    found = findings(results, "moving_base")
    (pressure,) = [h for h in found["hypotheses"] if h["name"] == "end_diastolic_pressure"]
    assert not pressure["identifiable"]
    assert "C_a of all zones together" in pressure["why"]


def test_nothing_is_found_in_the_heart_without_effects(results):
    found = findings(results, "healthy")
    assert answered(found) == set() and not found["misfit"]["detected"]


def test_what_is_not_in_the_catalogue_is_not_explained_away(results):
    found = findings(results, "scarred")
    assert found["misfit"]["detected"]
    assert found["named"] == []
    assert any("No listed cause explains the misfit" in s for s in found["words"])


def test_pages_are_there(results):
    for subject in SUBJECTS:
        page = (results / "criticism" / subject / "report.html").read_text()
        assert "data:image/png;base64," in page


MORE = pytest.mark.test_all("more of what goes through the rules; half a minute each")


@MORE
@pytest.mark.parametrize(
    ("heart", "share"),
    [("supported", 1.0), ("thin", 0.5)],  # theta imitates most of a thinner wall
)
def test_planted_effects_are_found(plant, examine, heart, share):
    noise = {name: share * sd for name, sd in NOISE.items()}
    check(examine(plant(HEARTS[heart], noise=noise)), HEARTS[heart])


@MORE
def test_a_removed_effect_is_not_found(plant, examine):
    """The same noise without one of two effects."""
    found = examine(plant({"basal_motion": 6.0}, seed=11))
    assert "basal_motion" in answered(found) and "fibre_rotation" not in found["named"]


@MORE
def test_without_the_cause_in_the_catalogue(plant, examine):
    found = examine(plant(HEARTS["septum"]), without=["septal_load"])
    assert found["misfit"]["detected"]
    assert found["named"] == []


@MORE
def test_shuffled_channels_are_not_explained(plant, examine):
    table, rng = plant(HEARTS["septum"]), np.random.default_rng(0)
    for _, rows in table.groupby("quantity"):
        table.loc[rows.index, "value"] = rng.permutation(rows["value"].to_numpy())
    found = examine(table)
    assert answered(found) == set()
    assert any("No listed cause explains the misfit" in s for s in found["words"])
