"""A study's manifest, and `regional-lv verify`: what was changed afterwards is found."""

import hashlib
import json
import subprocess

import numpy as np
import pandas as pd
import pytest
import yaml
from click.testing import CliRunner

from regional_lv import config as study_config
from regional_lv.cli import main
from regional_lv.data import path as packaged
from regional_lv.study import manifest

CONFIG = {"study": "tiny", "seed": 7, "subjects": {}, "synthetic_subjects": {}}


@pytest.fixture
def results(tmp_path, monkeypatch):
    """A folder of results with real tables in it, its configuration beside it, and its manifest."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "base.yaml").write_text(yaml.safe_dump(CONFIG | {"seed": 1}))
    (tmp_path / "config" / "tiny.yaml").write_text(yaml.safe_dump({"seed": 7}))
    folder = tmp_path / "results" / "tiny"
    (folder / "tables").mkdir(parents=True)
    (folder / "screening").mkdir()
    for name in ("volunteer_segments.csv", "measured_template.csv"):
        (folder / "tables" / name).write_bytes(packaged(name).read_bytes())
    seconds = pd.DataFrame({"theta": [1.0, 2.0], "cpu_s": [0.31, 0.28]})
    seconds.to_parquet(folder / "screening" / "train.parquet")
    manifest.write_manifest(
        [file for file in folder.rglob("*.*") if file.is_file()],
        study_config.load(CONFIG | {"map": {"starts": 3}}),
        ["config/base.yaml", "config/tiny.yaml"],
        {"map": {"starts": 3}},
        folder / "manifest.json",
    )
    return folder


def verify(*arguments) -> tuple[int, list[str]]:
    done = CliRunner().invoke(main, ["verify", *map(str, arguments)])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.output.splitlines()


def test_what_the_study_wrote_passes_from_anywhere(results, tmp_path, monkeypatch):
    content = json.loads((results / "manifest.json").read_text())
    table = results / "tables" / "volunteer_segments.csv"
    digest = hashlib.sha256(table.read_bytes()).hexdigest()
    assert content["files"]["tables/volunteer_segments.csv"] == digest
    assert list(content["files_with_times"]) == ["screening/train.parquet"]
    assert content["seed"] == 7 and content["config"]["map"]["starts"] == 3
    assert content["versions"]["numpy"] == np.__version__
    line = f"{results}: 3 files and the configuration are as the manifest says."
    assert verify(results) == (0, [line])
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    code, (line,) = verify("../results/tiny")
    assert code == 0 and line.startswith("../results/tiny: 3 files")


@pytest.mark.parametrize("name", ["train.parquet", "fit.json", "emulator.pt", "finer/emulator.pt"])
def test_what_is_over_all_inputs_holds_times(name):
    assert manifest.holds_times(f"all_inputs/{name}")
    assert not manifest.holds_times("all_inputs/errors.csv")


def test_the_commit_is_that_of_the_checkout(root):
    head = ["git", "rev-parse", "HEAD"]
    done = subprocess.run(head, cwd=root, capture_output=True, text=True)
    expected = done.stdout.strip() if (root / ".git").exists() else None
    found = manifest.versions()["regional-lv commit"]
    assert (found and found.removesuffix("-dirty")) == expected


@pytest.mark.parametrize("name", ["tables/measured_template.csv", "screening/train.parquet"])
def test_one_bit_changed_is_found(results, name):
    content = bytearray((results / name).read_bytes())
    content[len(content) // 2] ^= 1
    (results / name).write_bytes(content)
    code, (line,) = verify(results)
    assert code == 1 and line.startswith(f"{results / name}: changed since the study wrote it")


def test_a_missing_file_is_found(results):
    file = results / "tables" / "measured_template.csv"
    file.unlink()
    assert verify(results) == (1, [f"{file}: missing; run the study again"])


@pytest.mark.parametrize(
    ("file", "change", "expected"),
    [
        ("tiny.yaml", {"seed": 8}, "seed was 7 when the study ran and is 8 now"),
        ("base.yaml", {"nuts": {"draws": 700}}, "nuts.draws was 600 when the study ran and is 700"),
        ("base.yaml", {"nuts": {"drwas": 11}}, "nuts.drwas: unknown key"),
        # What the command line set counts before the file.
        ("base.yaml", {"map": {"starts": 9}}, None),
    ],
)
def test_an_edited_configuration_is_found(results, tmp_path, file, change, expected):
    path = tmp_path / "config" / file
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | change))
    code, lines = verify(results)
    if expected is None:
        assert code == 0, lines
    else:
        assert code == 1 and len(lines) == 1 and expected in lines[0], lines


def test_a_configuration_that_has_moved_has_to_be_named(results, tmp_path):
    moved = tmp_path / "moved.yaml"
    (tmp_path / "config" / "tiny.yaml").rename(moved)
    code, (line,) = verify(results)
    assert code == 1 and line.startswith("config/tiny.yaml: missing") and "--configfile" in line
    files = ("--configfile", "config/base.yaml", "--configfile", moved)
    assert verify(results, *files)[0] == 0
    # In this order the seed of the other file counts.
    files = ("--configfile", moved, "--configfile", "config/base.yaml")
    code, (line,) = verify(results, *files)
    assert code == 1 and "seed was 7 when the study ran and is 1 now" in line


def test_files_that_moved_with_the_configuration_are_the_same(results, tmp_path):
    (tmp_path / "config" / "segments.csv").write_text(
        packaged("volunteer_segments.csv").read_text()
    )
    geometry = {"geometry": {"segments": "segments.csv"}}
    (tmp_path / "config" / "tiny.yaml").write_text(yaml.safe_dump(CONFIG | geometry))
    loaded, files = study_config.load("config/tiny.yaml"), ["config/tiny.yaml"]
    assert loaded["geometry"]["segments"] == "config/segments.csv"
    manifest.write_manifest([], loaded, files, {}, results / "manifest.json")
    (tmp_path / "config").rename(tmp_path / "moved")
    given = ("--configfile", "moved/tiny.yaml")
    assert verify(results, *given)[0] == 0
    (tmp_path / "moved" / "segments.csv").rename(tmp_path / "moved" / "others.csv")
    geometry["geometry"]["segments"] = "others.csv"
    (tmp_path / "moved" / "tiny.yaml").write_text(yaml.safe_dump(CONFIG | geometry))
    code, (line,) = verify(results, *given)
    assert code == 1 and 'geometry.segments was "config/segments.csv" when' in line


def test_other_versions_are_listed_and_no_error(results):
    path = results / "manifest.json"
    content = json.loads(path.read_text())
    content["versions"] |= {"numpy": "0.1", "dolfinx": None}
    path.write_text(json.dumps(content))
    code, lines = verify(results)
    assert code == 0
    here = manifest.versions()
    assert lines[:-1] == [
        f"note: {name}: made with {there}, here {here[name] or 'none'}"
        for name, there in (("dolfinx", "none"), ("numpy", "0.1"))
        if here[name] is not None
    ]


@pytest.mark.parametrize("content", [None, "{", "[]", '{"files": {}}', '{"files": 3}'])
def test_what_is_no_manifest_is_said(results, content):
    path = results / "manifest.json"
    if content is None:
        path.unlink()
    else:
        path.write_text(content)
    code, (line,) = verify(results)
    assert code == 1 and line.startswith(str(path)) and "run" in line
    assert content is not None or "cannot be read (no such file or directory)" in line


def test_a_result_that_cannot_be_read_is_said(results):
    file = results / "tables" / "measured_template.csv"
    file.unlink()
    file.mkdir()
    line = f"{file}: cannot be read (is a directory); correct that"
    assert verify(results) == (1, [line])
