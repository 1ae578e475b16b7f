"""The catalogue of inputs, their roles in a configuration, and closed forms."""

import numpy as np
import pandas as pd
import pytest
import torch

from regional_lv import config
from regional_lv.channels import Channels
from regional_lv.data import path as packaged
from regional_lv.errors import InputError
from regional_lv.geometry.table import read_segments
from regional_lv.inputs import space
from regional_lv.inputs.base import KeyInput
from regional_lv.inputs.catalogue import INPUTS
from regional_lv.inputs.evaluation import AllInputs
from regional_lv.inputs.model import model_of
from regional_lv.inputs.shape import is_of_table
from regional_lv.inputs.space import Inputs, catalogue, sections_of_stiffness, stencil
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.registry import temporary
from regional_lv.testing import InputContract
from regional_lv.testing.inputs import same


def loaded(**sections):
    return config.load({"study": "inputs", "inputs": {}} | sections)


@pytest.fixture(scope="module")
def model():
    return model_of(loaded())


@pytest.fixture(scope="module")
def every(model):
    return Inputs(model, catalogue(model))


class TestRegistered(InputContract):
    @pytest.fixture(scope="class", params=INPUTS)
    @classmethod
    def kind(cls, request):
        return INPUTS[request.param]


def test_causes_are_what_a_criticism_doubts():
    found = Inputs.from_config(loaded(inputs={"causes": "suspected", "anisotropy": "fixed"}))
    suspected = found.subset(found.of_role("suspected"))
    assert {"basal_motion", "focal_scar_17", "wall_thickness", "heavy_tails"} <= {*suspected.names}
    assert "anisotropy" not in found.names
    assert not any(name.startswith(("wall_thickness_", "endo_radius_")) for name in found.names)
    # The places of a scar are one cause.
    assert len({each.cause for each in suspected}) == len(suspected) - 16


def test_sds_of_the_segment_table(tmp_path):
    """They make inputs measured; those of the configuration count for what they name."""
    table = pd.read_csv(packaged("volunteer_segments.csv"))
    table["wall_thickness_sd_mm"] = [1.5, *[np.nan] * 15, 0.5]
    path = tmp_path / "heart.csv"
    table.to_csv(path, index=False)

    def roles(**inputs):
        found = Inputs.from_config(loaded(geometry={"segments": str(path)}, inputs=inputs))
        return {n: r for n, r in zip(found.names, found.roles, strict=True) if r.sd is not None}

    assert {name: role.sd for name, role in roles().items()} == {
        **{"wall_thickness_1": 1.5, "wall_thickness_17": 0.5}
    }
    every = roles(segment_thickness={"role": "measured", "sd_mm": 1.0})
    assert len(every) == 17 and every["wall_thickness_1"].sd == 1.5
    assert every["wall_thickness_2"].sd == 1.0
    named = roles(wall_thickness_1={"role": "measured", "sd_mm": 1.0}, wall_thickness_17="fixed")
    assert {name: role.sd for name, role in named.items()} == {"wall_thickness_1": 1.0}
    table.loc[3, "wall_thickness_sd_mm"] = -1
    table.to_csv(path, index=False)
    with pytest.raises(InputError, match=r"line 5: wall_thickness_sd_mm is -1.0; give a number"):
        roles()


def test_a_shape_without_a_table_counts_as_exact(tmp_path, caplog):
    (tmp_path / "heart.vtu").touch()
    geometry = {"source": "mesh", "imported": {"file": str(tmp_path / "heart.vtu")}}
    given = {"segment_thickness": {"role": "measured", "sd_mm": 1.0}}
    space.warn_of_exact_shape.cache_clear()  # other tests may have been warned
    found, _ = (Inputs.from_config(loaded(geometry=geometry, inputs=given)) for _ in range(2))
    assert found.of_role("inferred").all()
    assert "no segment table describes the heart" in caplog.text and "heart.vtu" in caplog.text
    assert caplog.text.count("counts as exact") == 1


def test_segments_are_places_of_one_cause(every):
    scars = [each for each in every if each.cause == "focal_scar"]
    assert [each.place for each in scars] == [str(segment) for segment in range(1, 18)]
    assert all(each.place or each.cause == each.name for each in every)


def test_nominal_values_are_the_model_as_it_is(model, every):
    kept = every.subset(each.nominal is not None for each in every)
    assert len(kept) == len(every) - 10
    found = kept.model(kept.nominal)
    assert same(
        {k: v for k, v in found["geometry"].items() if k != "table"},
        {k: v for k, v in model["geometry"].items() if k != "table"},
    )
    for section in ("factors", "material", "fibres", "loading", "supports", "observables"):
        assert same(found[section], {**model[section]}), section


