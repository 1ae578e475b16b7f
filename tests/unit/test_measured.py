"""Measured files: round trips, and one case per kind of bad input."""

import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from regional_lv import data
from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.measured import (
    MeasuredWarning,
    import_measured,
    read_measured,
    shortcomings,
    states_noise,
    synthetic_subject,
    write_measured,
)

PARAMETERS, CHANNELS = StiffnessInputs(), Channels.of()
HEADER = "quantity,segment,value,unit"
VOLUME = "volume,,180,mL"


def strains(quantity="circumferential", value=-0.15, unit="1", segments=range(1, 17)) -> list[str]:
    return [f"{quantity},{segment},{value},{unit}" for segment in segments]


GOOD = [VOLUME, *strains(), *strains("radial", 0.4), *strains("longitudinal", -0.1)]


def write(folder: Path, rows: list[str], header: str = HEADER) -> Path:
    file = folder / "anna.csv"
    file.write_text("\n".join([header, *rows]) + "\n")
    return file


@pytest.fixture
def outputs():
    """Plausible simulated outputs (52,)."""
    return np.concatenate([[180.0], np.full(17, -0.15), np.full(17, 0.4), np.full(17, -0.1)])


def test_good_file_gives_one_row_per_channel(tmp_path):
    table = read_measured(write(tmp_path, GOOD))
    assert list(table.columns) == [
        *("output", "quantity", "place", "segment", "load_fraction", "value", "sd")
    ]
    assert (table["load_fraction"] == 1).all()
    assert len(table) == len(GOOD)
    assert set(table["output"]) <= set(CHANNELS.names)
    volume = table.iloc[0]
    assert volume["output"] == "volume_ml" and volume["value"] == 180
    assert table["segment"].isna().tolist() == [True] + [False] * 48
    assert table["sd"].isna().all()


@pytest.mark.parametrize("unit", ["%", "percent"])
def test_percent_becomes_a_fraction_and_so_does_its_sd(tmp_path, unit):
    rows = [f"{row},2" for row in strains(value=-15, unit=unit)]
    table = read_measured(write(tmp_path, ["volume,,180,mL,", *rows], f"{HEADER},sd"))
    assert table["value"].iloc[1] == pytest.approx(-0.15)
    assert table["sd"].iloc[1] == pytest.approx(0.02)
    assert np.isnan(table["sd"].iloc[0])


def test_a_fraction_may_be_called_so(tmp_path):
    table = read_measured(write(tmp_path, [VOLUME, *strains(unit="fraction")]))
    assert set(table["value"][1:]) == {-0.15}


def test_byte_order_mark_spaces_blank_lines_and_further_columns_are_read(tmp_path):
    rows = ["volume,,180 ,mL,12,", "", *(f" {row},12,3" for row in strains())]
    file = write(tmp_path, rows, f"{HEADER},frame,slice")
    file.write_text(file.read_text(), encoding="utf-8-sig")
    table = read_measured(file)
    assert len(table) == 17
    assert set(table["frame"]) == {"12"}
    assert table["slice"].iloc[1] == "3"


def test_lines_that_begin_with_a_hash_are_comments_and_still_count(tmp_path):
    file = write(tmp_path, ["# volume first, with a comma", VOLUME, "", "circumferential,1,-15,1"])
    file.write_text(f"# what was measured\n{file.read_text()}")
    with pytest.raises(InputError, match=r"anna\.csv, line 6: .*write unit %"):
        read_measured(file)


def test_template_is_a_good_file():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        table = read_measured(data.path("measured_template.csv"))
    assert tuple(table["output"]) == CHANNELS.names


def test_a_segment_that_bulges_is_allowed(tmp_path):
    """And noise on the wrong side of zero."""
    read_measured(write(tmp_path, [*GOOD, "circumferential,17,0.09,1"]))
    read_measured(write(tmp_path, [VOLUME, "circumferential,17,0.02,1", *strains("radial", 0.3)]))
    known = [f"{row},0.04" for row in [*strains(), "circumferential,17,0.2,1"]]
    read_measured(write(tmp_path, ["volume,,180,mL,2", *known], f"{HEADER},sd"))


