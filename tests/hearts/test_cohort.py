"""The hearts of a cohort: listed, read and compared; what is wrong is said by heart."""

import itertools
import logging
import shutil

import pytest
import yaml

from regional_lv import config as study_config
from regional_lv.errors import InputError
from regional_lv.geometry.make import make_mesh
from regional_lv.geometry.surfaces import Surfaces
from regional_lv.geometry.table import read_segments
from regional_lv.hearts.cohort import read_cohort
from regional_lv.hearts.listing import batches_of, list_hearts, model_of_hearts
from regional_lv.inputs.space import warn_of_exact_shape
from tests.hearts.folders import NAMES, write_cohort, write_heart


@pytest.fixture
def group(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return write_cohort(tmp_path / "group")


def read(folder, check_reach=lambda config: None):
    path = folder / "config.yaml"
    config = study_config.load(path)
    return read_cohort(
        list_hearts(config["cohort"]["hearts"]),
        study_config.read(path),
        [str(folder)],
        model_of_hearts(config),
        check_reach,
    )


def edit(folder, change):
    """Apply `change` to a configuration."""
    path = folder / "config.yaml"
    config = yaml.safe_load(path.read_text())
    change(config)
    path.write_text(yaml.safe_dump(config))


def test_hearts_of_folders(group, monkeypatch):
    """In the order of their names, from any working folder, each with its own configuration on top
    of the cohort's."""
    edit(group, lambda c: c.update(inputs={"basal_twist": "suspected"}, seed=7))
    edit(
        group / "hearts" / "bert",
        lambda c: c.update(
            loading={"pressure_mmhg": 12},
            inputs={"end_diastolic_pressure": {"role": "measured", "sd_mmhg": 2}},
        ),
    )
    (group / "elsewhere").mkdir()
    monkeypatch.chdir(group / "elsewhere")
    found = read(group)
    assert list(found.hearts) == sorted(NAMES) and not found.left_out
    anna, bert = (found.hearts[name].config for name in ("anna", "bert"))
    assert list(bert["subjects"]) == ["bert"] and bert["study"] == "group" and bert["seed"] == 7
    assert (anna["loading"]["pressure_mmhg"], bert["loading"]["pressure_mmhg"]) == (8, 12)
    assert anna["inputs"]["basal_twist"] == bert["inputs"]["basal_twist"] == "suspected"
    assert anna["inputs"]["end_diastolic_pressure"] == "suspected"
    assert bert["inputs"]["end_diastolic_pressure"]["role"] == "measured"
    assert any("still is the example" in line for line in found.hearts["anna"].warnings)


def test_a_role_takes_the_place_of_the_one_below_with_its_keys(group):
    roles = {"segment_thickness": {"role": "fixed"}, "endo_radius": {"sd_mm": 2.0}}
    edit(group, lambda c: c.update(inputs={"endo_radius": {"role": "measured", "sd_mm": 1.0}}))
    edit(group / "hearts" / "bert", lambda c: c.update(inputs=roles))
    inputs = read(group).hearts["bert"].config["inputs"]
    assert inputs["segment_thickness"] == {"role": "fixed"}
    assert inputs["endo_radius"] == {"role": "measured", "sd_mm": 2.0}


def test_files_that_lie_in_the_cohorts_folder(group):
    """They are found from a heart's own and from a table in another folder, with a warning, and
    are among those that a heart is made from."""
    (group / "strains").mkdir()
    shared = shutil.move(group / "hearts" / "anna" / "measured.csv", group / "strains" / "a.csv")
    subjects = {"patient": {"source": "file", "measured": "strains/a.csv"}}
    edit(group / "hearts" / "anna", lambda c: c.update(subjects=subjects))
    (said,) = [line for line in read(group).hearts["anna"].warnings if "a.csv" in line]
    assert said.startswith("subjects.patient.measured: strains/a.csv is not in")
    anna = list_hearts(str(group / "hearts" / "*/"))[0]
    assert anna.files([]) and shared.samefile(anna.files([str(group)])[-1])


def test_volumes_without_a_mesh_are_those_of_the_mesh(smoke_config, tmp_path):
    table, apices = read_segments("volunteer"), (-74.4, -81.2)
    files = [tmp_path / name for name in ("m.msh", "m.vtu", "s.csv", "s.json")]
    make_mesh(
        "volunteer", *apices, smoke_config["mesh"] | {"mid": 2}, smoke_config["fibres"], *files
    )
    summary = yaml.safe_load(files[3].read_text())
    cavity, wall = Surfaces(table, *apices).volumes()
    assert cavity == pytest.approx(summary["cavity_volume_ml"], rel=2e-3)
    assert wall == pytest.approx(summary["wall_volume_ml"], rel=2e-3)


TABLE = "heart,segments,endo_apex_z_mm,epi_apex_z_mm,pressure_mmhg,measured,pressure_sd_mmhg\n"


def table_of(group, rows):
    (group / "hearts.csv").write_text(TABLE + "".join(f"{row}\n" for row in rows))
    edit(group, lambda c: c.update(cohort={"hearts": "hearts.csv"}))


def row(name, pressure="8", sd="", apex="-74.4"):
    folder = f"hearts/{name}"
    return f"{name},{folder}/segments.csv,{apex},-81.2,{pressure},{folder}/measured.csv,{sd}"


def test_hearts_of_a_table(group):
    table_of(group, [row("bert", "12", "2"), row("anna"), row("cleo", "9")])
    found = read(group)
    assert list(found.hearts) == ["bert", "anna", "cleo"]
    bert = found.hearts["bert"].config
    assert bert["loading"]["pressure_mmhg"] == 12 and list(bert["subjects"]) == ["bert"]
    assert bert["inputs"]["end_diastolic_pressure"] == {"role": "measured", "sd_mmhg": 2}
    assert found.hearts["anna"].config["inputs"]["end_diastolic_pressure"] == "suspected"


def test_rows_that_cannot_be_used_are_left_out_by_name(group):
    rows = [row("anna"), row("bert", "eight"), row("cleo"), row("dora", apex="-7.44"), row("emil")]
    table_of(group, [*rows, row("gone"), row("fred")])
    found = read(group)
    assert set(found.left_out) == {"bert", "dora", "gone"}
    assert (
        "hearts.csv, line 3: loading.pressure_mmhg: 'eight' is not a number"
        in (found.left_out["bert"])
    )
    assert "apex" in found.left_out["dora"]
    assert "gone/segments.csv" in found.left_out["gone"]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (TABLE.replace("measured,", "") + "a,b,1,2,3,4\n", "no column `measured`"),
        (TABLE.replace("pressure_sd_mmhg", "sd") + "a,b,1,2,3,4,5\n", "column `sd` is not known"),
        (TABLE + row("anna") + "\n" + row("anna") + "\n", "a heart listed twice"),
        (TABLE + row("anna").replace("anna,", "../anna,", 1) + "\n", "not a usable name"),
        (TABLE, "no heart there"),
    ],
)
def test_tables_that_cannot_be_used(group, text, complaint):
    (group / "hearts.csv").write_text(text)
    with pytest.raises(InputError, match=complaint):
        list_hearts(str(group / "hearts.csv"))