def test_models_of_other_shapes_are_not_the_same():
    assert same({"a": np.ones(3)}, {"a": [1.0, 1.0, 1.0 + 1e-14]})
    assert not same(np.ones(1), np.ones(3)) and not same(np.ones(2), np.ones(3))


@pytest.mark.parametrize(
    ("section", "roles"),
    [
        ({}, {"C_a_anterior": ("inferred", None)}),
        ({"septal_load": "suspected"}, {"septal_load": ("suspected", None)}),
        # The unit says which: the whole wall has a scale, a segment millimetres.
        ({"wall_thickness": "suspected"}, {"wall_thickness": ("suspected", None)}),
        (
            {"wall_thickness": {"role": "measured", "sd_mm": 1.0}},
            {"wall_thickness_1": ("measured", 1.0), "wall_thickness_17": ("measured", 1.0)},
        ),
        (
            {
                "shape": {"role": "measured", "sd_mm": 2.0},
                "wall_thickness_3": "inferred",
                "wall_thickness": {"role": "measured", "sd_mm": 1.0},
            },
            {
                "wall_thickness_2": ("measured", 1.0),
                "wall_thickness_3": ("inferred", None),
                "endo_radius_3": ("measured", 2.0),
                "length": ("measured", 2.0),
            },
        ),
        ({"focal_scar": "suspected"}, {"focal_scar_9": ("suspected", None)}),
        ({"material": "fixed"}, {"C_a_apical": ("inferred", None)}),
    ],
)
def test_roles(section, roles):
    inputs = Inputs.from_config(loaded(inputs=section))
    found = dict(zip(inputs.names, inputs.roles, strict=True))
    for name, (kind, sd) in roles.items():
        assert (found[name].kind, found[name].sd) == (kind, sd)


def test_a_standard_deviation_of_nothing_is_fixed():
    inputs = Inputs.from_config(loaded(inputs={"septal_load": {"role": "measured", "sd_mmhg": 0}}))
    assert inputs.names == Inputs.from_config(loaded()).names


@pytest.mark.parametrize(
    "section",
    [
        {},
        {"septal_load": "suspected", "wall_thickness": {"role": "measured", "sd_mm": 1}},
        {"C_b_apical": {"role": "measured", "value": 1.2, "sd": 0.1}},
    ],
)
def test_the_stiffness_alone(section):
    """As an emulator of nothing else has it, whatever the study's roles are."""
    alone = Inputs.from_config(sections_of_stiffness(loaded(inputs=section)))
    assert alone.names == StiffnessInputs().names and alone.of_role("inferred").all()


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ({"septal_lod": "suspected"}, "did you mean septal_load"),
        ({"septal_load": "wrong"}, "'wrong' is not possible; write `inferred`, `measured`"),
        ({"heavy_tails": "inferred"}, "inputs.heavy_tails: cannot be inferred"),
        ({"fibres": "inferred"}, "inputs.fibre_rotation: moves the same thing as helix_endo"),
        ({"material": "inferred"}, "moves the same thing as focal_scar"),
        ({"end_diastolic_pressure": "inferred"}, "moves the same thing as C_a_anterior"),
        ({"C_a_septal": {"role": "measured", "sd": 0.1}}, "no nominal value"),
        ({"C_a_septal": "suspected"}, "no value in the model as it is"),
        ({"C_a_septal": "fixed"}, "cannot be fixed; .*name the others in `parameters.factors`"),
        ({"C_b": {"role": "measured", "sd": 0, "value": 1}}, "give a standard deviation above 0"),
        ({"septal_load": {"role": "measured", "sd_mm": 1}}, "write sd_mmhg"),
        ({"septal_load": "measured"}, "with no standard deviation; give one, sd_mmhg"),
        ({"septal_load": {"role": "measured", "sd_mmhg": 1, "value": 50}}, "outside the range"),
        ({"helix_epi": {"role": "suspected", "sd_deg": 1}}, "only what is measured"),
        (
            {"septal_load": {"role": "fixed", "value": 3}},
            "change it there .section `loading`",
        ),
        ({"length": {"role": "measured", "sd_mm": 0, "value": 80}}, "section `geometry`"),
        ({"radial_scale": {"role": "fixed", "value": 0.8}}, "give radial_scale another role"),
    ],
)
def test_roles_that_cannot_be(section, words):
    with pytest.raises(InputError, match=words):
        loaded(inputs=section)


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        (
            {"material": {"law": "guccione"}, "inputs": {"sheet_angle": "suspected"}},
            "the law guccione has no sheets",
        ),
        (
            {"material": {"law": "guccione"}, "inputs": {"anisotropy": "suspected"}},
            "no constant a_f_kpa",
        ),
        (
            {
                "supports": {"base": {"radial": "free", "circumferential": "held"}},
                "inputs": {"basal_motion": "suspected"},
            },
            "radial is free",
        ),
        (
            {
                "supports": {"epicardium_kpa_per_mm": 0.05},
                "inputs": {"end_diastolic_pressure": "suspected"},
            },
            "exact only if epicardial_support goes along",
        ),
    ],
)
def test_inputs_that_a_study_does_not_have(sections, words):
    with pytest.raises(InputError, match=words):
        loaded(**sections)


