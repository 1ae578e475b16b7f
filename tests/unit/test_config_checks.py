"""What has to fit between the keys of a configuration, its files and the registries."""

import pytest

from regional_lv import config
from regional_lv.errors import InputError
from regional_lv.inputs.stiffness import StiffnessInputs
from tests.unit.configurations import changed, refused

PARAMETERS = StiffnessInputs()


@pytest.fixture
def subject():
    """A complete synthetic subject."""
    return {"theta": dict.fromkeys(PARAMETERS.names, 1.0)}


MISTAKES = [
    # what is written, what the message names, the remedy it gives
    (changed("design.lower", 6.0), "design.lower", "is not below design.upper"),
    (changed("loading.basal_compliance_mm_per_kpa", 1), "kpa: has moved", "`supports.base.radial`"),
    (changed("supports.base.axial", "free"), "nothing holds the ventricle along", "compliance"),
    (changed("supports.base.radial", "free"), "nothing holds the ventricle across", "hold it"),
    (changed("supports.bas", {}), "supports.bas: unknown key", "did you mean `supports.base`"),
    (changed("loading.presure_mmhg", 8), "loading.presure", "did you mean `loading.pressure_mmhg`"),
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
    (
        changed("parameters.zones", {"all": [1], "rest": list(range(2, 18))}),
        "parameters.zones.all: stands for all zones",
        "another name",
    ),
    (changed("nuts.draws", 300), "nuts.draws: 2 chains of 300 draws", "set nuts.draws to 334"),
    (changed("clinical.draws", 50), "clinical.draws: ", "or lower nuts.ess_min"),
    (changed("parameters.zones", {"a": [*range(1, 19)]}), "18 is no AHA segment", "from 1 to 17"),
    (changed("parameters.zones", {"a": [], "b": [1]}), "zones.a: holds no segment", "remove it"),
    (changed("parameters.factors", ["C_c"]), "parameters.factors: C_c", "choose among C_a, C_b"),
    (changed("parameters.bounds", {"C_c": [1, 2]}), "parameters.bounds: C_c", "choose among C_a"),
    (changed("parameters.bounds", {"C_a": [2, 1]}), "bounds.C_a: [2, 1] is no", "the lower bound"),
    (changed("material.law", "gucione"), "material.law: 'gucione'", "did you mean guccione?"),
    (changed("material.constants.c_kpa", 1), "material.constants.c_kpa", "choose among a_kpa, b"),
    (changed("material.constants.a_kpa", 0), "material.constants.a_kpa", "correct it"),
    (changed("material.reference.C_c", 1), "material.reference.C_c", "choose among C_a, C_b"),
    (changed("observables.quantities", ["torsoin"]), "'torsoin'", "did you mean torsion?"),
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
    (changed("observables.scale", {"radail": 0.8}), "observables.scale.radail", "not observed"),
    (changed("emulators.exact_pg", {}), "emulators.exact_pg", "did you mean `emulators.exact_gp`"),
    (
        changed("scenarios.noise.volum", 1.0),
        "noise.volum: unknown",
        "did you mean `scenarios.noise.volume`?",
    ),
    (
        changed("criticism.benchmark.noise.strian", 1.0),
        "noise.strian: unknown key",
        "noise.strain`?",
    ),
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
    (changed("loading.frames", [0.5, 0.2]), "loading.frames", "sort it"),
    (changed("geometry.epi_apex_z_mm", -70), "geometry.epi_apex_z_mm", "lower it"),
    (changed("geometry.segments", "none.csv"), "geometry.segments", "give its path"),
    (changed("emulators.names", ["mvpg"]), "emulators.names", "did you mean mvgp?"),
    (changed("emulators.names", ["joint_gp"]), "every study trains by itself", "name one of"),
    (changed("solver.min_load_fraction", 0.5), "solver.min_load_fraction", "lower it"),
    (changed("test_posteriors.cases", 121), "test_posteriors.cases", "or write `all`"),
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
    (changed("subjects.anna.source", "synthetic"), "subjects.anna", "synthetic_subjects has no"),
    (changed("subjects.anna.source", "file"), "subjects.anna.measured", "give it. Path of"),
    (
        changed("subjects.anna", {"source": "file", "measured": "no.csv"}),
        "subjects.anna.measured: no.csv",
        "check the path",
    ),
    (
        changed("subjects.anna", {"source": "published_volunteer", "measured": "x.csv"}),
        "subjects.anna.measured",
        "write that, or remove it",
    ),
    (
        changed("subjects.anna", {"source": "published_volunteer", "segments": 18}),
        "subjects.anna.segments",
        "write that, or remove it",
    ),
    (
        changed("subjects.anna", {"source": "file", "measured": "x.csv", "segments": 20}),
        "subjects.anna.segments: 20 is not offered",
        "choose one of 16, 17, 18",
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
    (
        changed("subjects.anna", {"source": "published_volunteer", "frame": 0}),
        "subjects.anna.frame: 0",
        "too small",
    ),
    (
        changed("subjects.anna", {"source": "published_volunteer", "frame": 16}),
        "subjects.anna.frame: 16",
        "too large",
    ),
    (
        changed("trust.resimulated_draws", 1201),
        "trust.resimulated_draws: 1201 of the 1200 draws",
        "lower it",
    ),
]


@pytest.mark.parametrize(("given", "key", "remedy"), MISTAKES, ids=[m[1] for m in MISTAKES])
def test_mistake_is_named_with_its_remedy(given, key, remedy):
    refused(given, key, remedy)


def test_a_study_without_evaluation_names_its_emulator():
    given = {"study": "mine", "evaluation": False, "emulators": {"names": ["exact_gp"]}}
    with pytest.raises(InputError, match=r"emulators\.final: without `evaluation`.*exact_gp"):
        config.load(given)
    given["emulators"]["final"] = "exact_gp"
    assert config.load(given)["evaluation"] is False


def test_incomplete_theta_names_what_is_missing(subject):
    del subject["theta"]["C_b_septal"]
    with pytest.raises(InputError, match=r"anna\.theta: missing C_b_septal; add what is missing"):
        config.load(changed("synthetic_subjects.anna", subject))


def test_theta_outside_the_design_names_the_bounds(subject):
    subject["theta"]["C_a_apical"] = 7.0
    with pytest.raises(InputError, match=r"C_a_apical: 7.0 lies outside \[0.1, 5.0\].*inside"):
        config.load(changed("synthetic_subjects.anna", subject))


def test_theta_has_the_names_of_the_study(subject):
    study = changed("synthetic_subjects.anna", subject) | OF_ANNA
    with pytest.raises(InputError, match=r"anna\.theta: 'C_a_anterior' is not offered") as error:
        config.load(study | {"parameters": {"zones": "whole"}})
    assert "anna.theta: missing C_a_whole, C_b_whole" in str(error.value)
    study["synthetic_subjects"]["anna"]["theta"] = {"C_a_whole": 0.5, "C_b_whole": 1.0}
    bounds = {"C_a": [0.6, 2.0]}
    with pytest.raises(InputError, match=r"C_a_whole: 0.5 lies outside \[0.6, 2.0\]"):
        config.load(study | {"parameters": {"zones": "whole", "bounds": bounds}})


@pytest.mark.parametrize(
    ("given", "key", "source"),
    [
        ({"surfaces": {"endocardium": "endo.stl"}}, "surfaces", "surfaces"),
        ({"imported": {"file": "heart.inp"}}, "imported", "mesh"),
        ({"source": "mesh", "surfaces": {"epicardium": "epi.stl"}}, "surfaces", "surfaces"),
    ],
)
def test_a_geometry_that_would_not_be_used_is_refused(given, key, source):
    message = rf"geometry\.{key}: only `source: {source}` has it; write that, or remove it"
    with pytest.raises(InputError, match=message):
        config.load({"study": "mine", "geometry": given})


@pytest.mark.parametrize(
    "text",
    [
        "study: a\nloading: {pressure_mmhg: 10}\nloading: {pressure_mmhg: 20}\n",
        "study: a\nloading:\n  pressure_mmhg: 10\n  pressure_mmhg: 20\n",
        "study: a\nloading: {pressure_mmhg: 10, pressure_mmhg: 20}\n",
    ],
)
def test_a_key_that_occurs_twice_is_refused(tmp_path, text):
    (tmp_path / "config.yaml").write_text(text)
    with pytest.raises(InputError, match=r"` is in line \d already; remove one of both"):
        config.read(tmp_path / "config.yaml")


def test_aliases_and_merged_sections_are_no_repetition(tmp_path):
    text = "study: a\nx: &x {p: 1}\ny: {<<: *x, q: 2}\n'no': 1\nyes: 2\n"
    (tmp_path / "config.yaml").write_text(text)
    assert config.read(tmp_path / "config.yaml")["y"] == {"p": 1, "q": 2}


def test_an_empty_section_takes_the_one_below_away():
    below = {"study": "a", "inputs": {"septal_load": "suspected"}, "nuts": {"chains": 2}}
    assert config.merged(below, {"inputs": {}}) == {**below, "inputs": {}}
    assert config.merged(below, {"nuts": {"draws": 9}})["nuts"] == {"chains": 2, "draws": 9}


def test_a_level_that_no_test_can_reach():
    benchmark = {"level": 0.01, "bootstrap": 199, "benchmark": {"bootstrap": 49}}
    with pytest.raises(InputError, match=r"with 49 replicates; raise it, or criticism\.benchmark"):
        config.load({"study": "mine", "criticism": benchmark})
    with pytest.raises(InputError, match=r"criticism\.level: 0.01 is never reached with 59"):
        config.load({"study": "mine", "criticism": {"level": 0.01, "bootstrap": 59}})


OF_ANNA = {"subjects": {"anna": {"source": "synthetic"}}}


def test_effects_that_a_study_cannot_have_are_refused(subject):
    study = changed("material.law", "guccione") | OF_ANNA
    subject["effects"] = {"anisotropy": 0.5}
    study["synthetic_subjects"] = {"anna": subject}
    with pytest.raises(InputError, match=r"anna\.effects\.anisotropy: this study has no such"):
        config.load(study)


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ({"fibre_rotatio": 5.0}, r"effects\.fibre_rotatio: is no .*did you mean fibre_rotation"),
        ({"focal_scar": 3.0}, r"effects\.focal_scar: is no input.*did you mean focal_scar"),
        ({"fibre_rotation": 40.0}, r"effects\.fibre_rotation: 40.0 .*-30 to 30 deg; move it"),
        ({"focal_scar_18": 2.0}, r"focal_scar_18: is no input"),
        ({"focal_scar_7": 30.0}, r"focal_scar_7: 30.0 lies outside"),
        ({"focal_scar_7": {"multiplier": 3.0}}, r"focal_scar_7: .*number"),
        ({"C_a_septal": 2.0}, r"C_a_septal: is no input"),
    ],
)
def test_effects_are_inputs_in_their_range(subject, effects, message):
    subject["effects"] = effects
    with pytest.raises(InputError, match=message):
        config.load(changed("synthetic_subjects.anna", subject) | OF_ANNA)