MISTAKES = {
    # what is written after the header, the line it is found in, the remedy
    "unknown quantity": ([*GOOD, "radail,17,0.4,1"], 51, "did you mean radial?"),
    "strange quantity": ([*GOOD, "zzz,17,0.4,1"], 51, "use one of volume"),
    "percent by another word": ([VOLUME, *strains(value=-15, unit="fraction")], 3, "write unit %"),
    "unknown unit": ([VOLUME, "radial,1,0.4,mm"], 3, "convert to and write 1 or %"),
    "volume in litres by unit": (["volume,,0.18,L", *strains()], 2, "convert to and write mL"),
    "volume in litres by value": (["volume,,0.18,mL", *strains()], 2, "looks like litres; give mL"),
    "volume of an elephant": (["volume,,5000,mL", *strains()], 2, "check value and unit"),
    "volume with a segment": (["volume,1,180,mL", *strains()], 2, "leave it empty"),
    "segment 18": ([*GOOD, "radial,18,0.4,1"], 51, "add `segments: 18` to the subject"),
    "segment 19": ([*GOOD, "radial,19,0.4,1"], 51, "export one of them"),
    "segment 0": ([*GOOD, "radial,0,0.4,1"], 51, "use its number, 1 to 17"),
    "segment by name": ([*GOOD, "radial,apex,0.4,1"], 51, "use its number, 1 to 17"),
    "strain without segment": ([*GOOD, "radial,,0.4,1"], 51, "use its number, 1 to 17"),
    "twice": ([*GOOD, "radial,1,0.4,1"], 51, "line 19 already; keep one of them"),
    "volume twice": ([*GOOD, VOLUME], 51, "line 2 already; keep one of them"),
    "not a number": ([*GOOD, "radial,17,high,1"], 51, "give a number"),
    "NaN": ([*GOOD, "radial,17,nan,1"], 51, "remove the row"),
    "infinite": ([*GOOD, "radial,17,inf,1"], 51, "remove the row"),
    "empty value": ([*GOOD, "radial,17,,1"], 51, "give a number"),
    "decimal comma": ([*GOOD, 'radial,17,"0,4",1'], 51, "write decimals with a point"),
    "decimal comma, unquoted": ([*GOOD, "radial,17,0,4,1"], 51, "write decimals with a point"),
    "percent called fractions": ([VOLUME, *strains(value=-15)], 3, "write unit %"),
    "radial percent": ([VOLUME, *strains("radial", 40)], 3, "write unit %"),
    "fractions called percent": ([VOLUME, *strains(unit="%")], 3, "write unit 1"),
    "absurd percent": ([VOLUME, *strains("radial", 400, "%")], 3, "absurd; check value and unit"),
    "impossible strain": ([VOLUME, *strains(value=-0.6)], 3, "no Green strain reaches -0.5"),
    "forward circumferential": ([VOLUME, *strains(value=0.15)], 3, "-e / (1 + 2 e)"),
    "forward radial": ([VOLUME, *strains("radial", -0.2)], 3, "-e / (1 + 2 e)"),
    "forward longitudinal": ([VOLUME, *strains("longitudinal", 0.1)], 3, "-e / (1 + 2 e)"),
    "small but mostly wrong": ([VOLUME, *strains(value=0.03)], 3, "-e / (1 + 2 e)"),
    "one wrong sign": ([*GOOD, "circumferential,17,0.15,1"], 51, "correct the sign"),
    "torsion of one level": ([*GOOD, "torsion,basal,0.1,deg/mm"], 51, "torsion needs two levels"),
    "torsion of none": (
        [*GOOD, "torsion,,0.1,deg/mm"],
        51,
        "needs two levels; write one of basal-",
    ),
    "torsion between strange levels": (
        [*GOOD, "torsion,top-bottom,0.1,deg/mm"],
        51,
        "has no place `top-bottom`; write one of basal-mid, basal-apical, mid-apical",
    ),
    "torsion in degrees": (
        [*GOOD, "torsion,basal-apical,9,deg"],
        51,
        "convert to and write deg/mm",
    ),
    "absurd torsion": ([*GOOD, "torsion,basal-apical,9,deg/mm"], 51, "check value and unit"),
    "shortening with a segment": ([*GOOD, "shortening,1,0.1,1"], 51, "leave it empty"),
    "shortening in percent": ([*GOOD, "shortening,,12,1"], 51, "write unit %"),
    "lengthening": ([*GOOD, "shortening,,-0.2,1"], 51, "correct the sign"),
    "nothing": ([], None, "add one row per channel"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistake_names_file_line_and_remedy(tmp_path, name):
    rows, line, remedy = MISTAKES[name]
    file = write(tmp_path, rows)
    with pytest.raises(InputError) as error:
        read_measured(file)
    message = str(error.value)
    assert message.startswith(f"{file}, line {line}: " if line else f"{file}: ")
    assert remedy in message


MISTAKES_IN_FURTHER_COLUMNS = {
    "sd zero": ("sd", ["volume,,180,mL,0"], 2, "correct it, or leave it empty"),
    "sd negative": ("sd", ["volume,,180,mL,-2"], 2, "correct it, or leave it empty"),
    "volume known too well": (
        "sd",
        ["volume,,180,mL,0.1"],
        2,
        "give at least 0.18 mL, or leave it empty (an sd of 0.5 % then)",
    ),
    "sd not finite": ("sd", ["volume,,180,mL,nan"], 2, "remove the row"),
    "sd for some strains": (
        "sd",
        ["radial,1,0.4,1,0.02", "radial,2,0.4,1,"],
        3,
        "all of them one (known noise) or none",
    ),
    "several frames": (
        "frame",
        ["radial,1,0.4,1,15", "radial,1,0.3,1,12"],
        3,
        "keep the end-diastolic one only",
    ),
    "load fraction above one": (
        "load_fraction",
        ["radial,1,0.4,1,", "radial,2,0.3,1,1.2"],
        3,
        "load_fraction 1.2 lies outside (0, 1]",
    ),
    "load fraction zero": ("load_fraction", ["radial,1,0.4,1,0"], 2, "lies outside (0, 1]"),
    "load fraction in words": ("load_fraction", ["radial,1,0.4,1,half"], 2, "is not a number"),
    "pressure above the study's": (
        "pressure_mmhg",
        ["radial,1,0.4,1,9"],
        2,
        "pressure_mmhg 9 lies outside (0, 8 mmHg]; end diastole is 8 mmHg, the study's "
        "loading.pressure_mmhg",
    ),
    "both loads": ("load_fraction,pressure_mmhg", ["radial,1,0.4,1,1,8"], 1, "keep one of them"),
    "twice at one load": (
        "load_fraction",
        ["radial,1,0.4,1,0.5", "radial,1,0.5,1,", "radial,1,0.4,1,0.5"],
        4,
        "radial_01@0.5 is in line 2 already",
    ),
    "wrong signs at one load": (
        "load_fraction",
        [
            *(f"radial,{s},0.4,1," for s in range(1, 9)),
            *(f"radial,{s},-0.02,1,0.5" for s in range(1, 5)),
        ],
        10,
        "4 of 4 radial values have the wrong sign",
    ),
    "unknown column": ("segmnt2", ["volume,,180,mL,1"], 1, "remove it, or rename it"),
    "column twice": ("unit", ["volume,,180,mL,mL"], 1, "remove one of the two"),
}


@pytest.mark.parametrize("name", MISTAKES_IN_FURTHER_COLUMNS)
def test_mistake_in_a_further_column_names_line_and_remedy(tmp_path, name):
    column, rows, line, remedy = MISTAKES_IN_FURTHER_COLUMNS[name]
    with pytest.raises(InputError) as error:
        read_measured(write(tmp_path, rows, f"{HEADER},{column}"), pressure_mmhg=8.0)
    assert f"line {line}: " in str(error.value)
    assert remedy in str(error.value)


@pytest.mark.parametrize(
    ("header", "remedy"),
    [
        ("quantity;segment;value;unit", "save the file with commas"),
        ("quantity,segmnt,value,unit", "rename `segmnt`"),
        ("volume,,180,mL", "has to name the columns"),
    ],
)
def test_missing_column_names_the_remedy(tmp_path, header, remedy):
    with pytest.raises(InputError, match="line 1: no column") as error:
        read_measured(write(tmp_path, GOOD, header))
    assert remedy in str(error.value)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"gone\.csv: there is no such file; check the path"):
        read_measured(tmp_path / "gone.csv")


def test_file_in_another_encoding_is_named(tmp_path):
    file = tmp_path / "anna.csv"
    file.write_bytes(f"{HEADER}\n{VOLUME}\n".encode("utf-16"))  # "Unicode text" of a spreadsheet
    assert len(read_measured(file)) == 1
    file.write_bytes(f"{HEADER}\n# \u00e4\n{VOLUME}\n".encode("latin-1"))
    with pytest.raises(InputError, match=r"anna\.csv: cannot be read .*save it in UTF-8"):
        read_measured(file)


@pytest.mark.parametrize("beginning", [b"PK\x03\x04", b"\xd0\xcf\x11\xe0"])
def test_a_workbook_is_named_as_such(tmp_path, beginning):
    (tmp_path / "anna.csv").write_bytes(beginning + b"\x00\xff" * 100)
    with pytest.raises(InputError, match=r"anna\.csv: is a workbook of Excel; save it as CSV"):
        read_measured(tmp_path / "anna.csv")


def test_columns_that_a_spreadsheet_left_empty_do_not_count(tmp_path):
    plain = read_measured(write(tmp_path, GOOD))
    padded = read_measured(write(tmp_path, [f"{row},,," for row in GOOD], f"{HEADER},,,"))
    pd.testing.assert_frame_equal(plain, padded)


def test_an_sd_in_another_unit_than_its_value_is_named(tmp_path):
    rows = [VOLUME + ",", *(f"{row},2" for row in strains())]
    with pytest.raises(InputError, match=r"line 3: sd 2 of a circumferential strain .* too large"):
        read_measured(write(tmp_path, rows, f"{HEADER},sd"))


def test_strains_all_of_the_wrong_sign_are_named_so(tmp_path):
    rows = [VOLUME, *strains(), *strains("radial", -0.6)]
    with pytest.raises(InputError, match="16 of 16 radial values have the wrong sign"):
        read_measured(write(tmp_path, rows))


def test_no_volume_warns_what_that_means(tmp_path):
    with pytest.warns(MeasuredWarning, match="no volume: .*overall stiffness"):
        read_measured(write(tmp_path, strains()))


def test_fewer_channels_than_parameters_warn_what_that_means(tmp_path):
    few = write(tmp_path, [VOLUME, *strains(segments=range(1, 5))])
    with pytest.warns(MeasuredWarning, match="5 channels for 10 parameters: .*prior"):
        import_measured(few, CHANNELS, 8.0, 2.0, PARAMETERS, tmp_path / "out.csv")
    assert not shortcomings(read_measured(few), parameters=2)


# -------------------------------------------------------------------- loads and other quantities

WIDE = Channels.of([*CHANNELS.quantities, "torsion", "shortening"], load_fractions=[0.25, 0.5])


def test_rows_at_several_loads_become_channels_of_their_own(tmp_path):
    rows = [f"{VOLUME},", "volume,,150,mL,0.5", "circumferential,3,-10,%,0.5"]
    rows += ["torsion,basal-apical,0.1,deg/mm,", "shortening,,12,%,0.25"]
    table = read_measured(write(tmp_path, rows, f"{HEADER},load_fraction"), WIDE)
    assert table["output"].tolist() == [
        *("volume_ml", "volume_ml@0.5", "circumferential_03@0.5"),
        *("torsion_basal-apical", "shortening@0.25"),
    ]
    assert table["load_fraction"].tolist() == [1, 0.5, 0.5, 1, 0.25]
    assert table["segment"].isna().tolist() == [True, True, False, True, True]
    np.testing.assert_allclose(table["value"], [180, 150, -0.1, 0.1, 0.12])
    write_measured(table, tmp_path / "again.csv")
    pd.testing.assert_frame_equal(read_measured(tmp_path / "again.csv", WIDE), table)


def test_pressures_are_fractions_of_the_studys(tmp_path):
    thirds = Channels.of(load_fractions=[1 / 3])
    rows = [f"{VOLUME},8", "volume,,150,mL,2.667", "volume,,160,mL,4"]
    file = write(tmp_path, rows, f"{HEADER},pressure_mmhg")
    table = read_measured(file, pressure_mmhg=8.0)
    assert table["load_fraction"].tolist() == [1, pytest.approx(1 / 3, abs=1e-3), 0.5]
    file = write(tmp_path, rows[:2], f"{HEADER},pressure_mmhg")
    # What the study calls a third is the same as a pressure that was rounded.
    assert set(read_measured(file, thirds, 8.0)["output"]) <= set(thirds.names)
    with pytest.raises(InputError, match=r"line 2: .*give load_fraction instead"):
        read_measured(file)


def test_a_row_belongs_to_the_nearest_load(tmp_path):
    near = Channels.of(load_fractions=[0.4995, 0.5, 0.5004])
    rows = [f"{VOLUME},", "volume,,150,mL,0.5", "volume,,151,mL,0.5003", "volume,,149,mL,0.4994"]
    table = read_measured(write(tmp_path, rows, f"{HEADER},load_fraction"), near)
    assert table["load_fraction"].tolist() == [1, 0.5, 0.5004, 0.4995]


def test_frames_may_differ_between_loads(tmp_path):
    rows = ["radial,1,0.4,1,15,1", "radial,2,0.3,1,15,1", "radial,1,0.2,1,7,0.5"]
    header = f"{HEADER},frame,load_fraction"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeasuredWarning)
        assert len(read_measured(write(tmp_path, rows, header))) == 3
    with pytest.raises(InputError, match=r"line 5: several frames \(7, 6\); .*load fraction 0\.5"):
        read_measured(write(tmp_path, [*rows, "radial,2,0.2,1,6,0.5"], header))