def test_no_hearts(group):
    with pytest.raises(InputError, match="no heart there"):
        list_hearts(str(group / "nowhere/*/"))


def test_a_heart_listed_twice(group):
    """Under one name, by two ways to one folder, and as a copy under another name."""
    shutil.copytree(group / "hearts" / "anna", group / "more" / "anna")
    with pytest.raises(InputError, match=r"has the name anna, as .*: a heart listed twice"):
        list_hearts(str(group / "*" / "*/"))
    shutil.rmtree(group / "more")
    (group / "hearts" / "zoe").symlink_to(group / "hearts" / "anna")
    with pytest.raises(InputError, match=r"has the folder .*: a heart listed twice"):
        list_hearts(str(group / "hearts" / "*/"))
    (group / "hearts" / "zoe").unlink()
    shutil.copytree(group / "hearts" / "anna", group / "hearts" / "zoe")
    with pytest.raises(
        InputError, match=r"^zoe: measured values, .* those of anna: a heart listed"
    ):
        read(group)
    # In another order of its rows, too.
    measured = group / "hearts" / "zoe" / "measured.csv"
    head, *rows = measured.read_text().splitlines()
    measured.write_text("\n".join([head, *rows[::-1]]) + "\n")
    with pytest.raises(
        InputError, match=r"^zoe: measured values, .* those of anna: a heart listed"
    ):
        read(group)
    # Of another pressure it is another question about the same measurement.
    edit(group / "hearts" / "zoe", lambda c: c.update(loading={"pressure_mmhg": 10}))
    assert "the measured values are those of anna" in read(group).hearts["zoe"].warnings


def test_one_heart_that_cannot_be_used_is_left_out_with_its_reason(group):
    (group / "hearts" / "anna" / "measured.csv").unlink()
    (group / "hearts" / "cleo" / "config.yaml").unlink()
    measured = group / "hearts" / "bert" / "measured.csv"
    measured.write_text(measured.read_text().replace("radial,1,", "radial,1,-", 1))
    with pytest.raises(InputError) as raised:
        read(group)  # three of six
    lines = str(raised.value).splitlines()
    assert lines[0].startswith("cohort: 3 of 6 hearts cannot be answered")
    assert [line.split(": ")[0] for line in lines[1:]] == ["anna", "bert", "cleo"]
    write_heart(group / "hearts" / "gina", scale=1.07)
    found = read(group)
    assert list(found.left_out) == ["anna", "bert", "cleo"]
    assert "subjects.patient.measured" in found.left_out["anna"]
    assert "correct the sign" in found.left_out["bert"]
    assert "give each heart's folder a config.yaml" in found.left_out["cleo"]


