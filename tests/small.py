"""One small study, made once for the whole run of the tests and copied by those that need one.

It is the smoke study on designs that criticism can work with. It is killed on its way and goes on
to the end of the screening and to the emulator of all inputs; what follows is for those that copy
it.
"""

import json
import os
import shutil
import signal
import time
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml
from filelock import FileLock

from tests.workflow.project import copy_project, run, start

RESULTS = Path("results/smoke")
BATCHES = RESULTS / "simulations/train"

DESIGN = {
    "mesh": {"circumferential": 16, "basal": 2, "mid": 1, "apical": 1, "apex": 1, "transmural": 1},
    "design": {"natural": 48, "log": 16, "test": 4, "lower": 0.4, "upper": 3.0},
    "simulations": {"batch_size": 24, "anchors": 16},
    "nuts": {
        **{"chains": 2, "warmup": 30, "draws": 60, "rhat_max": 1.3, "ess_min": 15},
        **{"max_tree_depth": 3, "cases_per_batch": 3},
    },
    "clinical": {"chains": 2, "warmup": 30, "draws": 60, "noise_prior_scales": [0.2]},
    "inputs": dict.fromkeys(
        [
            *("end_diastolic_pressure", "fibre_rotation", "basal_motion", "septal_load"),
            *("radial_scale", "mixed_frames", "heavy_tails"),
        ],
        "suspected",
    ),
    "all_inputs": {"simulations": 128, "test": 4, "anchors": 32},
    "criticism": {
        **{"bootstrap": 49, "largest_set": 2},
        "confirmation": {"sets": 1, "simulations": 2, "rounds": 2},
    },
}
"""Sections of the small study, in place of the smoke study's own."""


class Small(NamedTuple):
    """A project whose small study is there up to its simulations and the emulator of all inputs; a
    batch of simulations that was finished when its first run was killed, and when that was."""

    project: Path
    batch: Path
    finished_ns: int

    def copy(self, folder: Path) -> "Small":
        """The same in another folder, times included: nothing is out of date in it."""
        shutil.copytree(self.project, folder, symlinks=True)
        return self._replace(project=folder)


def small(root: Path, factory: pytest.TempPathFactory) -> Small:
    """The study, made by the worker that needs it first."""
    shared = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent
    project, note = shared / "small", shared / "small.json"
    with FileLock(shared / "small.lock"):
        if not note.exists():
            shutil.rmtree(project, ignore_errors=True)
            note.write_text(json.dumps(_make(root, project)))
    batch, finished_ns = json.loads(note.read_text())
    return Small(project, Path(batch), finished_ns)


def edit_config(project: Path, change) -> dict:
    """Apply `change` to the smoke study's configuration; returns that."""
    path = project / "config" / "smoke.yaml"
    config = yaml.safe_load(path.read_text())
    change(config)
    path.write_text(yaml.safe_dump(config))
    return config


def _design(config: dict) -> None:
    config.update(DESIGN)
    config["emulators"]["joint_gp"] = {"iterations": 40}


def _make(root: Path, project: Path) -> tuple[str, int]:
    copy_project(root, project)
    edit_config(project, _design)
    made = ["screening/train.parquet", "screening/test.parquet", "all_inputs/emulator.pt"]
    wanted = "--cores", "2", *(f"{RESULTS}/{file}" for file in made)
    process = start(project, *wanted)
    deadline = time.monotonic() + 600
    while len(written := list((project / BATCHES).glob("*.parquet"))) < 3:
        assert time.monotonic() < deadline and process.poll() is None, f"{BATCHES}: {written}"
        time.sleep(0.2)
    # With two jobs at a time, that of the first batch has ended when the third is written.
    first = min(written, key=lambda path: path.stat().st_mtime_ns)
    finished_ns = first.stat().st_mtime_ns
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    run(project, *wanted)  # without --unlock: the lock of a killed run is free
    return str(first.relative_to(project)), finished_ns