@pytest.mark.parametrize("of_volume", ["", "1"])
def test_the_volume_is_of_end_diastole_whatever_the_frame_of_the_strains(tmp_path, of_volume):
    rows = [f"{VOLUME},{of_volume}", *(f"{row},12" for row in strains()), "radial,1,0.4,1,"]
    assert len(read_measured(write(tmp_path, rows, f"{HEADER},frame"))) == 18


@pytest.mark.parametrize(
    ("rows", "line", "remedy"),
    [
        (["torsion,basal-mid,0.1,deg/mm,"], 3, "add basal-mid to observables.places.torsion"),
        (["radial,1,0.2,1,0.75"], 3, "add 0.75 to loading.frames"),
    ],
)
def test_rows_that_the_study_does_not_observe(tmp_path, rows, line, remedy):
    file = write(tmp_path, [f"{VOLUME},", *rows], f"{HEADER},load_fraction")
    with pytest.raises(InputError, match=f"line {line}: .*no channel that the study observes") as e:
        read_measured(file, WIDE)
    assert remedy in str(e.value)
    assert len(read_measured(file)) == 2


def test_quantities_that_the_study_does_not_observe(tmp_path):
    file = write(tmp_path, [VOLUME, "torsion,basal-apical,0.1,deg/mm"])
    with pytest.raises(InputError, match=r"add torsion to observables\.quantities"):
        read_measured(file, CHANNELS)