def test_a_measured_file_that_is_not_in_the_folder_of_its_heart_is_told_of(group):
    shutil.move(group / "hearts" / "bert" / "measured.csv", group)
    found = read(group).hearts
    text = f"measured.csv is not in group/hearts/bert; {group}/measured.csv is used"
    assert f"subjects.patient.measured: {text}" in found["bert"].warnings
    assert not any("is used" in line for line in found["anna"].warnings)


def test_what_is_logged_of_a_heart_is_among_its_warnings(group, caplog):
    def check_reach(config):
        for _ in range(2):
            logging.getLogger("regional_lv.geometry.surfaces").warning("a hole was closed")
        warn_of_exact_shape("segment_thickness", "it has no table")

    found = read(group, check_reach)
    said = [warning for heart in found.hearts.values() for warning in heart.warnings]
    assert sum("counts as exact" in warning for warning in said) == len(found.hearts)
    assert all(heart.warnings.count("a hole was closed") == 1 for heart in found.hearts.values())
    assert not caplog.text
    logging.getLogger("regional_lv.hearts").warning("shown")
    assert "shown" in caplog.text


def test_one_heart_in_another_unit(group):
    edit(group / "hearts" / "bert", lambda c: c.update(loading={"pressure_mmhg": 1.2}))
    sd = group / "hearts" / "cleo" / "measured.csv"
    lines = sd.read_text().splitlines()
    at = lines[0].split(",").index("sd")
    for i, line in enumerate(lines[2:], start=2):  # the first row is the volume
        fields = line.split(",")
        fields[at] = f"{float(fields[at]) / 100:g}"
        lines[i] = ",".join(fields)
    sd.write_text("\n".join(lines) + "\n")
    found = read(group)
    assert set(found.left_out) == {"bert", "cleo"}
    assert "looks like kPa: 9 mmHg" in found.left_out["bert"]
    assert "the sd of the strains is 0.0002" in found.left_out["cleo"]


def test_a_heart_in_centimetres(group):
    path = group / "hearts" / "bert" / "segments.csv"
    lines = path.read_text().splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("aha_segment"))
    columns = lines[start].split(",")
    for i in range(start + 1, len(lines)):
        fields = lines[i].split(",")
        for k, column in enumerate(columns):
            if column.endswith("_mm"):
                fields[k] = f"{float(fields[k]) / 10:g}"
        lines[i] = ",".join(fields)
    path.write_text("\n".join(lines) + "\n")
    assert "looks like cm" in read(group).left_out["bert"]


def test_half_out_of_range(group):
    def check_reach(config):
        if next(iter(config["subjects"])) in ("anna", "bert", "cleo"):
            raise InputError("wall_thickness_7 is 40 mm; the emulator knows 3 to 20")

    with pytest.raises(InputError, match="3 of 6 hearts cannot be answered") as raised:
        read(group, check_reach)
    assert "\nbert: wall_thickness_7 is 40 mm" in str(raised.value)


def test_an_error_of_the_software_leaves_one_heart_out(group, caplog):
    def check_reach(config):
        if "bert" in config["subjects"]:
            raise ValueError("not positive definite")

    assert read(group, check_reach).left_out == {"bert": "ValueError: not positive definite"}
    assert "Traceback" in caplog.text


def test_models_that_differ(group):
    edit(group / "hearts" / "bert", lambda c: c.update(parameters={"zones": "whole"}))
    with pytest.raises(
        InputError, match=r"^bert: parameters: not as in the cohort's configuration"
    ):
        read(group)


def test_more_than_one_subject(group):
    def change(config):
        config["subjects"]["again"] = config["subjects"]["patient"]

    edit(group / "hearts" / "bert", change)
    assert "a heart of a cohort has one" in read(group).left_out["bert"]


def test_another_heart_changes_one_batch():
    names = [f"heart{i}" for i in range(50)]
    before, after = batches_of(names, 5), batches_of([*names, "another"], 5)
    assert sorted(itertools.chain(*before.values())) == sorted(names)
    assert max(map(len, before.values())) <= 12 and len(before) > 8
    assert sum(before.get(batch) != after[batch] for batch in after) == 1
    assert batches_of(["a"], 5) and len(batches_of(names, 1000)) == 1
