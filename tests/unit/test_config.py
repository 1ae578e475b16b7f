"""Configurations: what is read, what is filled in, and what plugins add."""

import copy
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from regional_lv import config
from regional_lv.config.docs import MARK, describe, document
from regional_lv.config.study import Configuration
from regional_lv.data import segment_table
from regional_lv.errors import InputError
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.registry import load_plugins, temporary
from tests.unit.configurations import changed

ROOT = Path(__file__).resolve().parents[2]
PARAMETERS = StiffnessInputs()
STUDIES = ("config", "paper_1500", "study", "quick", "hidden_effects", "smoke")


@pytest.fixture(autouse=True)
def from_project_root(monkeypatch):
    """Paths in a configuration count from where one starts."""
    monkeypatch.chdir(ROOT)


@pytest.mark.parametrize("name", STUDIES)
def test_studies_of_the_project_are_valid(name):
    loaded = config.load(f"config/{name}.yaml")
    assert set(loaded) == set(Configuration.model_fields)
    assert "synthetic_lateral" in loaded["subjects"]


def test_the_papers_study_is_the_default():
    paper = config.load("config/config.yaml")
    own = ("study", "subjects", "synthetic_subjects")
    defaults = config.load({"study": "x"})
    assert {k: v for k, v in paper.items() if k not in own} == {
        k: v for k, v in defaults.items() if k not in own
    }
    assert paper["design"]["natural"] + paper["design"]["log"] == 5661


@pytest.mark.parametrize("name", STUDIES[1:])
def test_a_study_means_the_same_on_top_of_the_papers(name):
    """Snakemake merges a second configuration file into the first."""
    merged = yaml.safe_load(Path("config/config.yaml").read_text())
    for section, value in yaml.safe_load(Path(f"config/{name}.yaml").read_text()).items():
        if isinstance(value, dict):
            merged.setdefault(section, {}).update(value)
        else:
            merged[section] = value
    assert config.load(merged) == config.load(f"config/{name}.yaml")


def test_subjects_of_ones_own_replace_those_of_the_quick_study():
    quick = yaml.safe_load(Path("config/quick.yaml").read_text())
    own = {"subjects": {"anna": {"source": "published_simulation", "row": 3}}}
    synthetic = {"synthetic_lateral", "synthetic_hidden", "synthetic_misread"}
    assert set(config.load(quick)["subjects"]) == synthetic
    assert set(config.load(quick | own)["subjects"]) == {"anna"}


ROW = {"subjects": {"row": {"source": "published_simulation", "row": 3}}}


@pytest.mark.parametrize(
    "model",
    [
        {"parameters": {"zones": "whole"}},
        {"parameters": {"factors": ["C_a"]}},
        {"parameters": {"bounds": {"C_a": [0.1, 1.8]}}},
        {"material": {"law": "guccione"}},
    ],
)
def test_a_heart_of_another_model_needs_no_ventricles_of_others(model, tmp_path):
    """Neither default ones, nor those of the study that it goes on top of; its own are checked."""
    loaded = config.load({"study": "mine"} | model | ROW)
    assert loaded["synthetic_subjects"] == {}
    mine = tmp_path / "mine.yaml"
    mine.write_text(yaml.safe_dump(model | ROW))
    loaded = config.load(config.gather(["config/quick.yaml", mine], {}))
    assert set(loaded["subjects"]) == {"row"} and loaded["synthetic_subjects"] == {}
    own = {"synthetic_subjects": {"anna": {"theta": {"C_a_whole": 9.0}}}}
    mine.write_text(yaml.safe_dump(model | ROW | own))
    with pytest.raises(InputError, match=r"synthetic_subjects\.anna\.theta"):
        config.load(config.gather(["config/quick.yaml", mine], {}))


def test_default_scenarios_and_subjects_outside_the_bounds_are_left_out():
    loaded = config.load(changed("design.upper", 1.8))
    assert set(loaded["scenarios"]["sets"]) == {"local_1_5", "global_1_7"}
    assert set(loaded["subjects"]) == set(loaded["synthetic_subjects"]) | {"volunteer"}
    assert "synthetic_lateral" not in loaded["subjects"]
    given = changed("scenarios.sets", {"mild": {"kind": "local", "mu": 7.0}})
    with pytest.raises(InputError, match=r"mild\.mu: 7 lies outside"):
        config.load(given)
    emulator = {"evaluation": False, "emulators": {"final": "gradient_gp"}}
    assert "mild" in config.load(given | emulator)["scenarios"]["sets"]


