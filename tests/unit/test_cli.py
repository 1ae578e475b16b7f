"""The command line: a folder written, filled in, checked and run, from anywhere."""

import logging
import re
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from click.testing import CliRunner
from matplotlib.image import imread

from regional_lv import config as study_config
from regional_lv import data
from regional_lv.aha import WALLS
from regional_lv.channels import Channels
from regional_lv.cli import main
from regional_lv.cli.check import _own_words
from regional_lv.cli.scale import heart_lines, origin, subject_lines
from regional_lv.geometry.table import read_segments
from regional_lv.hearts.checks import place_warnings, uneven, unusual
from regional_lv.measured import curves, read_measured
from regional_lv.measured.plausibility import data_warnings, too_small
from regional_lv.plots import style
from regional_lv.quantities.seth_hill import Measure
from regional_lv.study.manifest import write_manifest

CHANNELS = Channels.of()


@pytest.fixture
def call(tmp_path, monkeypatch):
    """Call the command line in a folder of its own; the exit code and the lines that it says."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> tuple[int, list[str]]:
        done = CliRunner().invoke(main, arguments)
        assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
        assert "Traceback" not in done.output
        return done.exit_code, done.output.splitlines()

    return call


@pytest.fixture
def filled(call, tmp_path, smoke_config):
    """The folder `hearts/anna`, filled in; `measured`: (text, replacement) in its measured file."""

    def filled(measured=("", ""), segments=("", ""), **sections):
        assert call("new", "hearts/anna")[0] == 0
        folder = tmp_path / "hearts" / "anna"
        config = yaml.safe_load((folder / "config.yaml").read_text())
        config |= {"loading": {"pressure_mmhg": 8}, "mesh": smoke_config["mesh"]} | sections
        (folder / "config.yaml").write_text(yaml.safe_dump(config))
        template = data.path("measured_template.csv").read_text()
        (folder / "measured.csv").write_text(template.replace(*measured))
        table = (folder / "segments.csv").read_text()
        (folder / "segments.csv").write_text(table.replace(*segments))
        return folder

    return filled


def test_new_folder_holds_the_example_and_nothing_is_overwritten(call, tmp_path):
    assert call("new", "hearts/anna")[0] == 0
    folder = tmp_path / "hearts" / "anna"
    own, example = (read_segments(t) for t in (folder / "segments.csv", "volunteer"))
    numbers = ["wall_thickness_mm", "endo_radius_mm", "angle_from_deg", "z_bottom_mm"]
    pd.testing.assert_frame_equal(own[numbers], example[numbers])
    before = {file: file.read_text() for file in folder.iterdir()}
    code, (line,) = call("new", "hearts/anna")
    assert code == 1 and "nothing is overwritten" in line
    assert {file: file.read_text() for file in folder.iterdir()} == before


def test_new_name_has_to_be_usable(call, tmp_path):
    code, (line,) = call("new", "my heart")
    assert code == 1 and "not a usable name" in line
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["no", "x" * 300, "file/heart"])
def test_a_folder_that_cannot_be_made(call, tmp_path, name):
    (tmp_path / "file").write_text("")
    code, (line,) = call("new", name)
    assert code == 1 and ("not a usable name" in line or "cannot be written" in line)
    code, (line,) = call("check", name)
    assert code == 1 and "check the path" in line


@pytest.mark.parametrize("missing", ["loading", "geometry"])
def test_a_measured_heart_has_nothing_of_the_volunteers_unasked(call, filled, missing):
    folder = filled()
    config = yaml.safe_load((folder / "config.yaml").read_text())
    del config[missing]
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    code, (line,) = call("check", "hearts/anna")
    key = {"loading": "loading.pressure_mmhg"}.get(missing, missing)
    assert code == 1 and line.startswith(f"hearts/anna/config.yaml: {key}: missing; ")


def test_a_file_from_another_folder_is_reported(call, filled, monkeypatch):
    folder = filled()
    monkeypatch.chdir(folder)
    (folder / "other").mkdir()
    (folder / "config.yaml").rename(folder / "other" / "config.yaml")
    code, lines = call("check", "other")
    assert code == 0, lines
    found = [line for line in lines if line.startswith("warning: ") and " is used" in line]
    assert [line.split(": ")[1] for line in found] == [
        "subjects.patient.measured",
        "geometry.segments",
    ]
    assert str(folder / "measured.csv") in found[0]


def test_surfaces_and_meshes_from_another_folder_are_reported(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for file in ("endo.stl", "heart/epi.stl", "heart.inp", "heart/config.yaml"):
        Path(file).parent.mkdir(exist_ok=True)
        Path(file).write_text("")
    own = {
        "surfaces": {"endocardium": "endo.stl", "epicardium": "epi.stl"},
        "imported": {"file": "heart.inp", "segments": None},
        "segments": "volunteer",
    }
    used = own | {"surfaces": own["surfaces"] | {"epicardium": "heart/epi.stl"}}
    config = {"geometry": used, "subjects": {}}
    found = place_warnings(Path("heart/config.yaml"), {"geometry": own}, config)
    assert [line.split(":")[0] for line in found] == [
        "geometry.surfaces.endocardium",
        "geometry.imported.file",
    ]
    assert found[0].endswith(f"endo.stl is not in heart; {tmp_path}/endo.stl is used")


def test_a_copied_folder_and_an_uneven_wall_are_reported(call, filled, tmp_path):
    folder = filled()
    table = read_segments(folder / "segments.csv").drop(columns=["line"])
    table.loc[table["aha_segment"] == 7, "wall_thickness_mm"] *= 3
    table.to_csv(folder / "segments.csv", index=False)
    folder.rename(tmp_path / "copy")
    code, lines = call("check", "copy")
    assert code == 0, lines
    found = "\n".join(lines)
    assert "warning: the folder is copy, and the results go to results/anna" in found
    assert "warning: heart: segment 7: the wall is 27.5 mm thick" in found
    assert "still is the example, the paper's volunteer, segments 1, 2, 3, 4, 5, 6, 8" in found


@pytest.mark.parametrize(
    ("segment", "thickness", "expected"),
    [
        (12, 28.0, "2.8 times the median of the mid level"),
        (12, 4.0, "0.4 times the median of the mid level"),
        # Nothing else is on the apex's own level; and thin it may be.
        (17, 28.0, "2.8 times the median of the apical level"),
        (17, 4.0, None),
    ],
)
def test_a_wall_of_uneven_thickness_is_reported_whatever_the_geometry(segment, thickness, expected):
    meshed = pd.DataFrame({"thickness_mm": 10.0}, index=range(1, 18))
    assert uneven(meshed) == []
    meshed.loc[segment] = thickness
    found = uneven(meshed)
    assert len(found) == (expected is not None)
    if expected:
        assert found[0].startswith(f"heart: segment {segment}: the wall is {thickness:g} mm thick")
        assert expected in found[0]
    # What a table of segments gives is what the user can correct.
    assert uneven(meshed.assign(thickness_table_mm=10.0)) == []


@pytest.mark.parametrize(
    ("thickness", "cavity", "expected"),
    [
        (9.0, 105.0, []),
        (19.0, 60.0, []),  # hypertrophic
        (25.0, 105.0, ["the median thickness of the wall is 25 mm"]),
        (9.0, 10.5, ["the unloaded cavity has 10.5 mL"]),
        (2.5, 1050.0, ["thickness of the wall is 2.5 mm", "cavity has 1050 mL"]),
    ],
)
def test_a_heart_of_unusual_size_is_reported(thickness, cavity, expected):
    found = unusual(thickness, cavity)
    assert len(found) == len(expected)
    assert all(part in line for part, line in zip(expected, found, strict=True))


def test_only_the_packages_own_warnings_are_told(capsys, caplog):
    found = []
    with _own_words(found), warnings.catch_warnings():
        logging.getLogger("regional_lv.geometry").warning("The mesh is %.1f mm away", 2)
        logging.getLogger("regional_lv.geometry").info("meshed")
        logging.getLogger("vtk").error("Generic Warning: In vtkSTLReader.cxx, line 1")
        warnings.warn("divide by zero", RuntimeWarning, stacklevel=1)
        print("of a library")
    assert found == ["heart: The mesh is 2.0 mm away"]
    assert capsys.readouterr() == ("", "")


def test_results_of_another_folder_are_not_overwritten(call, filled, tmp_path, root):
    """`results/anna` was written from a folder that is there; a copy of it is not run."""
    folder, copy = filled(), tmp_path / "copy"
    results = tmp_path / "results" / "anna"
    results.mkdir(parents=True)
    config, files = study_config.load(folder / "config.yaml"), ["quick.yaml", "copy/config.yaml"]
    (tmp_path / "quick.yaml").write_text("")
    write_manifest([], config, files, {}, results / "manifest.json")
    # The folder was moved, and not copied.
    study = ("hearts/anna", "--dry-run", "--workflow", str(root))
    copy.mkdir()
    (copy / "config.yaml").write_text((folder / "config.yaml").read_text())
    for arguments in (("check", "hearts/anna"), ("run", *study)):
        code, (line,) = call(*arguments)
        assert code == 1 and line.startswith(
            "hearts/anna/config.yaml: study: results/anna holds the results of copy/config.yaml"
        )
        assert "give `study` a name of its own, or move results/anna" in line


def test_every_channel_has_a_row_to_fill_in(call, tmp_path):
    call("new", "anna")
    file = tmp_path / "anna" / "measured.csv"
    lines = [line for line in file.read_text().splitlines() if not line.startswith("#")]
    assert lines[0] == "quantity,segment,value,unit,sd"
    values = {"volume": "180", "radial": "40"}
    for i, line in enumerate(lines[1:], start=1):
        quantity, segment, value, unit, sd = line.split(",")
        assert value == sd == ""
        lines[i] = f"{quantity},{segment},{values.get(quantity, '-15')},{unit},"
    file.write_text("\n".join(lines))
    assert tuple(read_measured(file)["output"]) == CHANNELS.names


def test_fresh_folder_is_told_what_to_fill_in(call):
    call("new", "anna")
    code, lines = call("check", "anna")
    assert code == 1
    pressure, measured = lines
    assert pressure.startswith("anna/config.yaml: loading.pressure_mmhg: empty; fill in")
    assert "C_a" in pressure and "doi" in pressure
    assert "anna/measured.csv, line " in measured and "or remove the row" in measured


def test_check_of_a_filled_folder_from_elsewhere(call, filled, monkeypatch, tmp_path):
    drawn, figure = [], style.figure
    monkeypatch.setattr(style, "figure", lambda *size: drawn.append(figure(*size)) or drawn[-1])
    folder = filled(("longitudinal,17,-12,%,2\n", ""))
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    code, lines = call("check", "../hearts/anna")
    assert code == 0, lines
    found = "\n".join(lines)
    assert "patient: 51 of 52 channels" in found
    # What sets the scale of the answer, and where it comes from.
    config, file = "../hearts/anna/config.yaml", "../hearts/anna/measured.csv"
    assert f"end-diastolic pressure: 8 mmHg (loading.pressure_mmhg, {config})" in lines
    (unloaded,) = [line for line in lines if line.startswith("unloaded heart: cavity ")]
    assert re.search(r"cavity 10\d\.\d mL, wall 1\d\d\.\d mL \(\S+segments\.csv\)$", unloaded)
    assert f"patient: volume 180 mL (column value, {file}), sd 2 mL (column sd, {file})" in lines
    assert f"patient: sd of the strains 0.02 (strains as fractions; column sd, {file})" in lines
    assert "measured, and integrated out: segment_thickness (sd 1 mm), endo_radius (sd 1" in found
    (suspected,) = [line for line in lines if line.startswith("suspected: septal_load, ")]
    assert "focal_scar" not in suspected  # `run` does not, unless the folder asks for it
    assert "warning: patient: not measured: longitudinal 17" in found
    assert "still is the example" in found and "the folder is" not in found
    picture = imread(folder / "check.png")
    # The heart, the segments, and three bullseyes: in every fifth of it something is drawn.
    for part in np.array_split(picture[..., :3], 5, axis=1):
        assert (part.min(-1) < 0.9).mean() > 0.2
    # Each bullseye says where the walls are, and each scale of colours what it counts.
    axes = drawn[0].axes
    words = [text.get_text() for ax in axes for text in ax.texts]
    assert [words.count(wall) for wall in WALLS] == [4] * 4
    assert [ax.get_xlabel() for ax in axes].count("strain (%)") == 3
    assert (picture[[0, -1], :, :3] == 1).all()  # no title or number is cut off


def test_curves_are_checked_and_the_frame_is_reported(call, filled, monkeypatch):
    folder = filled()
    around = [f"circumferential_{segment:02d}" for segment in (1, 2, 3)]
    rows = [f"frame,{','.join(around)},radial_01", "1,0,0,0,0", "2,-9,-9,-9,30"]
    # One of them has a spike.
    rows += ["3,-8.9,-8.9,-19,29", "4,-6,-6,-6,18"]
    (folder / "curves.csv").write_text("\n".join(rows))
    read, read_lines = [], curves.read_lines

    def counted(path, **given):
        read.append(path)
        return read_lines(path, **given)

    monkeypatch.setattr(curves, "read_lines", counted)
    config = yaml.safe_load((folder / "config.yaml").read_text())
    patient = {"source": "curves", "curves": "curves.csv", "unit": "percent"}
    patient |= {"reference": "end_diastole", "frame": "earliest_diastole", "volume_ml": 180}
    (folder / "config.yaml").write_text(yaml.safe_dump(config | {"subjects": {"anna": patient}}))
    code, lines = call("check", "hearts/anna/config.yaml")
    assert code == 0, lines
    found = "\n".join(lines)
    # By the check of the configuration, and for the table.
    assert len(read) == 2
    assert "warning: anna: circumferential_03 is -19.0 % in frame 3, and -7.5 % by the" in found
    assert "anna: 5 of 52 channels, hearts/anna/curves.csv; from frame 1, end" in found
    assert "back to frame 4" in found
    assert "no sd of the strains" in found
    config, key = "hearts/anna/config.yaml", "subjects.anna"
    for line in (
        f"unloaded frame 4, by earliest_diastole ({key}.frame, {config}); end-diastolic frame 1 "
        f"({key}.end_diastole_frame, default); engineering strain ({key}.measure, default)",
        f"volume 180 mL ({key}.volume_ml, {config}), known to 0.5 % ({key}.sd.volume, default)",
        f"sd of the strains not given: the noise is inferred ({key}.sd.strain, default)",
    ):
        assert f"anna: {line}" in lines


def test_a_value_comes_from_the_file_that_counts_first(table, tmp_path):
    above, below = tmp_path / "mine.yaml", tmp_path / "quick.yaml"
    layers = [
        (above, {"loading": {"pressure_mmhg": None}, "subjects": {"anna": {"frame": 3}}}),
        (below, {"loading": {"pressure_mmhg": 9}, "subjects": None}),
    ]
    assert origin(layers, "loading", "pressure_mmhg") == f"loading.pressure_mmhg, {below}"
    assert origin(layers, "subjects", "anna", "frame") == f"subjects.anna.frame, {above}"
    assert origin(layers, "subjects", "anna", "measure") == "subjects.anna.measure, default"
    config = {"loading": {"pressure_mmhg": 9.0}}
    pressure, unloaded = heart_lines(config, layers, 98.76, 120.0, "a.stl and b.stl")
    assert pressure == f"end-diastolic pressure: 9 mmHg (loading.pressure_mmhg, {below})"
    assert unloaded == "unloaded heart: cavity 98.8 mL, wall 120.0 mL (a.stl and b.stl)"
    # A table with a second load, the user's frames, and strains of which one has another sd.
    at_half = table[:1].assign(load_fraction=0.5, value=150.0)
    both = pd.concat([table, at_half]).assign(frame="7")
    both.loc[both["output"] == "radial_03", "sd"] = 0.05
    subject = {"source": "file", "measured": "m.csv"}
    assert list(subject_lines("anna", subject, layers, both, {})) == [
        "frame 7 (column frame, m.csv)",
        "volume 180 mL (column value, m.csv), sd 2 mL (column sd, m.csv)",
        "volume at 50 % of the load 150 mL (column value, m.csv), sd 2 mL (column sd, m.csv)",
        "sd of circumferential 0.02, radial 0.02 to 0.05, longitudinal 0.02 (strains as fractions; "
        "column sd, m.csv)",
    ]


MISTAKES = {
    # what is replaced in the measured file and the geometry table, sections; expected messages
    "volume below the cavity": (
        {"measured": ("volume,,180", "volume,,90")},
        ["subjects.patient: volume 90.0 mL, and the cavity of the unloaded geometry holds 10"],
    ),
    "table and key": (
        {
            "segments": ("1,basal anterior,12.43", "1,basal anterior,1.243"),
            "design": {"lower": 3.0, "upper": 2.0},
        },
        [
            r"geometry\.segments: hearts/anna/segments\.csv, line 13: wall_thickness_mm is 1\.243",
            r"design\.lower: 3\.0 is not below design\.upper \(2\.0\); exchange them",
        ],
    ),
    "file and table": (
        {
            "measured": ("circumferential,3,-16,%", "circumferential,3,-16,mm"),
            "segments": ("0.0,-13.6", "0.0,-15.6"),
        },
        [
            r"geometry\.segments: hearts/anna/segments\.csv, line 19: the mid level begins at z",
            "subjects.patient.measured: hearts/anna/measured.csv, line 5: unit `mm` does not go",
        ],
    ),
    "no table": (
        {"geometry": {"segments": "none.csv"}},
        ["geometry.segments: there is no file none.csv; give its path"],
    ),
    "unknown key": ({"loading": {"presure_mmhg": 8}}, ["loading.presure_mmhg: unknown key; did"]),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_each_mistake_is_one_line(call, filled, name):
    change, expected = MISTAKES[name]
    filled(**change)
    code, lines = call("check", "hearts/anna")
    assert code == 1
    found = [line for line in lines if line.startswith("hearts/anna/config.yaml: ")]
    found = [line.removeprefix("hearts/anna/config.yaml: ") for line in found]
    found = [line for line in found if not line.startswith("study anna")]
    assert len(found) == len(expected), found
    for line, start in zip(found, expected, strict=True):
        assert re.match(start, line)


def test_folder_that_is_not_there(call):
    code, (line,) = call("check", "nobody")
    assert code == 1 and line.startswith("nobody: no folder with a config.yaml")


def test_run_needs_the_project_and_a_study(call, filled, root, tmp_path):
    filled()
    code, (line,) = call("run", "hearts/anna", "--own", "--workflow", str(tmp_path))
    assert code == 1 and "clone the project" in line
    code, (line,) = call("run", "hearts/anna", "--own", "--study", "slow", "--workflow", str(root))
    assert code == 1 and "choose one of" in line and "quick" in line


def test_run_puts_the_folder_on_top_of_a_study(call, filled, root, capfd):
    filled()
    code, lines = call("run", "hearts/anna", "--own", "--dry-run", "--workflow", str(root))
    jobs = capfd.readouterr().out
    assert code == 0, lines
    assert "No errors, but see the warnings above." in lines
    assert "input: hearts/anna/measured.csv" in jobs
    assert "output: results/anna/measured/patient.csv" in jobs
    assert "import_measured" in jobs and "simulate_subject" not in jobs


# ----------------------------------------------------------------------- warnings


@pytest.fixture
def table():
    """The template's values as a measured table."""
    return read_measured(data.path("measured_template.csv"))


