"""Configurations: what is filled in, and what every kind of mistake says."""

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
from regional_lv.errors import InputError
from regional_lv.parameters import Parameterisation

ROOT = Path(__file__).resolve().parents[2]
PARAMETERS = Parameterisation()
STUDIES = ("config", "paper_1500", "study", "quick", "hidden_effects", "smoke")


@pytest.fixture(autouse=True)
def from_project_root(monkeypatch):
    """Paths in a configuration count from where one starts."""
    monkeypatch.chdir(ROOT)


@pytest.fixture
def subject():
    """A complete synthetic subject."""
    return {"theta": dict.fromkeys(PARAMETERS.names, 1.0)}


def changed(path: str, value) -> dict:
    """A minimal configuration with one key set."""
    root = {"study": "mine"}
    section = root
    *sections, key = path.split(".")
    for name in sections:
        section = section.setdefault(name, {})
    section[key] = value
    return root


@pytest.mark.parametrize("name", STUDIES)
def test_studies_of_the_project_are_valid(name):
    loaded = config.load(f"config/{name}.yaml")
    assert set(loaded) == set(config.load_schema()["properties"])
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
    assert set(config.load(quick)["subjects"]) == {"synthetic_lateral", "synthetic_hidden"}
    assert set(config.load(quick | own)["subjects"]) == {"anna"}


def test_a_study_without_evaluation_names_its_emulator():
    given = {"study": "mine", "evaluation": False, "emulators": {"names": ["exact_gp"]}}
    with pytest.raises(InputError, match=r"emulators\.final: without `evaluation`.*exact_gp"):
        config.load(given)
    given["emulators"]["final"] = "exact_gp"
    assert config.load(given)["evaluation"] is False


def test_loading_leaves_its_input_alone_and_repeats():
    given = {"study": "mine", "design": {"natural": 8}}
    before = copy.deepcopy(given)
    loaded = config.load(given)
    assert given == before
    assert config.load(loaded) == loaded
    loaded["design"]["natural"] = 9
    assert config.load(given)["design"]["natural"] == 8


def test_numbers_take_the_type_of_the_schema():
    whole, decimal = (
        config.load(changed("design.upper", 4)),
        config.load(changed("nuts.draws", 80.0)),
    )
    assert isinstance(whole["design"]["upper"], float)
    assert isinstance(decimal["nuts"]["draws"], int)


def test_schema_is_closed_and_documented():
    # What a plugin adds there has no entry of its own; the registries are asked.
    for_plugins = re.compile(r"config\.(emulators(\.\*)?|loading|supports|.*\.noise)")

    def walk(schema, path):
        if schema.get("type") == "object" and not for_plugins.fullmatch(path):
            assert schema["additionalProperties"] is False, path
        inner = schema.get("properties", {}) | schema.get("patternProperties", {})
        if isinstance(schema.get("additionalProperties"), dict):
            inner["*"] = schema["additionalProperties"]
        for key, entry in inner.items():
            walk(entry, f"{path}.{key}")

    walk(config.load_schema(), "config")
    # Absent means that there is no such file, effect, constant or segment.
    optional = re.compile(r"subjects\.<name>\.measured|.*\.<name>$")
    for path, entry in config.describe():
        assert entry["description"], path
        assert entry["reruns"], path
        assert entry["required"] or "default" in entry or optional.search(path), path


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
    assert text.endswith(f"{config.MARK}\n{config.document()}"), "run `make format`"
    rows = dict(re.findall(r"^\| `([^`]+)` \|[^|]*\| ([^|]+) \|", text, flags=re.MULTILINE))
    assert set(rows) == {path for path, _ in config.describe()}
    for path, value in leaves(config.load({"study": "mine"})):
        if path in rows and path != "study":
            assert yaml.safe_load(rows[path].strip("`")) == value, path


def leaves(section: dict, path: str = ""):
    for key, value in section.items():
        inner = f"{path}.{key}".lstrip(".")
        if isinstance(value, dict):
            yield from leaves(value, inner)
        else:
            yield inner, value