def test_an_incomplete_geometry_is_reported_alone():
    """Before effects of synthetic subjects, which are judged on the heart, are looked at."""
    given = {"study": "mine", "inputs": {"segment_thickness": {"role": "measured", "sd_mm": 1.0}}}
    for geometry, key in (("surfaces", r"surfaces\.endocardium"), ("mesh", r"imported\.file")):
        with pytest.raises(InputError, match=rf"geometry\.{key}: missing"):
            config.load(given | {"geometry": {"source": geometry}})


@pytest.mark.parametrize("evaluation", [True, False])
@pytest.mark.parametrize("names", [[], ["anna"], ["anna", "synthetic_hidden"]])
def test_synthetic_subjects_of_ones_own_need_no_default_ones(names, evaluation):
    theta = dict.fromkeys(PARAMETERS.names, 1.5)
    own = {"synthetic_subjects": {name: {"theta": theta} for name in names}}
    given = {"study": "mine", "evaluation": evaluation, "emulators": {"final": "gradient_gp"}}
    loaded = config.load(given | own)
    assert list(loaded["subjects"]) == [*names, *["volunteer"] * evaluation]
    assert list(loaded["synthetic_subjects"]) == names
    assert all(loaded["synthetic_subjects"][name]["theta"] == theta for name in names)
    assert config.load(loaded) == loaded
    # Subjects that are named are those, and one that has no entry is missed.
    with pytest.raises(InputError, match=r"subjects\.bert: synthetic_subjects has no entry bert"):
        config.load(given | own | {"subjects": {"bert": {"source": "synthetic"}}})


def test_loading_leaves_its_input_alone_and_repeats():
    given = {"study": "mine", "design": {"natural": 8}}
    before = copy.deepcopy(given)
    loaded = config.load(given)
    assert given == before
    assert config.load(loaded) == loaded
    loaded["design"]["natural"] = 9
    assert config.load(given)["design"]["natural"] == 8


def test_numbers_take_the_type_of_their_key():
    whole, decimal = (
        config.load(changed("design.upper", 4)),
        config.load(changed("nuts.draws", 800.0)),
    )
    assert isinstance(whole["design"]["upper"], float)
    assert isinstance(decimal["nuts"]["draws"], int)


def test_default_subject_has_the_papers_parameters():
    theta = config.load({"study": "mine"})["synthetic_subjects"]["synthetic_lateral"]["theta"]
    assert tuple(theta) == PARAMETERS.names and theta["C_a_lateral"] == 2.0


def test_default_subject_is_carried_over_to_other_zones_and_factors():
    def theta(**model):
        loaded = config.load({"study": "mine", **model})
        assert config.load(loaded) == loaded
        return loaded["synthetic_subjects"]["synthetic_lateral"]["theta"]

    segments = theta(parameters={"zones": "segments"})
    assert len(segments) == 34
    assert segments["C_a_segment_05"] == 2.0 and segments["C_b_segment_08"] == 1.1
    assert theta(parameters={"zones": "whole"})["C_a_whole"] == pytest.approx(20.8 / 17)
    other = theta(material={"law": "guccione"})
    assert other["C_c_lateral"] == 2.0 and other["C_b_lateral"] == 1.5
    assert tuple(theta(parameters={"factors": ["C_b"]})) == PARAMETERS.names[1::2]


def test_readme_explains_every_key_with_its_default():
    text = Path("config/README.md").read_text()
    assert text.endswith(f"{MARK}\n{document()}"), "run `make format`"
    rows = dict(re.findall(r"^\| `([^`]+)` \|[^|]*\| ([^|]+) \|", text, flags=re.MULTILINE))
    assert set(rows) == {key.path for key in describe()}
    for path, value in leaves(config.load({"study": "mine"})):
        if rows.get(path, "required") != "required":
            assert yaml.safe_load(rows[path].strip("`")) == value, path


def leaves(section: dict, path: str = ""):
    for key, value in section.items():
        inner = f"{path}.{key}".lstrip(".")
        if isinstance(value, dict):
            yield from leaves(value, inner)
        else:
            yield inner, value


def test_all_mistakes_are_reported_at_once():
    given = {"study": "mine", "nuts": {"chain": 2}, "mesh": {"basal": 0}}
    with pytest.raises(InputError) as error:
        config.load(given)
    assert len(str(error.value).splitlines()) == 2


def test_supports_are_held_free_or_compliant():
    base = config.load({"study": "mine"})["supports"]["base"]
    assert base == {"radial": "held", "axial": "held", "circumferential": "free"}
    sprung = {"base": {"radial": "free", "axial": "free"}, "epicardium_kpa_per_mm": 1}
    loaded = config.load({"study": "mine", "supports": sprung})
    assert loaded["supports"]["base"]["axial"] == "free"
    loaded = config.load(changed("supports.base.axial", 2))
    assert isinstance(loaded["supports"]["base"]["axial"], float)


# ------------------------------------------------------------------------------------- plugins