def warnings_of(table, exponent=2.0, cavity=105.0):
    return data_warnings(table, CHANNELS, 10, Measure(exponent), cavity, 123.0)


def test_the_template_causes_no_warning(table):
    assert warnings_of(table) == [] and too_small(table, 105.0) == ""


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda t: t[t["quantity"] != "volume"], "no volume: "),
        (lambda t: t[t["quantity"] != "radial"], "not measured: radial; "),
        (
            lambda t: t[~t["output"].isin(["radial_01", "radial_07"])],
            "not measured: radial 01, 07;",
        ),
        (lambda t: t.assign(sd=np.nan), "no sd of the strains"),
        (lambda t: t.assign(sd=np.nan), "no sd of the volume"),
        (lambda t: t.assign(sd=0.0002), "circumferential_01 has an sd of 0.0002; measurements"),
        (lambda t: t.assign(sd=t["sd"].where(t.index != 0, 0.01)), "volume_ml has an sd of 0.01 m"),
        (lambda t: t.assign(value=t["value"].where(t.index != 3, 0.0)), "circumferential_03 is ze"),
        (
            lambda t: t.assign(value=t["value"].where(t.index != 3, -0.0016)),
            "circumferential_03 is",
        ),
        (
            lambda t: t.assign(value=t["value"].where(t.index != 3, 0.09)),
            "circumferential_03 is 0.09, and most segments have the other sign: right if",
        ),
        (lambda t: t.assign(value=t["value"].where(t.index != 0, 300.0)), "by the strains the ven"),
        (
            lambda t: t.assign(value=t["value"].where(t["quantity"] != "radial", 0.02)),
            "the mean radial strain is 0.020",
        ),
        (
            lambda t: t.assign(value=t["value"].where(t["quantity"] != "radial", 0.02)),
            "cannot be those of a wall that keeps its volume",
        ),
    ],
)
def test_unusual_values_cause_a_warning(table, change, expected):
    assert any(expected in line for line in warnings_of(change(table))), warnings_of(change(table))