MISTAKES = [
    # what is written, what the message names, the remedy it gives
    (changed("nuts.chain", 4), "nuts.chain", "did you mean `nuts.chains`"),
    (changed("nutz", {}), "nutz", "did you mean `nuts`"),
    (changed("batch_size", 4), "batch_size", "did you mean `simulations.batch_size`"),
    (changed("emulators.exact_gp.kernal", "rq"), "exact_gp.kernal", "`emulators.exact_gp.kernel`"),
    (changed("mesh.zzz", 1), "mesh.zzz", "allowed here: circumferential"),
    ({"seed": 1}, "missing study", "add what is missing"),
    (changed("study", "my study"), "study", "use letters, digits and underscores"),
    (changed("seed", -1), "seed", "give at least 0"),
    (changed("seed", "x"), "seed", "a whole number"),
    (changed("nuts.draws", 80.5), "nuts.draws", "a whole number"),
    (changed("nuts.target_accept", 1.0), "nuts.target_accept", "give less than 1"),
    (changed("design", None), "design: an empty value", "a section"),
    (changed("design.lower", 0), "design.lower", "give more than 0"),
    (changed("design.lower", 6.0), "design.lower", "is not below design.upper"),
    (changed("design.test", True), "design.test", "a whole number"),
    (changed("simulations.batch_size", 0), "simulations.batch_size", "give at least 1"),
    (changed("nuts.cases_per_batch", 0), "nuts.cases_per_batch", "give at least 1"),
    (changed("mesh.circumferential", 20), "mesh.circumferential", "one of 16, 24, 32, 40, 48"),
    (changed("mesh.apex", 0), "mesh.apex", "give at least 1"),
    (changed("fibres.helix_endo_deg", 95), "fibres.helix_endo_deg", "give at most 90"),
    (changed("loading.base", "fixed"), "loading.base: has moved", "use `supports.base`"),
    (changed("loading.basal_compliance_mm_per_kpa", 1), "kpa: has moved", "`supports.base.radial`"),
    (changed("material.a_f_kpa", 1), "a_f_kpa: has moved", "`material.constants.a_f_kpa`"),
    (changed("material.factor_b", 1), "factor_b: has moved", "`material.reference.C_b`"),
    (changed("observables.nominal_share", 1), "has moved", "`observables.strain_exponent`"),
    (
        changed("supports.base.radial", "hold"),
        "supports.base.radial: 'hold'",
        "write `held`, `free`",
    ),
    (changed("supports.base.radial", -1), "supports.base.radial", "give at least 0"),
    (changed("supports.base.axial", "free"), "nothing holds the ventricle along", "compliance"),
    (changed("supports.base.radial", "free"), "nothing holds the ventricle across", "hold it"),
    (changed("supports.bas", {}), "supports.bas: unknown key", "did you mean `supports.base`"),
    (changed("loading.presure_mmhg", 8), "loading.presure", "did you mean `loading.pressure_mmhg`"),
    (changed("loading.presure_mmhg", "x"), "loading.presure", "`loading.pressure_mmhg`"),
    (changed("loading.septal_pressure_mmhg", -1), "loading.septal_pressure_mmhg", "at least 0"),
    (
        changed("parameters.zones", "papr"),
        "parameters.zones: 'papr'",
        "write `paper`, `segments` or",
    ),
    (
        changed("parameters.zones", {"a": [1, 2, 3], "b": [3, *range(4, 18)]}),
        "parameters.zones.b: segment 3 belongs to a already",
        "in one zone only",
    ),
    (
        changed("parameters.zones", {"a": list(range(1, 17))}),
        "parameters.zones: no zone holds segment 17",
        "add what is missing",
    ),
    (changed("parameters.zones", {"a": [*range(1, 19)]}), "18 is no AHA segment", "from 1 to 17"),
    (changed("parameters.zones", {"a": [], "b": [1]}), "zones.a: holds no segment", "remove it"),
    (changed("parameters.zones", {"my zone": [1]}), "zones.my zone", "use letters, digits"),
    (changed("parameters.factors", ["C_c"]), "parameters.factors: C_c", "choose among C_a, C_b"),
    (changed("parameters.factors", []), "parameters.factors", "name at least one"),
    (changed("parameters.bounds", {"C_c": [1, 2]}), "parameters.bounds: C_c", "choose among C_a"),
    (changed("parameters.bounds", {"C_a": [2, 1]}), "bounds.C_a: [2, 1] is no", "the lower bound"),
    (changed("parameters.bounds", {"C_a": [1]}), "bounds.C_a: [1] holds 1", "give 2"),
    (changed("material.law", "gucione"), "material.law: 'gucione'", "did you mean guccione?"),
    (changed("material.constants.c_kpa", 1), "material.constants.c_kpa", "choose among a_kpa, b"),
    (changed("material.constants.a_kpa", 0), "material.constants.a_kpa", "correct it"),
    (changed("material.reference.C_c", 1), "material.reference.C_c", "choose among C_a, C_b"),
    (changed("observables.quantities", ["torsoin"]), "'torsoin'", "did you mean torsion?"),
    (changed("observables.quantities", []), "observables.quantities", "name at least one"),
    (
        changed(
            "observables", {"quantities": ["volume", "torsion"], "places": {"torsion": ["mid"]}}
        ),
        "observables.places.torsion: 'mid' is no place",
        "there are basal-mid, basal-apical, mid-apical",
    ),
    (
        changed("observables.places", {"torsion": ["mid-apical"]}),
        "observables.places.torsion: torsion is not observed",
        "add it to",
    ),
    (changed("observables.places", {"radial": [18]}), "places.radial: '18'", "there are 01, 02"),
    (changed("observables.layer", [0.5, 0.2]), "observables.layer", "give the inner depth first"),
    (changed("observables.layer", [0.0, 1.2]), "observables.layer.1", "give at most 1"),
    (changed("observables.layer", [0.0]), "observables.layer", "give 2"),
    (changed("observables.scale", {"radail": 0.8}), "observables.scale.radail", "not observed"),
    (changed("observables.scale", {"radial": 0}), "scale.radial", "give more than 0"),
    (changed("emulators.nmaes", ["dnn"]), "emulators.nmaes", "did you mean `emulators.names`"),
    (changed("emulators.exact_pg", {}), "emulators.exact_pg", "did you mean `emulators.exact_gp`"),
    (changed("plugins", ["none.py"]), "none.py", "give the path of a Python file"),
    (changed("scenarios.noise.volum", 1.0), "scenarios.noise: 'volum'", "did you mean volume?"),
    (changed("criticism.benchmark.noise.strian", 1.0), "noise: 'strian'", "did you mean strain?"),
    (changed("efficiency.sizes", [11]), "efficiency.sizes: 11", "give 12 or more"),
    (
        {"study": "x", "parameters": {"zones": "segments"}, "efficiency": {"sizes": [35]}},
        "efficiency.sizes: 35",
        "give 36 or more",
    ),
    (
        {"study": "x", "observables": {"quantities": ["volume"]}, "synthetic_subjects": {}},
        "subjects.volunteer: the study observes no strain",
        "remove it from `subjects`",
    ),
    (changed("loading.frames", [0.5, 1.0]), "loading.frames.1", "give less than 1"),
    (changed("loading.frames", [0.5, 0.2]), "loading.frames", "sort it"),
    (changed("loading.frames", 0.5), "loading.frames", "a list"),
    (changed("geometry.epi_apex_z_mm", -70), "geometry.epi_apex_z_mm", "lower it"),
    (changed("geometry.segments", "none.csv"), "geometry.segments", "give its path"),
    (changed("emulators.exact_gp.nugget", "1e-8"), "exact_gp.nugget", "write it as 1.0e-8"),
    (changed("emulators.names", ["mvpg"]), "emulators.names", "did you mean mvgp?"),
    (changed("emulators.names", []), "emulators.names", "name at least one"),
    (changed("solver.min_load_fraction", 0.5), "solver.min_load_fraction", "lower it"),
    (changed("test_posteriors.cases", "most"), "test_posteriors.cases", "`all`"),
    (changed("test_posteriors.cases", 121), "test_posteriors.cases", "or write `all`"),
    (changed("emulators.shortlist.names", []), "emulators.shortlist.names", "name at least one"),
    (
        changed("emulators", {"names": ["exact_gp"], "shortlist": {"names": ["dnn"]}}),
        "shortlist.names: dnn",
        "add it there",
    ),
    (
        changed("emulators", {"names": ["exact_gp"], "final": "mvgp"}),
        "emulators.final: mvgp",
        "or write `auto`",
    ),
    (
        changed("scenarios.sets.mild", {"kind": "local", "mu": 7}),
        "scenarios.sets.mild.mu: 7 lies outside [0.1, 5]",
        "move it inside",
    ),
    (changed("scenarios.healthy_mean", 0.05), "scenarios.healthy_mean", "move it inside"),
    (
        changed("scenarios.sets.test", {"kind": "local", "mu": 2}),
        "scenarios.sets.test",
        "choose another",
    ),
    (changed("scenarios.sets.mild", {"mu": 2}), "missing kind", "add what is missing"),
    (changed("scenarios.noise.volume", 0), "scenarios.noise.volume", "give more than 0"),
    (changed("subjects.7up", {"source": "synthetic"}), "subjects.7up", "begin with a letter"),
    (changed("subjects", {1: {"source": "synthetic"}}), "subjects.1", "begin with a letter"),
    (changed("subjects.anna", {}), "subjects.anna", "missing source"),
    (changed("subjects.anna.source", "synthetic"), "subjects.anna", "synthetic_subjects has no"),
    (changed("subjects.anna.source", "file"), "subjects.anna.measured", "give the path"),
    (
        changed("subjects.anna", {"source": "file", "measured": "no.csv"}),
        "subjects.anna.measured: no.csv",
        "check path",
    ),
    (
        changed("subjects.anna", {"source": "published_volunteer", "measured": "x.csv"}),
        "subjects.anna.measured",
        "remove one of the two",
    ),
    (
        changed("subjects.anna", {"source": "published_volunteer", "slices": [1, 3, 5]}),
        "subjects.anna.slices",
        "add `frame",
    ),
    (
        changed(
            "subjects.anna",
            {"source": "published_volunteer", "frame": "extrema", "slices": [1, 5]},
        ),
        "subjects.anna.slices: ",
        "name one of 1 and 2",
    ),
]