def six_walls(segments=range(1, 19)) -> list[str]:
    """Rows of the 18-segment model in percent with sd: of wall s the radial strain is 20 + s %."""
    return [f"radial,{s},{20 + s},%,{s / 10}" for s in segments]


def test_six_apical_walls_become_the_four_segments_of_the_aha(tmp_path):
    half = [f"{row},0.5" for row in six_walls(range(13, 19))]
    rows = ["volume,,180,mL,2,", *(f"{row}," for row in six_walls()), *half]
    file = write(tmp_path, rows, f"{HEADER},sd,load_fraction")
    channels = Channels.of(load_fractions=[0.5])
    table = read_measured(file, channels, segments=18)
    names = [f"radial_{segment:02d}" for segment in range(1, 17)]
    at_half = [f"radial_{segment}@0.5" for segment in range(13, 17)]
    assert table["output"].tolist() == ["volume_ml", *names, *at_half]
    assert table["segment"].tolist()[1:] == [*range(1, 17), *range(13, 17)]
    values = table.set_index("output")["value"]
    apical = [33 + (1 + 5) / 6, 34.5, 36 + (1 - 1) / 6, 37.5]
    np.testing.assert_allclose(values[names[12:]], np.array(apical) / 100, rtol=1e-12)
    np.testing.assert_allclose(values[at_half], np.array(apical) / 100, rtol=1e-12)
    sd = table.set_index("output")["sd"]
    np.testing.assert_allclose(sd["radial_13"], np.sqrt((4 * 1.3) ** 2 + 1.4**2 + 1.8**2) / 600)
    np.testing.assert_allclose(sd["radial_16"], np.hypot(1.7, 1.8) / 200)
    assert states_noise(file, segments=18)
    # What was written inside the project has the AHA's segments.
    write_measured(table, tmp_path / "again.csv")
    pd.testing.assert_frame_equal(read_measured(tmp_path / "again.csv", channels), table)


