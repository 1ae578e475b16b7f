"""Measured files: round trips, the published volunteer, and one case per kind of bad input."""

import json
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from regional_lv import aha
from regional_lv.errors import InputError
from regional_lv.measured import (
    MeasuredWarning,
    published_simulation,
    published_volunteer,
    read_measured,
    synthetic_subject,
    write_measured,
    write_truth,
)

ROOT = Path(__file__).resolve().parents[2]
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
    assert list(table.columns) == ["output", "quantity", "segment", "value", "sd"]
    assert len(table) == len(GOOD)
    assert set(table["output"]) <= set(aha.OUTPUTS)
    volume = table.iloc[0]
    assert volume["output"] == "volume_ml" and volume["value"] == 180
    assert table["segment"].isna().tolist() == [True] + [False] * 48
    assert table["sd"].isna().all()


def test_percent_becomes_a_fraction_and_so_does_its_sd(tmp_path):
    rows = [f"{row},2" for row in strains(value=-15, unit="%")]
    table = read_measured(write(tmp_path, ["volume,,180,mL,", *rows], f"{HEADER},sd"))
    assert table["value"].iloc[1] == pytest.approx(-0.15)
    assert table["sd"].iloc[1] == pytest.approx(0.02)
    assert np.isnan(table["sd"].iloc[0])


def test_byte_order_mark_spaces_blank_lines_and_further_columns_are_read(tmp_path):
    rows = ["volume,,180 ,mL,12,", "", *(f" {row},12,3" for row in strains())]
    file = write(tmp_path, rows, f"{HEADER},frame,slice")
    file.write_text(file.read_text(), encoding="utf-8-sig")
    table = read_measured(file)
    assert len(table) == 17
    assert set(table["frame"]) == {"12"}
    assert table["slice"].iloc[1] == "3"


def test_template_is_a_good_file():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        table = read_measured(ROOT / "resources" / "measured_template.csv")
    assert tuple(table["output"]) == aha.OUTPUTS


def test_small_noise_on_the_wrong_side_of_zero_is_allowed(tmp_path):
    read_measured(write(tmp_path, [*GOOD, "circumferential,17,0.04,1"]))
    read_measured(write(tmp_path, [VOLUME, "circumferential,17,0.02,1", *strains("radial", 0.3)]))
    known = [f"{row},0.04" for row in [*strains(), "circumferential,17,0.1,1"]]
    read_measured(write(tmp_path, ["volume,,180,mL,2", *known], f"{HEADER},sd"))


MISTAKES = {
    # what is written after the header, the line it is found in, the remedy
    "unknown quantity": ([*GOOD, "radail,17,0.4,1"], 51, "did you mean radial?"),
    "strange quantity": ([*GOOD, "torsion,17,0.4,1"], 51, "use one of volume"),
    "unknown unit": ([VOLUME, "radial,1,0.4,mm"], 3, "convert to and write 1 or %"),
    "volume in litres by unit": (["volume,,0.18,L", *strains()], 2, "convert to and write mL"),
    "volume in litres by value": (["volume,,0.18,mL", *strains()], 2, "looks like litres; give mL"),
    "volume of an elephant": (["volume,,5000,mL", *strains()], 2, "check value and unit"),
    "volume with a segment": (["volume,1,180,mL", *strains()], 2, "leave it empty"),
    "segment 18": ([*GOOD, "radial,18,0.4,1"], 51, "use its number, 1 to 17"),
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
    "unknown column": ("segmnt2", ["volume,,180,mL,1"], 1, "remove it, or rename it"),
    "column twice": ("unit", ["volume,,180,mL,mL"], 1, "remove it, or rename it"),
}