@pytest.mark.parametrize(("given", "key", "remedy"), MISTAKES, ids=[m[1] for m in MISTAKES])
def test_mistake_is_named_with_its_remedy(given, key, remedy):
    with pytest.raises(InputError) as error:
        config.load(given, source="mine.yaml")
    message = str(error.value)
    assert "mine.yaml: " in message
    assert key in message
    assert remedy in message


def test_all_mistakes_are_reported_at_once():
    given = {"study": "mine", "nuts": {"chain": 2}, "mesh": {"basal": 0}}
    with pytest.raises(InputError) as error:
        config.load(given)
    assert len(str(error.value).splitlines()) == 2


def test_incomplete_theta_names_what_is_missing(subject):
    del subject["theta"]["C_b_septal"]
    with pytest.raises(InputError, match=r"anna\.theta: missing C_b_septal; add what is missing"):
        config.load(changed("synthetic_subjects.anna", subject))


def test_theta_outside_the_design_names_the_bounds(subject):
    subject["theta"]["C_a_apical"] = 7.0
    with pytest.raises(InputError, match=r"C_a_apical: 7.0 lies outside \[0.1, 5.0\].*inside"):
        config.load(changed("synthetic_subjects.anna", subject))


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ({"fibre_rotatio": 5.0}, r"effects: 'fibre_rotatio' .*did you mean fibre_rotation"),
        ({"fibre_rotation": {"segment": 7, "multiplier": 2.0}}, r"rotation: .*give a number"),
        ({"focal_scar": 3.0}, r"focal_scar: 3.0 is not its form; give \{segment: "),
        ({"fibre_rotation": 40.0}, r"effects\.fibre_rotation: 40.0 .*-30.0 to 30.0 deg; move it"),
        ({"focal_scar": {"segment": 18, "multiplier": 2.0}}, r"segment: 18 is too large"),
        ({"focal_scar": {"segment": 7}}, r"focal_scar: missing multiplier"),
        ({"focal_scar": {"segment": 7, "multiplier": 30.0}}, r"focal_scar: 30.0 lies outside"),
    ],
)
def test_effects_are_registered_ones_in_their_range(subject, effects, message):
    subject["effects"] = effects
    with pytest.raises(InputError, match=message):
        config.load(changed("synthetic_subjects.anna", subject) | {"subjects": {}})


