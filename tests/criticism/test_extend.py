"""The study with the named causes switched on, and the comparison with the one before."""

import json

import numpy as np
import pandas as pd
import pytest

from regional_lv import config as study_config
from regional_lv.criticism.extend import compare_extended, write_extended
from regional_lv.errors import InputError
from regional_lv.measured import read_measured, write_measured
from regional_lv.mechanics.materials import material_from_config
from regional_lv.parameters import Parameterisation
from regional_lv.physics import physics_of
from tests.criticism.toy import ToyEmulator, measured

NAMED = {"septal_load": 3.0, "radial_scale": 1.2, "wall_thickness": 0.9, "mixed_frames": 0.25}


@pytest.fixture
def files(tmp_path):
    hypotheses = [
        {"name": name, "estimate": value, "component": ""} for name, value in NAMED.items()
    ]
    content = {"subject": "patient", "named": list(NAMED), "hypotheses": hypotheses}
    (tmp_path / "findings.json").write_text(json.dumps(content))
    write_measured(measured(ToyEmulator()), tmp_path / "measured.csv")
    return tmp_path


def extend(files, hypotheses="all"):
    base = study_config.load({"study": "mine", "criticism": {"hypotheses": hypotheses}})
    given = (files / "findings.json", [files / "measured.csv"], [], base, ["patient"])
    write_extended(*given, files / "extended.yaml", files / "extended")
    return base, study_config.load(files / "extended.yaml")


def test_the_extended_study_is_valid_and_has_the_causes(files):
    base, found = extend(files)
    assert found["study"] == "mine_extended"
    assert found["loading"]["septal_pressure_mmhg"] == 3.0
    assert found["observables"]["scale"] == {"radial": 1.2}
    assert found["geometry"]["wall_thickness_scale"] == pytest.approx(0.9)
    assert found["loading"]["frames"] == [0.75]
    assert found["criticism"]["extends"] == str(files / "findings.json")
    assert list(found["subjects"]) == ["patient"]
    # Nothing else of the simulator changes.
    before, after = physics_of(base), physics_of(found)
    assert {k for k in before if before[k] != after[k]} == {"loading", "observables", "geometry"}
    assert (files / "extended.yaml").read_text().startswith("# The study mine with what")


def test_what_became_part_of_the_model_is_not_asked_again(files):
    _, found = extend(files, ["septal_load", "mixed_frames", "basal_motion", "heavy_tails"])
    assert found["criticism"]["hypotheses"] == ["basal_motion", "heavy_tails"]


def test_strains_of_an_earlier_frame_say_so(files):
    extend(files)
    table = read_measured(files / "extended" / "patient.csv")
    volume = table["quantity"] == "volume"
    assert table.loc[volume, "load_fraction"].tolist() == [1.0]
    assert (table.loc[~volume, "load_fraction"] == 0.75).all()
    before = read_measured(files / "measured.csv")
    assert sorted(table["value"]) == sorted(before["value"])


def test_several_subjects_of_known_theta_go_on_together(files):
    """The common factors become part of the reference, the thetas go along."""
    base = study_config.load({"study": "mine"})
    content = json.loads((files / "findings.json").read_text()) | {"subject": "both"}
    content["theta"] = [
        {"parameter": "factor C_a", "before": [1.3, 0.1], "after": [1.25, 0.1]},
        {"parameter": "factor C_b", "before": [0.7, 0.1], "after": [0.8, 0.1]},
    ]
    (files / "findings.json").write_text(json.dumps(content))
    names = list(Parameterisation().names)
    thetas = pd.DataFrame(
        np.arange(1.0, 21).reshape(2, 10), index=pd.Index(["b", "a"], name="subject"), columns=names
    )
    thetas.to_csv(files / "known.csv")
    given = (files / "findings.json", [files / "measured.csv"] * 2, [files / "known.csv"], base)
    write_extended(*given, ["a", "b"], files / "extended.yaml", files / "extended")
    found = study_config.load(files / "extended.yaml")
    assert list(found["subjects"]) == ["a", "b"]
    joint = found["criticism"]["joint"]["both"]
    assert joint["subjects"] == ["a", "b"]
    written = pd.read_csv(joint["theta"], index_col="subject")
    assert written.loc["a", names].tolist() == thetas.loc["a"].tolist()
    own, changed = (material_from_config(c["material"]).references for c in (base, found))
    assert changed == pytest.approx({"C_a": 1.25 * own["C_a"], "C_b": 0.8 * own["C_b"]})


def test_without_a_named_cause_there_is_nothing_to_extend(files):
    (files / "findings.json").write_text(json.dumps({"named": [], "hypotheses": []}))
    with pytest.raises(InputError, match="no cause is named"):
        extend(files)


def test_a_model_of_the_noise_extends_no_simulator(files):
    row = {"name": "heavy_tails", "estimate": 0.2, "component": ""}
    content = {"named": ["heavy_tails"], "hypotheses": [row]}
    (files / "findings.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="heavy_tails is about the noise"):
        extend(files)


def test_before_and_after_stand_side_by_side(tmp_path):
    for name, p, error in (("before", 0.001, 0.03), ("after", 0.4, 0.01)):
        content = {
            "misfit": {"p_value": p},
            "named": ["septal_load"] if name == "before" else [],
            "gain": {"rmse_before": error, "rmse_volume_ml_before": 2.0}
            | {"coverage_before": 0.9, "elpd_before": 100.0},
            "noise": [{"quantity": "radial", "before": 0.4}],
            "theta": [{"parameter": "C_a_septal", "before": [1.2, 0.1]}],
        }
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    files = (tmp_path / "before.json", tmp_path / "after.json", tmp_path / "table.csv")
    compare_extended("patient", *files)
    table = pd.read_csv(files[2]).set_index("what")
    assert table.loc["error of the strains", ["before", "after"]].astype(float).tolist() == [
        0.03,
        0.01,
    ]
    assert table.loc["named", "before"] == "septal_load"
    assert float(table.loc["C_a_septal sd", "after"]) == 0.1
    assert (table["subject"] == "patient").all()
