"""Which hearts the emulator knows, and what is cut to what it knows."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from regional_lv.geometry import described
from regional_lv.geometry.table import read_segments
from regional_lv.hearts import file
from regional_lv.hearts.cohort import reach_of_emulator
from regional_lv.hearts.reach import OutOfReach, by_table, within
from regional_lv.inputs import space
from regional_lv.inputs.space import Inputs, sections_of


def test_a_heart_within_reach_is_cut_to_it(heart, any_heart):
    config, notes = within(heart(), any_heart.emulator, any_heart.known)
    # Of 0.08 to 10 at 8 mmHg, at 12; the prior begins at 0.1.
    assert config["parameters"]["bounds"]["C_a"] == [pytest.approx(0.12), 5.0]
    assert "C_b" not in config["parameters"]["bounds"]
    inputs = Inputs.from_config(sections_of(config))
    basal = inputs[inputs.names.index("basal_motion")]
    # 100 mm/kPa as the emulator has it, of a heart 1.2 times as long at 1.5 times the pressure.
    assert (basal.low, basal.high) == (0.0, pytest.approx(100 * 1.2 / 1.5))
    assert inputs.roles[inputs.names.index("basal_motion")].kind == "suspected"
    assert len(notes) == 2 and "C_a is cut to 0.12 to 5" in notes[0]
    # Cut once, it is within reach.
    assert within(config, any_heart.emulator, any_heart.known) == (config, [])


def thinner(table):
    table.loc[4, "wall_thickness_mm"] = 2.2


MEASURED = {"segment_thickness": {"role": "measured", "sd_mm": 1.0}}


@pytest.fixture
def by_surfaces(monkeypatch):
    """The same heart by surfaces, which its segment table describes."""

    def by_surfaces(config):
        geometry = config["geometry"]
        table = read_segments(geometry["segments"]).drop(columns="line")
        apices = geometry["endo_apex_z_mm"], geometry["epi_apex_z_mm"]
        found = described.TableOfHeart(table, *apices)
        monkeypatch.setattr(described, "of_surfaces", lambda surfaces: found)
        described._cached.cache_clear()
        files = {"endocardium": "endo.stl", "epicardium": "epi.stl"}
        surfaces = {"source": "surfaces", "segments": None, "surfaces": files}
        return config | {"geometry": geometry | surfaces}

    yield by_surfaces
    described._cached.cache_clear()


@pytest.mark.parametrize("change", [None, thinner])
def test_surfaces_are_as_near_as_the_table_that_describes_them(
    change, heart, any_heart, by_surfaces, monkeypatch
):
    config = by_surfaces(heart(change))
    monkeypatch.setattr(file, "shipped", lambda: any_heart)
    check = reach_of_emulator()
    if change is None:
        check(config)
    else:
        with pytest.raises(OutOfReach, match=r"^endo\.stl and epi\.stl: wall_thickness_5"):
            check(config)


def uneven(table):
    table.loc[6:11, "endo_radius_mm"] *= [0.6, 1.6, 0.6, 1.6, 0.6, 1.6]


def jagged(table):
    table.loc[6:11, "wall_thickness_mm"] *= [0.3, 2.0, 0.3, 2.0, 0.3, 2.0]


def turned_as_a_whole(table):
    table[["angle_from_deg", "angle_to_deg"]] += 20.0


def septum_wider(table):
    table.loc[7, "angle_to_deg"] += 8.0
    table.loc[6, "angle_from_deg"] += 8.0


def free_wall_divided_elsewhere(table):
    table.loc[6, "angle_to_deg"] += 8.0
    table.loc[11, "angle_from_deg"] += 8.0


def septum_divided_elsewhere(table):
    table.loc[[1, 7], "angle_from_deg"] += 15.0
    table.loc[[2, 8], "angle_to_deg"] += 15.0


def lower(times):
    def lower(table):
        table.loc[table["z_top_mm"] == 0, "z_bottom_mm"] *= times
        table.loc[6:11, "z_top_mm"] *= times

    return lower


@pytest.mark.parametrize(
    "change",
    [turned_as_a_whole, free_wall_divided_elsewhere, septum_divided_elsewhere, lower(1.5)],
)
def test_a_table_with_other_borders(heart, any_heart, change):
    within(heart(change), any_heart.emulator, any_heart.known)


def test_simulations_of_surfaces_have_the_inputs_of_their_table(
    heart, any_heart, by_surfaces, tmp_path
):
    config = by_surfaces(heart(inputs={"basal_motion": "suspected"} | MEASURED))
    assert by_table(heart(), tmp_path / "nowhere.csv") == heart()
    found = by_table(config, tmp_path / "described.csv")
    own, of_table = (Inputs.from_config(sections_of(each)) for each in (config, found))
    assert own.names == of_table.names and own.roles == of_table.roles
    assert {"basal_motion", "wall_thickness_17"} <= {*own.simulated.names}
    np.testing.assert_array_equal(own.nominal, of_table.nominal)
    cut, _ = within(found, any_heart.emulator, any_heart.known)
    assert cut["inputs"]["basal_motion"]["range"] == [0.0, pytest.approx(80.0)]


def test_surfaces_without_a_smooth_wall_by_their_table_are_exact(heart, by_surfaces, caplog):
    config = by_surfaces(heart(jagged, inputs=MEASURED))
    space.warn_of_exact_shape.cache_clear()  # other tests may have been warned
    assert not Inputs.from_config(sections_of(config)).of_role("measured").any()
    assert "no smooth surface goes through" in caplog.text and "counts as exact" in caplog.text


@pytest.mark.parametrize(("share", "reached"), [(1.0005, True), (1.01, False)])
def test_a_figure_may_be_rounded_beyond_the_range(share, reached, heart, any_heart):
    config = heart()
    place = any_heart.known.names.index("wall_thickness_5")
    own = read_segments(config["geometry"]["segments"])["wall_thickness_mm"][4] / 1.2
    learnt = any_heart.emulator.learnt_from.clone()
    learnt[:, place].clamp_(min=share * own)
    emulator = SimpleNamespace(learnt_from=learnt, outputs=any_heart.emulator.outputs)
    if reached:
        within(config, emulator, any_heart.known)
        return
    with pytest.raises(OutOfReach, match="wall_thickness_5 is"):
        within(config, emulator, any_heart.known)


THICKER = {
    **{"segments": "segments.csv", "wall_thickness_scale": 1.1},
    **{"endo_apex_z_mm": -1.2 * 74.4, "epi_apex_z_mm": -1.2 * 81.2},
}


@pytest.mark.parametrize(
    ("change", "sections", "message"),
    [
        (thinner, {}, "segments.csv: wall_thickness_5 is 2.2; in hearts of this length"),
        (uneven, {}, "segments.csv: endo_radius_"),
        (septum_wider, {}, "segments.csv, segment 7: the sector begins \\+8 degrees"),
        (lower(2.4), {}, "segments.csv: basal_end is 0.439; in hearts of this length"),
        (None, {"inputs": {"helix_epi": "suspected"}}, "inputs.helix_epi: the emulator has no"),
        (None, {"fibres": {"helix_endo_deg": 50}}, "fibres.helix_endo_deg: is not as in"),
        (None, {"material": {"law": "guccione"}}, "parameters.law: guccione"),
        (None, {"parameters": {"zones": "paper"}}, "parameters.zones: "),
        (None, {"geometry": THICKER}, "geometry.wall_thickness_scale: is not 1; give"),
        (
            None,
            {"loading": {"pressure_mmhg": 12, "frames": [0.5]}},
            "observables: .*0.5 is nothing",
        ),
        (
            None,
            {"supports": {"epicardium_kpa_per_mm": 0.01}, "inputs": {"C_a": "inferred"}},
            "supports.epicardium_kpa_per_mm: is not as in",
        ),
        # What a study fixes, or counts as its own: 6 mmHg at 8 mmHg, at 12.
        (
            None,
            {"loading": {"pressure_mmhg": 12, "septal_pressure_mmhg": 9.1}, "inputs": {}},
            "inputs.septal_load: 9.1 is outside of 0 to 9 mmHg, which",
        ),
        (
            None,
            {"observables": {"strain_exponent": 4}, "inputs": {"strain_measure": "suspected"}},
            "inputs.strain_measure: 4 is outside of -3 to 3, which",
        ),
    ],
)
def test_a_heart_out_of_reach(heart, any_heart, change, sections, message):
    config = heart(change, **sections)
    with pytest.raises(OutOfReach, match=message) as caught:
        within(config, any_heart.emulator, any_heart.known)
    assert re.search("regional-lv run --own", str(caught.value))