@pytest.mark.parametrize("name", MISTAKES_IN_FURTHER_COLUMNS)
def test_mistake_in_a_further_column_names_line_and_remedy(tmp_path, name):
    column, rows, line, remedy = MISTAKES_IN_FURTHER_COLUMNS[name]
    with pytest.raises(InputError) as error:
        read_measured(write(tmp_path, rows, f"{HEADER},{column}"))
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
    with pytest.raises(InputError, match=r"gone\.csv: cannot be read .*check path"):
        read_measured(tmp_path / "gone.csv")


def test_file_in_another_encoding_is_named(tmp_path):
    file = tmp_path / "anna.csv"
    file.write_bytes(f"{HEADER}\n{VOLUME}\n".encode("utf-16"))
    with pytest.raises(InputError, match=r"anna\.csv: cannot be read .*encoding"):
        read_measured(file)


def test_no_volume_warns_what_that_means(tmp_path):
    with pytest.warns(MeasuredWarning, match="no volume: .*overall stiffness"):
        read_measured(write(tmp_path, strains()))


def test_fewer_channels_than_parameters_warn_what_that_means(tmp_path):
    with pytest.warns(MeasuredWarning, match="5 channels for 10 parameters: .*prior"):
        read_measured(write(tmp_path, [VOLUME, *strains(segments=range(1, 5))]))


def test_volunteer_gets_official_segment_numbers(tmp_path):
    """Columns of the published row carry their own index, so that their place shows."""
    circumferential = -0.1 - np.arange(1, 17) / 1000
    row = [181.0, *circumferential, *(-circumferential)]
    file = tmp_path / "ACase.csv"
    file.write_text(",".join(map(str, row)) + "\n")
    table = published_volunteer(file).set_index("output")
    assert len(table) == 33
    assert table.loc["volume_ml", "value"] == 181.0
    # Published order: basal inferoseptal (AHA 3) comes first, mid anterior (7) ninth, apical
    # inferior (15) last.
    for segment, place in ((3, 1), (7, 9), (15, 16), (1, 3)):
        value = table.loc[f"circumferential_{segment:02d}", "value"]
        assert value == pytest.approx(-0.1 - place / 1000)
        assert table.loc[f"radial_{segment:02d}", "value"] == pytest.approx(-value)
    assert not [name for name in table.index if name.endswith("17")]


def test_volunteer_of_another_shape_is_refused(tmp_path):
    file = tmp_path / "ACase.csv"
    file.write_text("181.0,-0.1\n")
    with pytest.raises(InputError, match=r"shape \(1, 2\) instead of \(1, 33\); fetch it again"):
        published_volunteer(file)


def volunteer_slices(folder: Path) -> tuple[Path, list[Path]]:
    """A volunteer, and slices n = 1-5 whose strain in frame k and sector j is n + k / 10 + j / 100
    (circumferential: -)."""
    case = folder / "ACase.csv"
    case.write_text(",".join(["180.9", *["-0.15"] * 16, *["0.4"] * 16]))
    slices = []
    for n in range(1, 6):
        rows = [[n + k / 10 + j / 100 for j in range(6)] for k in range(5)]
        lines = [",".join(f"{v}" for v in [*(-value for value in row), *row]) for row in rows]
        slices.append(folder / f"slice{n}.csv")
        slices[-1].write_text("\n".join(["names", *lines]) + "\n")
    return case, slices


def test_volunteer_of_one_frame_is_the_mean_of_the_slices_at_each_level(tmp_path):
    case, slices = volunteer_slices(tmp_path)
    whole = published_volunteer(case, slices, 2)
    assert whole["source"].unique().tolist() == ["published volunteer, frame 2"]
    table = whole.set_index("output")["value"]
    assert len(table) == 33 and table["volume_ml"] == 180.9
    # AHA 1 is the third sector, 8 the second; apical septal (14) joins the first two.
    expected = {1: 1.5 + 0.2 + 0.02, 8: 3.5 + 0.2 + 0.01, 14: 5 + 0.2 + 0.005, 15: 5 + 0.2 + 0.05}
    for segment, strain in expected.items():
        assert table[f"radial_{segment:02d}"] == pytest.approx(strain)
        assert table[f"circumferential_{segment:02d}"] == pytest.approx(-strain)


