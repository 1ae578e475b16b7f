"""Faults while the smoke study runs, or between two runs: `make test-faults`.

Each goes on, or stops with a message that says what to do, without a traceback; in the end the
tables are those of a study that nothing disturbed. Needs root (small disks are mounted).
"""

import os
import random
import shutil
import signal
import subprocess
import time
from pathlib import Path

import psutil
import pytest

from tests.workflow.project import attempt, copy_project, run, start
from tests.workflow.same import assert_same, tables

RESULTS = Path("results/smoke")
BOTH = "--cores", "2"
KILLS = 10
START = 5.0  # seconds until the first job runs
SEED = 2026


def finish(project: Path, *arguments: str, **options) -> str:
    """It has to succeed; the whole study on two cores, unless arguments say otherwise."""
    return run(project, *(arguments or BOTH), timeout=1800, **options)


def refuse(project: Path, *words: str, arguments: tuple[str, ...] = BOTH, **options) -> str:
    """It has to fail with these words in its messages and no traceback."""
    output, code = attempt(project, *arguments, timeout=1800, **options)
    assert code, output[-3000:]
    for word in words:
        assert word in output, output[-6000:]
    assert "Traceback" not in output, output[-6000:]
    return output


def assert_undisturbed(project: Path, study: Path) -> None:
    """All tables are there and as in the undisturbed study."""
    names = tables(study / RESULTS)
    assert len(names) > 100 and names == tables(project / RESULTS)
    for name in sorted(names):
        assert_same(study / RESULTS / name, project / RESULTS / name)


@pytest.fixture(scope="session")
def study(root, tmp_path_factory) -> Path:
    """The smoke study, undisturbed."""
    project = copy_project(root, tmp_path_factory.mktemp("study") / "project")
    begun = time.monotonic()
    finish(project)
    (project / "seconds").write_text(str(time.monotonic() - begun))
    return project


@pytest.fixture
def finished(study, tmp_path) -> Path:
    """A copy of it, times included, in which nothing is left to do."""
    project = tmp_path / "project"
    shutil.copytree(study, project, symlinks=True)
    return project


def damage(path: Path, change) -> None:
    """Change a file's bytes and neither its time nor its place."""
    times = path.stat().st_atime_ns, path.stat().st_mtime_ns
    path.write_bytes(change(path.read_bytes()))
    os.utime(path, ns=times)


def jobs_of(process: subprocess.Popen) -> list[int]:
    """Processes of the jobs that this Snakemake runs."""
    try:
        return [p.pid for p in psutil.Process(process.pid).children() if _is_job(p)]
    except psutil.NoSuchProcess:
        return []


def _is_job(process: psutil.Process) -> bool:
    try:
        return any("call.py" in part for part in process.cmdline())
    except psutil.NoSuchProcess:
        return False


def kill(process: subprocess.Popen, whom: str) -> None:
    if whom == "all":
        os.killpg(process.pid, signal.SIGKILL)
    elif whom == "snakemake":
        os.kill(process.pid, signal.SIGKILL)
    else:
        for job in jobs_of(process)[:1]:
            os.kill(job, signal.SIGKILL)


def test_kills_at_random_moments(study, root, tmp_path):
    """Of Snakemake with its jobs, of Snakemake alone (its jobs go on and write), of one job."""
    project, moment = copy_project(root, tmp_path / "project"), random.Random(SEED)
    # Ten kills within one study: each run gets a little further.
    latest = START + float((study / "seconds").read_text()) / KILLS
    killed = 0
    while killed < KILLS:
        whom = ("all", "snakemake", "job")[killed % 3]
        process = start(project, *BOTH, stderr=subprocess.PIPE)
        try:
            process.wait(moment.uniform(START, latest))
            break  # it has finished before its next kill
        except subprocess.TimeoutExpired:
            kill(process, whom)
        if whom == "job":
            time.sleep(1)
            process.terminate()  # one goes on with what does not need the job
        if whom != "snakemake":
            error = process.communicate(timeout=600)[1]
            assert "Traceback" not in error, error[-6000:]
        process.wait(600)
        process.stderr.close()
        killed += 1
    assert killed >= 8, "too few kills: the study is faster than its moments"
    finish(project)
    assert_undisturbed(project, study)
    print(f"{killed} kills")