def test_an_apical_segment_without_all_of_its_walls_is_not_measured(tmp_path):
    rows = ["volume,,180,mL,2", *six_walls([*range(1, 14), 16, 17, 18])]
    table = read_measured(write(tmp_path, rows, f"{HEADER},sd"), segments=18)
    assert table["segment"].tolist()[1:] == [*range(1, 13), 16]
    none = six_walls([1, 13, 16, 18])
    table = read_measured(write(tmp_path, [rows[0], *none], f"{HEADER},sd"), segments=18)
    assert table["output"].tolist() == ["volume_ml", "radial_01"]
    with pytest.raises(InputError, match=r"make up no segment of the AHA; add the walls beside"):
        read_measured(write(tmp_path, none[1:], f"{HEADER},sd"), segments=18)


@pytest.mark.parametrize(
    ("segments", "rows", "remedy"),
    [
        (18, strains("radial", 0.4, segments=range(1, 18)), "remove `segments` if these are"),
        (18, strains("radial", 0.4, segments=range(1, 20)), "no segment 19 in the models"),
        (16, strains("radial", 0.4, segments=range(1, 19)), "many the file counts, 17 or 18"),
    ],
)
def test_segments_of_another_model_are_refused(tmp_path, segments, rows, remedy):
    with pytest.raises(InputError, match=remedy):
        read_measured(write(tmp_path, [VOLUME, *rows]), segments=segments)