def test_effects_in_their_range_are_kept(subject):
    subject["effects"] = {"focal_scar_7": 3, "radial_scale": 0.8, "wall_thickness_4": 12.0}
    loaded = config.load(changed("synthetic_subjects.anna", subject) | OF_ANNA)
    assert loaded["synthetic_subjects"]["anna"]["effects"] == subject["effects"]


def test_inputs_that_the_study_rules_out_are_refused_by_name():
    study = changed("material.law", "guccione")
    assert config.load(study | {"inputs": {"causes": "suspected", "anisotropy": "fixed"}})
    with pytest.raises(InputError, match=r"inputs\.anisotropy: this study has no such input, .*;"):
        config.load(study | {"inputs": {"anisotropy": "suspected"}})
    with pytest.raises(InputError, match=r"inputs: roles ask for simulations of their own"):
        tables = {
            "source": "table",
            "tables": {"train": {"inputs": "published", "outputs": "published"}},
        }
        config.load({"study": "mine", "simulations": tables, "inputs": {"causes": "suspected"}})


def test_nothing_is_criticised_together_that_is_not_suspected():
    joint = {"all": {"subjects": ["synthetic_lateral"]}}
    with pytest.raises(InputError, match=r"criticism\.joint: nothing is suspected; make"):
        config.load({"study": "mine", "inputs": {}, "criticism": {"joint": joint}})


