"""The sections of the configuration, and what is said of a key that they refuse."""

import pytest

from regional_lv import config
from regional_lv.config.docs import describe
from regional_lv.config.section import Section
from regional_lv.errors import InputError
from tests.unit.configurations import changed, refused


def test_sections_are_closed_and_documented():
    # What a plugin adds there has no field of its own; the registries are asked.
    for_plugins = {"Emulators", "OfPlugin", "Loading", "Supports", "Noise", "BenchmarkNoise"}
    for_plugins |= {"ScenarioNoise", "Role"}

    def below(section):
        return [section, *(each for sub in section.__subclasses__() for each in below(sub))]

    for section in below(Section):
        assert section.__doc__, section
        is_open = section.model_config["extra"] == "allow"
        assert is_open == (section.__name__ in for_plugins), section
    # Absent means that there is no such effect, constant or segment.
    for key in describe():
        assert key.text, key
        assert key.reruns, key
        assert key.default != "none" or key.path.endswith(".<name>"), key


MISTAKES = [
    # what is written, what the message names, the remedy it gives
    (changed("subjects.a", {"source": "file", "file": "a.csv"}), "a.file: unknown", "measured"),
    (changed("criticism", None), "criticism: holds nothing", "remove it for their defaults"),
    (changed("nuts.chain", 4), "nuts.chain", "did you mean `nuts.chains`"),
    (changed("nutz", {}), "nutz", "did you mean `nuts`"),
    (changed("batch_size", 4), "batch_size", "did you mean `simulations.batch_size`"),
    (changed("emulators.exact_gp.kernal", "rq"), "exact_gp.kernal", "`emulators.exact_gp.kernel`"),
    (changed("mesh.zzz", 1), "mesh.zzz", "allowed here: circumferential"),
    ({"seed": 1}, "study: missing", "give it"),
    (changed("study", "my study"), "study", "use letters, digits and underscores"),
    (changed("seed", -1), "seed", "give at least 0"),
    (changed("seed", "x"), "seed", "a whole number"),
    (changed("nuts.draws", 80.5), "nuts.draws", "a whole number"),
    (changed("nuts.target_accept", 1.0), "nuts.target_accept", "give less than 1"),
    (changed("design", None), "design: holds nothing", "give its keys"),
    (changed("design.lower", 0), "design.lower", "give more than 0"),
    (changed("design.test", True), "design.test", "a whole number"),
    (changed("simulations.batch_size", 0), "simulations.batch_size", "give at least 1"),
    (changed("nuts.cases_per_batch", 0), "nuts.cases_per_batch", "give at least 1"),
    (changed("mesh.circumferential", 20), "mesh.circumferential", "one of 16, 24, 32, 40, 48"),
    (changed("mesh.apex", 0), "mesh.apex", "give at least 1"),
    (changed("simulations.source", "dolfin"), "'dolfin' is not offered", "did you mean dolfinx?"),
    (changed("fibres.helix_endo_deg", 95), "fibres.helix_endo_deg", "give at most 90"),
    (changed("loading.base", "fixed"), "loading.base: has moved", "use `supports.base`"),
    (changed("material.a_f_kpa", 1), "a_f_kpa: has moved", "`material.constants.a_f_kpa`"),
    (changed("material.factor_b", 1), "factor_b: has moved", "`material.reference.C_b`"),
    (changed("observables.nominal_share", 1), "has moved", "`observables.strain_exponent`"),
    (
        changed("supports.base.radial", "hold"),
        "supports.base.radial: 'hold'",
        "write `held`, `free`",
    ),
    (changed("supports.base.radial", -1), "supports.base.radial", "give at least 0"),
    (changed("loading.presure_mmhg", "x"), "loading.presure", "`loading.pressure_mmhg`"),
    (changed("loading.septal_pressure_mmhg", -1), "loading.septal_pressure_mmhg", "at least 0"),
    (
        changed("parameters.zones", "papr"),
        "parameters.zones: 'papr'",
        "write `paper`, `segments` or",
    ),
    (changed("parameters.zones", {"my zone": [1]}), "zones.my zone", "use letters, digits"),
    (changed("parameters.factors", []), "parameters.factors", "name at least one"),
    (changed("parameters.bounds", {"C_a": [1]}), "bounds.C_a: [1] holds 1", "give 2"),
    (changed("observables.quantities", []), "observables.quantities", "name at least one"),
    (changed("observables.layer", [0.0, 1.2]), "observables.layer.1", "give at most 1"),
    (changed("observables.layer", [0.0]), "observables.layer", "give 2"),
    (changed("observables.scale", {"radial": 0}), "scale.radial", "give more than 0"),
    (changed("emulators.nmaes", ["dnn"]), "emulators.nmaes", "did you mean `emulators.names`"),
    (changed("loading.frames", [0.5, 1.0]), "loading.frames.1", "give less than 1"),
    (changed("loading.frames", 0.5), "loading.frames", "a list"),
    (
        changed("emulators.exact_gp.nugget", "1e-8"),
        "exact_gp.nugget",
        "write it as 1e-08, without quotes",
    ),
    (changed("seed", "1_000"), "seed: '1_000' is not a whole number", "write it as 1000,"),
    (changed("geometry.endo_apex_z_mm", "\u221274.5"), "endo_apex_z_mm", "write it as -74.5,"),
    (changed("loading.pressure_mmhg", "1:30"), "pressure_mmhg: '1:30'", "give the number alone"),
    (changed("subjects.anna", {"source": "curves", "volume_ml": "150"}), "ml: '150'", "as 150,"),
    (changed("evaluation", "no"), "evaluation: 'no' is not true or false", "give that instead"),
    (changed("loading.pressure_mmhg", "eight"), "pressure_mmhg", "give the number alone"),
    (changed("loading.pressure_mmhg", "10 mmHg"), "pressure_mmhg", "give the number alone"),
    (changed("pressure_mmhg", 8), "pressure_mmhg", "did you mean `loading.pressure_mmhg`"),
    (changed("emulators.names", []), "emulators.names", "name at least one"),
    (changed("test_posteriors.cases", "most"), "test_posteriors.cases", "`all`"),
    (changed("emulators.shortlist.names", []), "emulators.shortlist.names", "name at least one"),
    (changed("scenarios.sets.mild", {"mu": 2}), "mild.kind: missing", "give it"),
    (changed("scenarios.noise.volume", 0), "scenarios.noise.volume", "give more than 0"),
    (changed("subjects.7up", {"source": "synthetic"}), "subjects.7up", "begin with a letter"),
    (changed("subjects", {1: {"source": "synthetic"}}), "subjects.1", "begin with a letter"),
    (changed("subjects.anna", {}), "subjects.anna.source", "missing; give it"),
]


@pytest.mark.parametrize(("given", "key", "remedy"), MISTAKES, ids=[m[1] for m in MISTAKES])
def test_mistake_is_named_with_its_remedy(given, key, remedy):
    refused(given, key, remedy)


def test_empty_pressure_says_what_it_is_and_what_a_wrong_one_does():
    with pytest.raises(InputError) as error:
        config.load(changed("loading.pressure_mmhg", None))
    (line,) = str(error.value).splitlines()
    assert line.startswith("config: loading.pressure_mmhg: empty; fill in the end-diastolic")
    assert "every C_a come out 10 % too high" in line