def test_sixteen_segments_are_the_aha_s_without_the_apex(tmp_path):
    file = write(tmp_path, GOOD)
    pd.testing.assert_frame_equal(read_measured(file, segments=16), read_measured(file))


def test_limits_are_those_of_the_strain_measure(tmp_path):
    strong = write(tmp_path, [VOLUME, *strains(value=-0.6)])
    for exponent, expected in ((2.0, "no Green strain reaches -0.5"), (1.7, "Seth-Hill")):
        with pytest.raises(InputError, match=expected):
            read_measured(strong, strain_exponent=exponent)
    for exponent in (1.0, 0.0, -2.0):
        assert len(read_measured(strong, strain_exponent=exponent)) == 17
    with pytest.raises(InputError, match="no nominal strain reaches -1;"):
        read_measured(write(tmp_path, [VOLUME, *strains(value=-1.1)]), strain_exponent=1.0)
    with pytest.raises(InputError, match=r"no Almansi strain reaches 0\.5;"):
        read_measured(write(tmp_path, [VOLUME, *strains("radial", 0.6)]), strain_exponent=-2.0)


def test_noise_is_known_or_not(tmp_path):
    rows = [f"{row},0.02" for row in strains()]
    assert states_noise(write(tmp_path, ["volume,,180,mL,", *rows], f"{HEADER},sd"))
    assert not states_noise(write(tmp_path, GOOD))
    rows = ["volume,,4,mL,4"]
    with pytest.raises(InputError, match="line 2"):
        states_noise(write(tmp_path, rows, f"{HEADER},pressure_mmhg"), 8.0)


def test_synthetic_subject_says_so_and_survives_a_round_trip(tmp_path, outputs):
    noise = {"strain": 0.01, "volume": 2.0}
    table = synthetic_subject(outputs, CHANNELS, noise, np.zeros(52))
    assert tuple(table["output"]) == CHANNELS.names
    assert table["sd"].tolist() == [2.0] + [0.01] * 51
    write_measured(table, tmp_path / "anna.csv")
    pd.testing.assert_frame_equal(read_measured(tmp_path / "anna.csv"), table)
    assert set(pd.read_csv(tmp_path / "anna.csv")["source"]) == {"synthetic"}


def test_noise_has_the_asked_size(outputs):
    noise = {"strain": 0.01, "volume": 2.0}
    table = synthetic_subject(outputs, CHANNELS, noise, np.arange(52))
    sd = np.array([2.0] + [0.01] * 51)
    np.testing.assert_allclose(table["value"] - outputs, sd * np.arange(52), atol=1e-12)
    assert table["sd"].tolist() == sd.tolist()


def test_what_has_no_noise_is_not_measured(outputs):
    table = synthetic_subject(outputs, CHANNELS, {"volume": 2.0}, np.zeros(52))
    assert table["output"].tolist() == ["volume_ml"]


def test_synthetic_subject_at_several_loads(tmp_path):
    noise = {"strain": 0.01, "volume": 2.0, "torsion": 0.03, "shortening": 0.02}
    values = [180.0, *[-0.15] * 17, *[0.4] * 17, *[-0.1] * 17, 0.1, 0.15]
    table = synthetic_subject(np.array(values * 3), WIDE, noise, np.zeros(3 * 54))
    assert tuple(table["output"]) == WIDE.names
    assert table["sd"].tolist() == [2.0, *[0.01] * 51, 0.03, 0.02] * 3
    write_measured(table, tmp_path / "anna.csv")
    pd.testing.assert_frame_equal(read_measured(tmp_path / "anna.csv", WIDE), table)