def test_the_measure_of_curves_is_known(table):
    few = table.assign(value=table["value"].where(table["quantity"] != "radial", 0.02))
    found = " ".join(data_warnings(few, CHANNELS, 10, Measure(), 105.0, 123.0, converted=True))
    assert "check frame and unit" in found and "cannot be those of a wall" in found
    assert "measure" not in found and "nominal" not in found


@pytest.mark.parametrize(("without", "other"), [("volume", "strains"), ("strains", "volume")])
def test_only_the_sd_that_is_missing_is_asked_for(table, without, other):
    volume = table["quantity"] == "volume"
    given = ~volume if without == "volume" else volume
    found = " ".join(warnings_of(table.assign(sd=table["sd"].where(given))))
    assert f"no sd of the {without}" in found and f"no sd of the {other}" not in found


def test_growth_does_not_depend_on_the_strain_measure(table):
    strain = table["quantity"] != "volume"
    lines = np.sqrt(1 + 2 * table["value"][strain]) - 1
    engineering = table.assign(value=table["value"].where(~strain, lines))
    found = [warnings_of(t.replace(180.0, 300.0), n) for t, n in ((table, 2.0), (engineering, 1.0))]
    green, nominal = ([line for line in s if "by the strains" in line] for s in found)
    assert green == nominal != []
