"""Faults of the machine, in words; `tests/faults` makes them happen."""

import contextlib
import errno
import json
import os

import numpy as np
import pandas as pd
import pytest
import torch
import xarray as xr

from regional_lv.errors import InputError
from regional_lv.inference.posteriors import write
from regional_lv.study.faults import READERS, damage_of, explain
from snakemake_logger_plugin_regional_lv import reason_of

OUTPUTS = ["results/a/tables/b.csv"]


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), ("results/a/tables: no space", "room")),
        (RuntimeError("write failed: No space left on device (28)"), ("no space left",)),
        (OSError(errno.EROFS, "Read-only file system", "x/y.csv"), ("x/y.csv: read-only",)),
        (PermissionError(errno.EACCES, "Permission denied", "x/y.csv"), ("x/y.csv: permission",)),
        (MemoryError(), ("memory", "--cores 1")),
        (RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried"), ("memory",)),
    ],
)
def test_the_machine_is_at_fault(error, words):
    told = explain(error, [], OUTPUTS)
    assert all(word in told for word in words) and "run the same command again" in told


def file_of(path):
    """A file of this ending, as the workflow writes it."""
    table = pd.DataFrame({"a": np.arange(300.0), "b": "word"})
    match path.suffix:
        case ".csv":
            table.to_csv(path)
        case ".json":
            path.write_text(json.dumps(table.to_dict()))
        case ".nc":
            draws = xr.Dataset({"theta": (("chain", "draw", "parameter"), np.zeros((2, 50, 3)))})
            write(xr.DataTree.from_dict({"posterior": draws}), path)
        case ".npz":
            np.savez(path, a=np.arange(300.0), b=np.zeros((4, 4)))
        case ".parquet":
            table.to_parquet(path)
        case ".pt":
            torch.save({"a": torch.arange(300.0)}, path)
    return path


@pytest.mark.parametrize("suffix", sorted(set(READERS) - {".vtu", ".csv"}))
@pytest.mark.parametrize("how", ["half", "empty", "noise"])
def test_a_damaged_file_is_named(tmp_path, suffix, how):
    path = file_of(tmp_path / f"made{suffix}")
    assert damage_of(path) == "" and explain(KeyError("defect"), [path], OUTPUTS) == ""
    content = path.read_bytes()
    noise = np.random.default_rng(1).bytes(len(content))
    path.write_bytes({"half": content[: len(content) // 2], "empty": b"", "noise": noise}[how])
    told = explain(KeyError("what the damage led to"), ["Snakefile", path], OUTPUTS)
    assert f"{path}: damaged (" in told and "delete it" in told


def test_an_input_error_over_a_damaged_file_of_the_study(tmp_path):
    """What it says of the content is beside the point. Of the user's own file it says it all."""
    error = InputError("made.json: no key a; add it")
    for inside in ("results/a/made.json", "mine.json"):
        path = tmp_path / inside
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("{")
    with contextlib.chdir(tmp_path):
        told = explain(error, ["mine.json", "results/a/made.json"], OUTPUTS)
        assert told.startswith("results/a/made.json: damaged") and "delete it" in told
        assert explain(error, ["mine.json"], OUTPUTS) == ""
        (tmp_path / "results/a/made.json").write_text("{}")
        assert explain(error, ["results/a/made.json"], OUTPUTS) == ""


def test_a_mesh_and_a_table_can_be_damaged(small_mesh, tmp_path):
    assert damage_of(small_mesh) == ""
    cut, binary = tmp_path / "cut.vtu", tmp_path / "table.csv"
    cut.write_bytes(small_mesh.read_bytes()[: os.path.getsize(small_mesh) // 2])
    binary.write_bytes(np.random.default_rng(2).bytes(5000))
    assert damage_of(cut) and damage_of(binary)


def test_the_logger_tells_input_errors_from_defects(tmp_path):
    log, defect = tmp_path / "a.log", tmp_path / "b.log"
    log.write_text("2026-01-01 INFO go\n2026-01-01 CRITICAL stopped: mine.csv: row 3\nis odd\n")
    defect.write_text("2026-01-01 CRITICAL stopped\nTraceback (most recent call last):\nKeyError\n")
    assert reason_of([str(log)]) == "mine.csv: row 3\nis odd"
    assert reason_of([str(defect), str(tmp_path / "missing.log")]) == ""