def test_a_range_in_place_of_the_plausible_one():
    given = {"segment_thickness": {"role": "inferred", "range": [3, 25]}}
    given |= {"basal_motion": {"role": "suspected", "range": [0, 30]}}
    inputs = Inputs.from_config(loaded(inputs=given))
    ends = dict(zip(inputs.names, zip(inputs.lower, inputs.upper, strict=True), strict=True))
    assert ends["wall_thickness_3"] == (3.0, 25.0) and ends["basal_motion"] == (0.0, 30.0)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ([25, 3], "25 is not below 3"),
        ([0, 25], "is above 0"),
        ([3, 7], "is 12.43 mm, which 3 to 7 leaves out"),
    ],
)
def test_a_range_that_is_none(limits, words):
    with pytest.raises(InputError, match=rf"inputs\.segment_thickness\.range: .*{words}"):
        loaded(inputs={"segment_thickness": {"role": "inferred", "range": limits}})


@pytest.mark.parametrize(
    ("name", "limits"),
    [
        ("mixed_frames", [0, 1.5]),
        ("heavy_tails", [-0.2, 0.4]),
        ("endocardial_sampling", [-1, 1]),
        ("compressibility", [-0.1, 0.05]),
        ("basal_motion", [-2, 5]),
    ],
)
def test_a_range_of_what_cannot_be(name, limits):
    with pytest.raises(InputError, match=rf"inputs\.{name}\.range: {name} can be .* at all"):
        loaded(inputs={name: {"role": "suspected", "range": limits}})


def test_a_value_within_a_range_of_its_own():
    wide = {"role": "suspected", "value": 7, "range": [0, 12]}
    inputs = Inputs.from_config(loaded(inputs={"septal_load": wide}))
    assert inputs.nominal[inputs.names.index("septal_load")] == 7.0
    with pytest.raises(InputError, match=r"value: 7 is outside .*or give its `range`"):
        loaded(inputs={"septal_load": {"role": "suspected", "value": 7}})


def test_a_tables_sd_leaves_range_and_fixed_words_as_they_are(tmp_path):
    table = read_segments("volunteer").drop(columns="line").assign(wall_thickness_sd_mm=1.0)
    table.to_csv(tmp_path / "segments.csv", index=False)
    geometry = {"segments": str(tmp_path / "segments.csv")}
    word = {"role": "measured", "sd_mm": 2.0, "range": [5, 20]}
    inputs = Inputs.from_config(
        loaded(geometry=geometry, inputs={"segment_thickness": word, "causes": "fixed"})
    )
    role = inputs.roles[inputs.names.index("wall_thickness_1")]
    assert (role.kind, role.sd, role.range) == ("measured", 1.0, (5.0, 20.0))
    fixed = Inputs.from_config(loaded(geometry=geometry, inputs={"shape": "fixed"}))
    assert "wall_thickness_1" not in fixed.names


def test_words_of_a_segment_table():
    assert is_of_table("wall_thickness", {"role": "measured", "sd_mm": 1.0})
    assert is_of_table("wall_thickness_3", "suspected") and is_of_table("shape", "suspected")
    assert not is_of_table("wall_thickness", "suspected")


def test_an_input_of_a_plugin():
    with temporary():

        @INPUTS.add
        class Rotation(KeyInput):
            name, family, unit = "rotation_of_fibres", "fibres", "deg"
            path = ("fibres", "rotation_deg")
            parameter = "rotation"
            low, high = -10.0, 10.0
            description = source = "of a test"

        class Absent(Rotation):
            name, path = "of_a_support", ("supports", "of_a_plugin")

        INPUTS.add(Absent)
        inputs = Inputs.from_config(loaded(inputs={"rotation_of_fibres": "suspected"}))
        assert inputs.names[-1] == "rotation_of_fibres"
        x = np.append(np.ones(10), 4.0)
        assert inputs.model(x)["fibres"]["rotation_deg"] == 4.0
        with pytest.raises(InputError, match=r"no supports\.of_a_plugin"):
            loaded(inputs={"of_a_support": "suspected"})


@pytest.mark.parametrize("here", [0.0, 0.5, 1.0])
def test_differences_stay_in_the_range(here):
    points = stencil(here, 0.1, 0.0, 1.0)
    assert all(0 <= here + offset <= 1 for offset, _ in points)
    # Exact for parabolas.
    slope = sum(weight * (3 * (here + offset) ** 2 + 2) for offset, weight in points)
    assert slope == pytest.approx(6 * here, abs=1e-12)