def test_volunteer_of_chosen_slices_and_of_extrema(tmp_path):
    table = published_volunteer(*volunteer_slices(tmp_path), "extrema", [2, 3, 5])
    values = table.set_index("output")["value"]
    assert values["radial_03"] == pytest.approx(2 + 0.4)
    assert values["circumferential_09"] == pytest.approx(-(3 + 0.4))
    assert table["source"].unique().tolist() == [
        "published volunteer, frame extrema, slices 2, 3, 5"
    ]


def test_frame_that_the_slices_lack(tmp_path):
    with pytest.raises(InputError, match=r"slice1.csv: no frame 5; choose 1 to 4, or extrema"):
        published_volunteer(*volunteer_slices(tmp_path), 5)


def test_published_simulation_gets_official_segment_numbers(tmp_path):
    """Every published strain carries its own place."""
    outputs = [150.0, *(k / 1000 for k in range(1, 52))]
    (tmp_path / "x.csv").write_text("0," * 9 + "0\n" + ",".join(map(str, range(1, 11))) + "\n")
    (tmp_path / "y.csv").write_text("0," * 51 + "0\n" + ",".join(map(str, outputs)) + "\n")
    table, theta = published_simulation(tmp_path / "x.csv", tmp_path / "y.csv", 2)
    assert theta.to_dict() == dict(zip(aha.PARAMETERS, range(1, 11), strict=True))
    values = table.set_index("output")["value"]
    assert tuple(values.index) == aha.OUTPUTS
    # AHA 3 (basal inferoseptal) is published first, AHA 1 (basal anterior) third.
    assert values["circumferential_03"] == pytest.approx(0.001)
    assert values["radial_01"] == pytest.approx(0.017 + 0.003)
    with pytest.raises(InputError, match="there are 2 rows; choose one of them"):
        published_simulation(tmp_path / "x.csv", tmp_path / "y.csv", 3)


def test_volunteer_survives_a_round_trip(tmp_path):
    file = tmp_path / "ACase.csv"
    file.write_text(",".join(["180.9", *["-0.15"] * 16, *["0.4"] * 16]))
    table = published_volunteer(file)
    write_measured(table, tmp_path / "volunteer.csv")
    pd.testing.assert_frame_equal(read_measured(tmp_path / "volunteer.csv"), table)


def test_synthetic_subject_says_so_and_survives_a_round_trip(tmp_path, outputs):
    noise = {"strain": 0.01, "volume": 2.0}
    table = synthetic_subject(outputs, noise, np.zeros(52))
    assert tuple(table["output"]) == aha.OUTPUTS
    assert table["sd"].tolist() == [2.0] + [0.01] * 51
    write_measured(table, tmp_path / "anna.csv")
    pd.testing.assert_frame_equal(read_measured(tmp_path / "anna.csv"), table)
    assert set(pd.read_csv(tmp_path / "anna.csv")["source"]) == {"synthetic"}


def test_noise_has_the_asked_size(outputs):
    noise = {"strain": 0.01, "volume": 2.0}
    table = synthetic_subject(outputs, noise, np.arange(52))
    sd = np.array([2.0] + [0.01] * 51)
    np.testing.assert_allclose(table["value"] - outputs, sd * np.arange(52), atol=1e-12)
    assert table["sd"].tolist() == sd.tolist()


def test_truth_lies_apart(tmp_path):
    theta = dict.fromkeys(aha.PARAMETERS, 1.0)
    write_truth(tmp_path / "anna.json", theta, {}, {"strain": 0.02, "volume": 2.0}, 7)
    truth = json.loads((tmp_path / "anna.json").read_text())
    assert truth["theta"] == theta and truth["seed"] == 7 and truth["effects"] == {}
