"""Locks of runs that were killed, and of those that are alive; processes stand for Snakemake."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from regional_lv.study.running import FOLDER, SNAKEMAKES

PROGRAM = """
import sys
from regional_lv.study import running
print({call}, flush=True)
sys.stdin.read()
"""


@pytest.fixture
def folder(tmp_path):
    """A working folder with Snakemake's locks of files of three studies."""
    (tmp_path / SNAKEMAKES).mkdir(parents=True)
    for number, study in enumerate(("mine", "other", "mine_too")):
        files = f"hearts/{study}.csv\nresults/{study}/geometry/mesh.vtu\n"
        for kind in ("input", "output"):
            (tmp_path / SNAKEMAKES / f"{number}.{kind}.lock").write_text(files)
    return tmp_path


@contextlib.contextmanager
def process(folder, call="running.begin('mine')"):
    """A process that has called and goes on; killed at the end."""
    source = str(Path(__file__).parents[2] / "src")
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM.format(call=call)],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": source},
        text=True,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as started:
        try:
            yield started
        finally:
            started.kill()


def said_by(folder, call="running.begin('mine')"):
    with process(folder, call) as started:
        return started.stdout.readline()


def locked(folder):
    return sorted({path.name[0] for path in (folder / SNAKEMAKES).iterdir()})


def test_what_a_killed_run_locked_is_free_again(folder):
    """Of its study alone; the same where it was killed before it locked anything."""
    for _ in range(2):
        said_by(folder)
        assert locked(folder) == ["1", "2"]


def test_a_run_that_is_alive_keeps_its_locks(folder):
    (folder / SNAKEMAKES).rename(folder / "kept")
    with process(folder) as first:
        first.stdout.readline()
        (folder / "kept").rename(folder / SNAKEMAKES)
        said = said_by(folder, "(running.begin('mine'), running.others())")
        assert f"under way in this folder: mine (process {first.pid}); wait" in said
        assert locked(folder) == ["0", "1", "2"]
        said_by(folder, "running.begin('other')")
        assert locked(folder) == ["0", "2"]
        first.send_signal(signal.SIGKILL)
        first.wait()
        assert "not under way on this machine" in said_by(folder, "running.others()")
    said_by(folder)
    assert locked(folder) == ["2"]


def test_jobs_of_a_killed_run_are_waited_for(folder):
    with process(folder, "running.take_part('mine')") as job:
        job.stdout.readline()
        with process(folder) as run:
            assert f"that was killed (process {job.pid})" in run.stderr.readline()
            time.sleep(0.3)
            assert locked(folder) == ["0", "1", "2"]
            job.kill()
            run.stdout.readline()
            assert locked(folder) == ["1", "2"]


def test_a_folder_that_cannot_be_written(tmp_path):
    (tmp_path / FOLDER.parts[0]).write_text("")
    assert said_by(tmp_path) == "None\n"