def test_effects_in_their_range_are_kept(subject):
    subject["effects"] = {"focal_scar": {"segment": 7, "multiplier": 3}, "radial_scale": 0.8}
    loaded = config.load(changed("synthetic_subjects.anna", subject) | {"subjects": {}})
    assert loaded["synthetic_subjects"]["anna"]["effects"] == subject["effects"]


def test_hypotheses_that_the_study_rules_out_are_refused_by_name():
    study = changed("supports.base.radial", 1.0)
    assert config.load(study | {"criticism": {"hypotheses": "all"}})
    with pytest.raises(
        InputError, match=r"hypotheses: basal_motion cannot be tested, .*; remove it"
    ):
        config.load(study | {"criticism": {"hypotheses": ["basal_motion"]}})
    with pytest.raises(InputError, match="neither `all` nor a list of names"):
        config.load(changed("criticism.hypotheses", "some"))
    with pytest.raises(InputError, match=r"hypotheses: 'basal_moton' .*did you mean basal_motion"):
        config.load(changed("criticism.hypotheses", ["basal_moton"]))


def test_supports_are_held_free_or_compliant():
    base = config.load({"study": "mine"})["supports"]["base"]
    assert base == {"radial": "held", "axial": "held", "circumferential": "free"}
    sprung = {"base": {"radial": "free", "axial": "free"}, "epicardium_kpa_per_mm": 1}
    loaded = config.load({"study": "mine", "supports": sprung})
    assert loaded["supports"]["base"]["axial"] == "free"
    loaded = config.load(changed("supports.base.axial", 2))
    assert isinstance(loaded["supports"]["base"]["axial"], float)