def test_known_thetas_of_published_simulations_are_the_papers():
    joint = {"all": {"subjects": ["row"], "theta": "published"}}
    study = {"study": "mine", "subjects": {"row": {"source": "published_simulation", "row": 3}}}
    study["inputs"] = {"causes": "suspected"}
    assert config.load(study | {"criticism": {"joint": joint}})
    with pytest.raises(InputError, match=r"joint\.all\.theta: .* the paper's zones and factors"):
        config.load(study | {"criticism": {"joint": joint}, "parameters": {"zones": "whole"}})


def test_measured_file_of_a_subject_is_checked_before_anything_runs(tmp_path):
    file = tmp_path / "anna.csv"
    file.write_text("quantity,segment,value,unit\nvolume,,0.18,mL\n")
    with pytest.raises(InputError, match=r"subjects\.anna\.measured: .*line 2: .*litres"):
        config.load(changed("subjects.anna", {"source": "file", "measured": str(file)}))


CURVE_MISTAKES = {
    "unit": (
        {"unit": None},
        "subjects.anna.unit: an empty value is not offered; choose one of percent",
    ),
    "reference": ({"reference": "diastole"}, "did you mean end_diastole?"),
    "frame": ({"frame": "extrema"}, "'extrema' is not possible; give the number of a frame"),
    "no file": ({"curves": "no.csv"}, "subjects.anna.curves: no.csv: there is no such file"),
    "litres": ({"volume_ml": 0.18}, "subjects.anna.volume_ml: 0.18 is too small"),
    "of a file": ({"source": "file"}, "subjects.anna.curves: only `source: curves` has it"),
    "sd": (
        {"source": "synthetic", "sd": {"strain": 0.02}},
        "subjects.anna.sd: only `source: curves` has it",
    ),
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
    with pytest.raises(InputError, match=r"anna\.curves: .*set observables.line_share: 1"):
        config.load(study)
    study["observables"]["line_share"] = 1
    config.load(study)


@pytest.mark.parametrize("remesh", [True, False])
def test_only_a_mesh_that_is_kept_cannot_be_made_finer(subject, remesh, tmp_path):
    file = tmp_path / "heart.vtu"
    file.touch()
    study = changed("geometry.imported", {"file": str(file), "remesh": remesh})
    study["geometry"]["source"] = "mesh"
    study["all_inputs"] = {"finer": 20}
    study |= {"subjects": {"s": {"source": "synthetic"}}}
    study |= {"synthetic_subjects": {"s": subject | {"mesh": "finer"}}}
    if remesh:
        assert config.load(study)["synthetic_subjects"]["s"]["mesh"] == "finer"
        return
    with pytest.raises(InputError) as error:
        config.load(study)
    for key in ("all_inputs.finer", "synthetic_subjects.s.mesh"):
        assert f"{key}: an imported mesh that is kept cannot be made finer" in str(error.value)


@pytest.mark.parametrize("given", [{"finer": 1}, {"finer": 20, "anchors": 9}])
def test_a_finer_mesh_is_learnt_from_enough_simulations(given):
    with pytest.raises(InputError, match=r"all_inputs\.finer: [19] simulations .* give 10 or more"):
        config.load({"study": "few", "all_inputs": given})
    config.load({"study": "few", "all_inputs": {"finer": 10, "anchors": 10}})


def test_a_population_has_shapes_of_all_kinds():
    study = {"study": "hearts", "all_inputs": {"shapes": "population"}}
    with pytest.raises(
        InputError, match=r"all_inputs\.shapes: .* not all shape inputs are inferred"
    ):
        config.load(study)
    words = ("segment_thickness", "endo_radius", "apex", "level_end")
    shapes = dict.fromkeys(words, "inferred")
    config.load(study | {"inputs": shapes | {"wall_thickness": "fixed"}})
