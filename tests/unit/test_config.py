"""Configurations: what is filled in, and what every kind of mistake says."""

import copy
import re
from pathlib import Path

import pytest
import yaml

from regional_lv import aha, config
from regional_lv.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
STUDIES = ("config", "paper_1500", "quick", "hidden_effects", "smoke")


@pytest.fixture(autouse=True)
def from_project_root(monkeypatch):
    """Paths in a configuration count from where one starts."""
    monkeypatch.chdir(ROOT)


@pytest.fixture
def subject():
    """A complete synthetic subject."""
    return {"theta": dict.fromkeys(aha.PARAMETERS, 1.0)}


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


def test_every_default_is_valid():
    loaded = config.load({"study": "mine", "synthetic_subjects": {}, "subjects": {}})
    assert config.load(loaded) == loaded


def test_schema_is_closed_and_documented():
    def walk(schema, path):
        if schema.get("type") == "object":
            assert schema["additionalProperties"] is False, path
        inner = schema.get("properties", {}) | schema.get("patternProperties", {})
        for key, entry in inner.items():
            walk(entry, f"{path}.{key}")

    walk(config.load_schema(), "config")
    # Absent means that there is no such file, effect or segment.
    optional = re.compile(r"subjects\.<name>\.(measured|effects\..*)|material\.segment_factors\..*")
    for path, entry in config.describe():
        assert entry["description"], path
        assert entry["reruns"], path
        assert entry["required"] or "default" in entry or optional.search(path), path


def test_schema_names_the_parameters_of_the_project():
    theta = config.load_schema()["properties"]["synthetic_subjects"]["patternProperties"]
    theta = next(iter(theta.values()))["properties"]["theta"]
    assert tuple(theta["properties"]) == tuple(theta["required"]) == aha.PARAMETERS


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
    (changed("loading.base", "fixd"), "loading.base", "did you mean fixed?"),
    (changed("loading.frames", [0.5, 1.0]), "loading.frames.1", "give less than 1"),
    (changed("loading.frames", [0.5, 0.2]), "loading.frames", "sort it"),
    (changed("loading.frames", 0.5), "loading.frames", "a list"),
    (changed("geometry.epi_apex_z_mm", -70), "geometry.epi_apex_z_mm", "lower it"),
    (changed("geometry.segments", "none.csv"), "geometry.segments", "give its path"),
    (changed("emulators.exact_gp.nugget", "1e-8"), "exact_gp.nugget", "write it as 1.0e-8"),
    (changed("emulators.names", ["mvpg"]), "emulators.names.0", "did you mean mvgp?"),
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
        ({"fibre_rotatio": 5.0}, r"did you mean .*effects\.fibre_rotation"),
        ({"fibre_rotation": 40.0}, r"effects\.fibre_rotation: 40.0 .*-15.0 to 15.0 deg; move it"),
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
    study = changed("loading.base", "fixed")
    assert config.load(study | {"criticism": {"hypotheses": "all"}})
    with pytest.raises(InputError, match=r"basal_motion cannot be asked, loading\.base fixed"):
        config.load(study | {"criticism": {"hypotheses": ["basal_motion"]}})
    with pytest.raises(InputError, match=r"neither `all` nor a list of end_diastolic_pressure"):
        config.load(changed("criticism.hypotheses", "some"))


def test_a_compliant_base_needs_one_that_is_held():
    loading = {"base": "fixed", "basal_compliance_mm_per_kpa": 1.0}
    with pytest.raises(InputError, match=r"basal_compliance_mm_per_kpa: only `u_r_u_z_fixed`"):
        config.load({"study": "mine", "loading": loading})


def test_segment_factors_go_by_the_number_of_the_segment():
    loaded = config.load(changed("material.segment_factors", {7: 3}))
    assert loaded["material"]["segment_factors"] == {"7": 3.0}
    with pytest.raises(InputError, match=r"segment_factors\.18: .*AHA segment, 1 to 17"):
        config.load(changed("material.segment_factors", {18: 3.0}))


def test_noise_is_filled_in_and_must_be_positive(subject):
    loaded = config.load(changed("synthetic_subjects.anna", subject) | {"subjects": {}})
    assert loaded["synthetic_subjects"]["anna"]["noise"] == {"strain": 0.02, "volume": 2.0}
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
        ("study: [", "mend what the parser names"),
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
    with pytest.raises(InputError, match=r"nowhere\.yaml: cannot be read .* check the path"):
        config.load("nowhere.yaml")