PLUGIN = """
from regional_lv.emulators import REGISTRY as EMULATORS
from regional_lv.inputs.catalogue import INPUTS
from regional_lv.mechanics.loads import LOADS, Load
from regional_lv.mechanics.materials import MATERIALS, Constant, Factor, Material
from regional_lv.mechanics.supports import SUPPORTS, Support
from regional_lv.quantities import QUANTITIES, Quantity


@QUANTITIES.add
class Sphericity(Quantity):
    name, limits, noise = "sphericity", (0.0, 1.0), "ratio"

    def values(self, motion, places):
        return motion.cavity_volume_ml[None]


@MATERIALS.add
class Rubber(Material):
    name, source = "rubber", "a test"
    factors = (Factor("mu", "all of it", scales_stress=True),)
    constants = (Constant("mu_kpa", 2.0, "kPa", "mu", "shear modulus"),)

    def energy(self, F, fibre, sheet, constants):
        import ufl

        return constants["mu_kpa"] / 2 * (ufl.inner(F, F) - 3)


@SUPPORTS.add
class Tether(Support):
    name = "tether_kpa_per_mm"
    springs = {"tether": 1.0}
    holds_axially = True

    def energy(self, surroundings, stiffness):
        return 0


@LOADS.add
class Weight(Load):
    name = "weight_mmhg"

    def potential(self, surroundings, size):
        return 0


class Mean(EMULATORS["exact_gp"]):
    name, defaults = "mean", {"depth": 2}


EMULATORS.add(Mean)


@INPUTS.add
class Swelling(INPUTS["wall_thickness"]):
    name = "swelling"


"""


def test_what_a_plugin_adds_can_be_used_like_the_packages_own(tmp_path):
    # The registries of the process that runs the tests stay as they are.
    (tmp_path / "mine.py").write_text(PLUGIN)
    study = {
        "study": "mine",
        "plugins": [str(tmp_path / "mine.py")],
        "material": {"law": "rubber", "constants": {"mu_kpa": 3}},
        "loading": {"weight_mmhg": 0.5},
        "supports": {"base": {"axial": "free"}, "tether_kpa_per_mm": 0.1},
        "observables": {"quantities": ["volume", "radial", "sphericity"]},
        "emulators": {"names": ["exact_gp", "mean"], "mean": {"depth": 3}},
        "scenarios": {"noise": {"sphericity": 0.1}},
        "synthetic_subjects": {
            "anna": {
                "theta": {f"mu_{zone}": 1 for zone in PARAMETERS.zones},
                "noise": {"ratio": 0.05},
                "effects": {"swelling": 1.1},
            }
        },
        "subjects": {"anna": {"source": "synthetic"}},
        "inputs": {"swelling": "suspected"},
        "criticism": {
            "benchmark": {"noise": {"ratio": 0.05}},
        },
    }
    code = (
        "import json, sys\n"
        "from regional_lv import config\n"
        "from regional_lv.errors import InputError\n"
        "study = json.load(sys.stdin)\n"
        "loaded = config.load(study)\n"
        "assert loaded['emulators']['mean'] == {'depth': 3, 'input_transform': 'log'}\n"
        "assert config.load(loaded) == loaded\n"
        "study['synthetic_subjects']['anna']['noise'] = {'ration': 0.1}\n"
        "try: config.load(study)\n"
        "except InputError as error: print(error)\n"
        "study['synthetic_subjects']['anna']['noise'] = {}\n"
        "study['emulators']['mean'] = {'dept': 3}\n"
        "try: config.load(study)\n"
        "except InputError as error: print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=json.dumps(study),
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "anna.noise.ration: unknown key" in done.stdout
    assert "did you mean `synthetic_subjects.anna.noise.ratio`?" in done.stdout
    assert "emulators.mean: 'dept' is not offered; " in done.stdout
    assert "did you mean depth?" in done.stdout


def test_a_plugin_that_fails_is_named(tmp_path):
    (tmp_path / "bad.py").write_text("nonsense()")
    with pytest.raises(InputError, match=r"plugins: .*bad\.py fails \(NameError"):
        config.load(changed("plugins", [str(tmp_path / "bad.py")]))


def test_a_plugin_that_fails_is_read_again(tmp_path):
    path = tmp_path / "bad.py"
    with temporary():
        for _ in range(2):
            path.write_text("import nothing_of_this_name")
            with pytest.raises(InputError, match=r"bad\.py fails .*correct it"):
                load_plugins([path])
        path.write_text("")
        load_plugins([path])


def test_a_plugin_is_read_once_by_whatever_path(tmp_path, monkeypatch):
    """And one of the same name in another folder is another module."""
    monkeypatch.chdir(tmp_path)
    read = []
    monkeypatch.setattr("builtins.read_plugins", read, raising=False)
    for folder in ("one", "two"):
        Path(folder).mkdir()
        Path(folder, "mine.py").write_text("read_plugins.append(__name__)\n")
    monkeypatch.setenv("REGIONAL_LV_PLUGINS", str(tmp_path / "one" / "mine.py"))
    with temporary():
        load_plugins(["one/mine.py", "two/mine.py", "two/../one/mine.py"])
        load_plugins()
    assert len(read) == 2 and len(set(read)) == 2


def test_a_plugin_that_is_no_python_file_is_refused(tmp_path):
    path = tmp_path / "plugin.txt"
    path.write_text("")
    with pytest.raises(InputError, match=r"plugin\.txt is no Python file"):
        config.load(changed("plugins", [str(path)]))


def test_a_plugin_that_is_not_there_is_refused():
    with pytest.raises(InputError, match=r"plugins: .*none\.py; give the path of a Python file"):
        config.load(changed("plugins", ["none.py"]))


def test_configurations_are_read_without_torch_and_dolfinx():
    code = "import sys; from regional_lv import config; config.load('config/smoke.yaml');"
    code += "print({'torch', 'dolfinx', 'matplotlib'} & set(sys.modules))"
    env = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env)
    assert done.stdout.strip() == "set()", done.stderr