def test_theta_has_the_names_of_the_study(subject):
    study = changed("synthetic_subjects.anna", subject) | {"subjects": {}}
    with pytest.raises(InputError, match=r"anna\.theta: 'C_a_anterior' is not offered") as error:
        config.load(study | {"parameters": {"zones": "whole"}})
    assert "anna.theta: missing C_a_whole, C_b_whole" in str(error.value)
    study["synthetic_subjects"]["anna"]["theta"] = {"C_a_whole": 0.5, "C_b_whole": 1.0}
    bounds = {"C_a": [0.6, 2.0]}
    with pytest.raises(InputError, match=r"C_a_whole: 0.5 lies outside \[0.6, 2.0\]"):
        config.load(study | {"parameters": {"zones": "whole", "bounds": bounds}})


def test_known_thetas_of_published_simulations_are_the_papers():
    joint = {"all": {"subjects": ["row"], "theta": "published"}}
    study = {"study": "mine", "subjects": {"row": {"source": "published_simulation", "row": 3}}}
    assert config.load(study | {"criticism": {"joint": joint}})
    with pytest.raises(InputError, match=r"joint\.all\.theta: .* the paper's zones and factors"):
        config.load(study | {"criticism": {"joint": joint}, "parameters": {"zones": "whole"}})


def test_physics_is_what_the_simulator_is_made_from():
    loaded = config.load(changed("geometry.wall_thickness_scale", 1.1))
    described = config.physics(loaded)
    assert described["geometry"] == {"wall_thickness_scale": 1.1}
    assert Parameterisation.from_spec(described["parameters"]) == PARAMETERS
    assert described["supports"] == loaded["supports"]


# ------------------------------------------------------------------------------------- plugins