def test_closed_forms_and_their_derivatives(model):
    """Of a made-up simulator whose outputs depend on stress over load and springs."""
    names = ("C_a_anterior", "C_b_septal", "epicardial_support", "basal_motion", "helix_epi")
    names += ("helix_endo", "fibre_rotation")
    forms = ("end_diastolic_pressure", "mixed_frames", "radial_scale", "size")
    every = Inputs(model, catalogue(model))
    inputs = every.subset(name in names + forms for name in every.names)
    inner = inputs.simulated
    assert "fibre_rotation" not in inner.names and len(inner) == 6
    channels = Channels.of(["volume", "radial", "circumferential"])
    rng = np.random.default_rng(0)
    weights = torch.as_tensor(rng.normal(size=(len(channels), len(inner))))

    def simulate(x):
        phase = inner.coordinates.scaled(x) @ weights.T
        by_x = torch.cos(phase)[..., None] * weights / inner.coordinates.slope(x)[:, None]
        return torch.sin(phase) + 2, by_x

    at = {"C_a_anterior": 1.3, "epicardial_support": 0.1, "basal_motion": 2.0, "helix_epi": 5.0}
    at |= {"end_diastolic_pressure": 10.0, "mixed_frames": 0.2, "radial_scale": 0.8, "size": 1.1}
    at |= {"fibre_rotation": 4.0}
    x = [at.get(name, v) for name, v in zip(inputs.names, inputs.nominal, strict=True)]
    x = torch.tensor([x, inputs.nominal], dtype=torch.float64)
    outputs = AllInputs(inputs, channels)
    values, slopes = outputs(simulate, x)
    # By hand: the volume at 10 / 8 of the load and 1.1 times the size.
    load = 10 / 8
    scaled = {"C_a_anterior": 1.3 / load, "epicardial_support": 0.1 * 1.1 / load}
    scaled |= {"basal_motion": 2.0 * load / 1.1, "helix_endo": 4.0, "helix_epi": 1.0}
    there = dict(zip(inputs.names, x[0].tolist(), strict=True)) | scaled
    expected = simulate(torch.tensor([[there[name] for name in inner.names]]).double())[0][0]
    volume, radial = (channels.of_quantity(name) for name in ("volume", "radial"))
    torch.testing.assert_close(values[0][volume], expected[volume] * 1.1**3)
    torch.testing.assert_close(outputs.factor(x)[0][radial], torch.full((17,), 0.8).double())
    # Nothing is changed where everything is at rest.
    rest = simulate(x[1:, torch.as_tensor(inputs.are_simulated)])[0]
    torch.testing.assert_close(values[1:], rest)
    z, h = inputs.coordinates.scaled(x), 1e-6
    for k in range(len(inputs)):
        step = h * torch.eye(len(inputs)).double()[k]
        sides = [outputs(simulate, inputs.coordinates.natural(z + s * step))[0] for s in (1, -1)]
        torch.testing.assert_close(
            (sides[0] - sides[1]) / (2 * h), slopes[..., k], atol=1e-7, rtol=0
        )


def test_a_direction_is_carried_by_what_it_moves(model):
    """The model with the direction is that of its parts, moved."""
    every = Inputs(model, catalogue(model))
    for name, value in (("fibre_rotation", 7.0), ("wall_thickness", 1.2)):
        direction = every[every.names.index(name)]
        x = every.nominal.copy()
        x[every.names.index(name)] = value
        parts = every.nominal.copy()
        for k, each in enumerate(every):
            if each.name in direction.moves:
                parts[k], *_ = direction.carry(each, parts[k], value)
        one, other = every.model(x), every.model(parts)
        if name == "fibre_rotation":
            for angles in ("helix_endo_deg", "helix_epi_deg"):
                assert one["fibres"][angles] == other["fibres"][angles]
        else:
            shapes = one["geometry"], other["geometry"]
            scaled = [g["wall_thickness_mm"] * g["wall_thickness_scale"] for g in shapes]
            np.testing.assert_allclose(scaled[0], scaled[1], rtol=1e-12)


def test_models_beside_are_those_of_other_values(every):
    """Although only one section of them is made again."""
    inputs = every.simulated
    rng = np.random.default_rng(4)
    space = inputs.coordinates
    ends = space.scaled(np.stack([inputs.lower, inputs.upper]))
    z = ends[0] + rng.uniform(0.2, 0.8, len(inputs)) * (ends[1] - ends[0])
    for k, sides in inputs.beside(space.natural(z), range(len(inputs))):
        step = inputs[k].step * (ends[1, k] - ends[0, k])
        assert sum(weight for _, weight in sides) == pytest.approx(0, abs=1e-9 / step)
        for offset, (model, _) in zip((step, -step), sides, strict=True):
            there = z.copy()
            there[k] += offset
            assert same(dict(model), dict(inputs.model(space.natural(there)))), inputs[k].name