def test_segment_factors_go_by_the_number_of_the_segment():
    loaded = config.load(changed("material.segment_factors", {7: 3}))
    assert loaded["material"]["segment_factors"] == {"7": 3.0}
    with pytest.raises(InputError, match=r"segment_factors\.18: .*AHA segment, 1 to 17"):
        config.load(changed("material.segment_factors", {18: 3.0}))


def test_noise_is_filled_in_and_must_be_positive():
    subject = {"theta": dict.fromkeys(PARAMETERS.names, 1.0)}
    loaded = config.load(changed("synthetic_subjects.anna", subject) | {"subjects": {}})
    noise = {"strain": 0.02, "volume": 2.0, "torsion": 0.02, "shortening": 0.01}
    assert loaded["synthetic_subjects"]["anna"]["noise"] == noise
    assert loaded["synthetic_subjects"]["anna"]["seed"] is None
    subject["noise"] = {"strain": 0}
    with pytest.raises(InputError, match=r"noise\.strain.*give more than 0"):
        config.load(changed("synthetic_subjects.anna", subject))


@pytest.mark.parametrize(
    ("content", "remedy"),
    [
        ("", "write at least"),
        ("study: [", "correct what the parser names"),
        ("mine", "write at least"),
    ],
)
def test_unreadable_file_is_named(tmp_path, content, remedy):
    file = tmp_path / "mine.yaml"
    file.write_text(content)
    with pytest.raises(InputError, match=remedy) as error:
        config.load(file)
    assert str(file) in str(error.value)


def test_missing_file_is_named():
    with pytest.raises(InputError, match=r"nowhere\.yaml: there is no such file; check the path"):
        config.load("nowhere.yaml")


def test_paths_count_from_the_folder_of_the_configuration(tmp_path, monkeypatch):
    """From the working directory where there is no such file in that folder."""
    (tmp_path / "mine").mkdir()
    rows = [f"circumferential,{segment},-0.15,1" for segment in range(1, 17)]
    text = "\n".join(["quantity,segment,value,unit", "volume,,180,mL", *rows])
    for file in ("mine/own.csv", "other.csv"):
        (tmp_path / file).write_text(text)
    subjects = {
        "anna": {"source": "file", "measured": "own.csv"},
        "bert": {"source": "file", "measured": "other.csv"},
    }
    file = tmp_path / "mine" / "config.yaml"
    file.write_text(yaml.safe_dump({"study": "x", "subjects": subjects}))
    monkeypatch.chdir(tmp_path)
    found = config.load("mine/config.yaml")["subjects"]
    assert [found[name]["measured"] for name in subjects] == ["mine/own.csv", "other.csv"]
    monkeypatch.chdir(tmp_path / "mine")
    with pytest.raises(InputError, match=r"subjects\.bert\.measured: .*other\.csv.*check the path"):
        config.load(file)


def test_paths_of_a_linked_folder_count_from_where_it_is(tmp_path, monkeypatch):
    for folder in ("real/pat", "real/shared", "work/shared"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "segments.csv").write_text(segment_table("volunteer").read_text())
    (tmp_path / "work" / "pat").symlink_to("../real/pat")
    monkeypatch.chdir(tmp_path / "work")
    Path("pat/config.yaml").write_text(
        yaml.safe_dump(changed("geometry.segments", "../shared/segments.csv"))
    )
    used = config.load("pat/config.yaml")["geometry"]["segments"]
    assert Path(used).resolve() == tmp_path / "real" / "shared" / "segments.csv"