PLUGIN = """
from regional_lv.criticism.hypotheses import REGISTRY as HYPOTHESES
from regional_lv.emulators import REGISTRY as EMULATORS
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
    name = "mean"


EMULATORS.add(Mean)


class Swelling(type(HYPOTHESES["wall_thickness"])):
    name = "swelling"


HYPOTHESES.add(Swelling())
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
        "criticism": {
            "hypotheses": ["swelling"],
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
    assert "anna.noise: 'ration' is not offered" in done.stdout
    assert "did you mean ratio?" in done.stdout


def test_a_plugin_that_fails_is_named(tmp_path):
    (tmp_path / "bad.py").write_text("nonsense()")
    with pytest.raises(InputError, match=r"plugins: .*bad\.py fails \(NameError"):
        config.load(changed("plugins", [str(tmp_path / "bad.py")]))


def test_a_plugin_that_is_no_python_file_is_refused(tmp_path):
    path = tmp_path / "plugin.txt"
    path.write_text("")
    with pytest.raises(InputError, match=r"plugin\.txt is no Python file"):
        config.load(changed("plugins", [str(path)]))


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


def test_noise_is_filled_in_and_must_be_positive(subject):
    loaded = config.load(changed("synthetic_subjects.anna", subject) | {"subjects": {}})
    noise = {"strain": 0.02, "volume": 2.0, "torsion": 0.02, "shortening": 0.01}
    assert loaded["synthetic_subjects"]["anna"]["noise"] == noise
    assert loaded["synthetic_subjects"]["anna"]["seed"] is None
    subject["noise"] = {"strain": 0}
    with pytest.raises(InputError, match=r"noise\.strain.*give more than 0"):
        config.load(changed("synthetic_subjects.anna", subject))


def test_measured_file_of_a_subject_is_checked_before_anything_runs(tmp_path):
    file = tmp_path / "anna.csv"
    file.write_text("quantity,segment,value,unit\nvolume,,0.18,mL\n")
    with pytest.raises(InputError, match=r"subjects\.anna\.measured: .*line 2: .*litres"):
        config.load(changed("subjects.anna", {"source": "file", "measured": str(file)}))


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
    with pytest.raises(InputError, match=r"nowhere\.yaml: cannot be read .* check path"):
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
    with pytest.raises(InputError, match=r"subjects\.bert\.measured: .*other\.csv.*check path"):
        config.load(file)


def test_empty_pressure_says_what_it_is_and_what_a_wrong_one_does():
    with pytest.raises(InputError) as error:
        config.load(changed("loading.pressure_mmhg", None))
    (line,) = str(error.value).splitlines()
    assert line.startswith("config: loading.pressure_mmhg: empty; fill in the end-diastolic")
    assert "every C_a come out 10 % too high" in line


CURVE_MISTAKES = {
    "unit": ({"unit": None}, "subjects.anna.unit: missing; give it"),
    "reference": ({"reference": "diastole"}, "did you mean end_diastole?"),
    "frame": ({"frame": "extrema"}, "only `source: published_volunteer` has the frame extrema"),
    "no file": ({"curves": "no.csv"}, "subjects.anna.curves: no.csv: cannot be read"),
    "litres": ({"volume_ml": 0.18}, "subjects.anna.volume_ml: 0.18 is too small"),
    "of a file": ({"source": "file"}, "subjects.anna.curves: only `source: curves` has it"),
    "sd": ({"source": "synthetic", "sd": {"strain": 0.02}}, "subjects.anna.sd.strain: only"),
}


@pytest.mark.parametrize("name", CURVE_MISTAKES)
def test_mistake_about_curves_is_named(tmp_path, name):
    (tmp_path / "curves.csv").write_text("frame,radial_01\n1,0\n2,40\n3,20\n4,1\n")
    curves = {
        "source": "curves",
        "curves": str(tmp_path / "curves.csv"),
        "unit": "percent",
        "reference": "end_diastole",
        "frame": "earliest_diastole",
    }
    config.load(changed("subjects", {"anna": curves}))
    change, expected = CURVE_MISTAKES[name]
    with pytest.raises(InputError) as error:
        config.load(changed("subjects", {"anna": curves | change}))
    assert expected in str(error.value)


def test_curves_are_of_material_lines(tmp_path):
    (tmp_path / "curves.csv").write_text("frame,radial_01\n1,0\n2,40\n3,20\n4,1\n")
    study = changed("observables.strain_exponent", 1)
    study["subjects"] = {
        "anna": {
            "source": "curves",
            "curves": str(tmp_path / "curves.csv"),
            "unit": "percent",
            "reference": "end_diastole",
            "frame": 3,
        }
    }
    with pytest.raises(InputError, match=r"observables\.line_share: .*set line_share: 1"):
        config.load(study)
    study["observables"]["line_share"] = 1
    config.load(study)
