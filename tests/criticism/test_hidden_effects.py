"""The whole way on a coarse heart: inject an effect with the simulator, hide it, find it.

One small study is made by the workflow; what is asked of it then costs seconds each.
"""

import json

import numpy as np
import pytest
import yaml

from regional_lv import emulators
from regional_lv.criticism.extension import read_extensions
from regional_lv.criticism.study import criticise_tables, split
from regional_lv.criticism.verdict import Settings
from regional_lv.measured import read_measured
from tests.workflow.test_workflow import copy_project, run

THETA = {
    **{"C_a_anterior": 1.0, "C_b_anterior": 1.0, "C_a_inferior": 1.1, "C_b_inferior": 0.9},
    **{"C_a_lateral": 1.4, "C_b_lateral": 1.2, "C_a_septal": 0.9, "C_b_septal": 1.1},
    **{"C_a_apical": 1.0, "C_b_apical": 1.0},
}
NOISE = {"strain": 0.01, "volume": 1.0}
INJECTED = {"mixed_frames": 0.35}
STUDY = {
    "study": "smoke",
    "mesh": {"circumferential": 16, "basal": 1, "mid": 1, "transmural": 1},
    "design": {"natural": 32, "log": 32, "test": 4, "lower": 0.4, "upper": 3.0},
    "simulations": {"batch_size": 32, "anchors": 16},
    "emulators": {"names": ["gradient_gp"], "final": "gradient_gp"},
    "criticism": {
        "hypotheses": [
            *("end_diastolic_pressure", "radial_scale", "mixed_frames"),
            *("segment_rotation", "heavy_tails"),
        ],
        "bootstrap": 199,
        "draws": 800,
    },
    "subjects": {"injected": {"source": "synthetic"}, "healthy": {"source": "synthetic"}},
    "synthetic_subjects": {
        "injected": {"theta": THETA, "effects": INJECTED, "noise": NOISE},
        "healthy": {"theta": THETA, "noise": NOISE},
    },
}


@pytest.fixture(scope="module")
def results(root, tmp_path_factory):
    project = copy_project(root, tmp_path_factory.mktemp("hidden") / "project")
    (project / "config" / "smoke.yaml").write_text(yaml.safe_dump(STUDY))
    run(project, "--cores", "2", "criticism")
    return project / "results" / "smoke"


def findings(results, subject):
    return json.loads((results / "criticism" / subject / "findings.json").read_text())


def answered(found) -> set[str]:
    return {found["named_cause"], *found["indistinguishable"]} - {None}


def criticise_again(results, table, without=()):
    """What the criticism says of other data, or with a shorter catalogue."""
    files = sorted((results / "criticism" / "extensions").glob("*.pt"))
    extensions, noises = split(read_extensions([f for f in files if f.stem not in without]))
    emulator = emulators.load(results / "emulators" / "gradient_gp.pt")
    settings = Settings(199, 0.05, 0.1, 1, 800, 3)
    tables = {"injected": table}
    return criticise_tables(
        "injected", tables, emulator, extensions, noises, settings, 1.0, seed=11
    )[0]


def test_the_injected_effect_is_found(results):
    found = findings(results, "injected")
    assert "mixed_frames" in answered(found) and len(answered(found)) <= 2
    (frames,) = [h for h in found["hypotheses"] if h["name"] == "mixed_frames"]
    low, high = frames["interval95"]
    assert low < 0.35 < high
    (pressure,) = [h for h in found["hypotheses"] if h["name"] == "end_diastolic_pressure"]
    assert not pressure["identifiable"]
    assert "C_a of all zones together" in pressure["why"]


def test_nothing_is_found_in_the_heart_without_it(results):
    assert answered(findings(results, "healthy")) == set()


def test_pages_are_there(results):
    for subject in ("injected", "healthy"):
        page = (results / "criticism" / subject / "report.html").read_text()
        assert "data:image/png;base64," in page


def test_shuffled_channels_are_not_explained(results):
    table, rng = read_measured(results / "measured" / "injected.csv"), np.random.default_rng(0)
    for _, rows in table.groupby("quantity"):
        table.loc[rows.index, "value"] = rng.permutation(rows["value"].to_numpy())
    found = criticise_again(results, table, without=["heavy_tails"])
    assert "mixed_frames" not in answered(found)
    assert any("No listed cause explains the misfit" in s for s in found["words"])


def test_without_the_cause_in_the_catalogue(results):
    table = read_measured(results / "measured" / "injected.csv")
    found = criticise_again(results, table, without=["mixed_frames", "heavy_tails"])
    assert found["misfit"]["detected"]
    assert any("No listed cause explains the misfit" in s for s in found["words"])