def test_two_runs_at_once(finished, study):
    # What is missing and no target is made again only for what is missing, too.
    for name in ("posteriors/final/subjects", "tables", "figures"):
        shutil.rmtree(finished / RESULTS / name)
    first = start(finished, "--cores", "1")
    while not jobs_of(first):
        assert first.poll() is None
        time.sleep(0.5)
    refuse(
        finished, f"another run is under way in this folder: smoke (process {first.pid})", "wait"
    )
    assert first.wait(900) == 0
    assert_undisturbed(finished, study)


@pytest.mark.parametrize(
    ("damaged", "removed"),
    [
        ("simulations/train/batch-0000.parquet", "screening/train.parquet"),
        ("emulators/exact_gp.pt", "emulators/exact_gp/test_errors.csv"),
        ("posteriors/final/subjects/synthetic_lateral.nc", "tables/subjects.csv"),
        ("mechanics/predictor.npz", "simulations/test/batch-0000.parquet"),
        ("geometry/mesh.vtu", "figures/zones.png"),
        ("estimates/shortlist.json", "figures/uncertainty.png"),
    ],
)
@pytest.mark.parametrize("how", ["truncated", "empty", "overwritten"])
def test_a_damaged_file_is_named(finished, study, damaged, removed, how):
    path, target = finished / RESULTS / damaged, finished / RESULTS / removed
    assert path.is_file() and target.is_file()
    changes = {
        "truncated": lambda content: content[: len(content) // 2],
        "empty": lambda content: b"",
        "overwritten": lambda content: os.urandom(len(content)),
    }
    damage(path, changes[how])
    target.unlink()
    goal = "--cores", "1", str(RESULTS / removed)
    refuse(finished, damaged, "delete it", arguments=goal)
    path.unlink()
    finish(finished, *goal)
    for name in (damaged, removed):
        if (RESULTS / name).suffix in (".csv", ".json", ".parquet"):
            assert_same(study / RESULTS / name, finished / RESULTS / name)


@pytest.fixture
def small_disk(finished):
    """Its results on a disk of their own, with what the posteriors need removed."""
    results = finished / "results"
    shutil.move(results, finished / "kept")
    results.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=200m", "tmpfs", str(results)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.fail("a small disk cannot be mounted; run as root: sudo make test-faults")
    shutil.copytree(finished / "kept", results, dirs_exist_ok=True)
    for name in ("posteriors/final/subjects", "figures"):
        shutil.rmtree(finished / RESULTS / name)
    yield finished
    subprocess.run(["umount", str(results)], check=True)


def remount(project: Path, options: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{options}", str(project / "results")], check=True)


def test_a_full_disk(small_disk, study):
    used = sum(p.stat().st_blocks * 512 for p in (small_disk / "results").rglob("*"))
    remount(small_disk, f"size={used + 200_000}")
    refuse(small_disk, "no space left", "make room")
    remount(small_disk, "size=200m")
    finish(small_disk)
    assert_undisturbed(small_disk, study)


def test_a_read_only_folder(small_disk, study):
    """Files that would be overwritten are found before anything runs."""
    remount(small_disk, "ro")
    refuse(small_disk, "Write-protected output files", str(RESULTS))
    remount(small_disk, "rw")
    finish(small_disk)
    assert_undisturbed(small_disk, study)


def test_too_little_memory(finished, study):
    """What a job may take is less than it needs, as on a machine with less memory."""
    shutil.rmtree(finished / RESULTS / "posteriors/final/subjects")
    (finished / RESULTS / "tables/subjects.csv").unlink()
    refuse(finished, "memory", "--cores 1", before=("prlimit", "--as=1100000000"))
    finish(finished)
    assert_undisturbed(finished, study)


@pytest.mark.parametrize("jump", ["-2d", "+2d"])
def test_a_clock_that_jumps(study, finished, jump):
    """The second half of the study runs at another date than the first. Of outputs that are older
    than their inputs Snakemake keeps none."""
    if shutil.which("faketime") is None:
        pytest.fail("Debian's faketime is missing: apt-get install faketime")
    for name in ("posteriors/final/subjects", "tables", "pages"):
        shutil.rmtree(finished / RESULTS / name)
    elsewhen = "faketime", "--exclude-monotonic", "-f", jump
    if jump.startswith("-"):
        refuse(finished, "clock skew", before=elsewhen)
    else:
        finish(finished, before=elsewhen)
    finish(finished)
    assert_undisturbed(finished, study)
