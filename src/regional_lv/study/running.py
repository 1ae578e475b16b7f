"""Which runs of a study are under way in the working folder, and what killed ones left locked.

Every Snakemake of a study, and each of its jobs, shares a lock of the kernel's (flock) until its
process ends, however it ends. Where nobody holds it, locks of Snakemake's that are still there are
those of a run that was killed. Several studies may run in one folder.
"""

import fcntl
import os
import sys
from pathlib import Path
from typing import TextIO

from regional_lv.study.layout import Layout

FOLDER = Path(".snakemake/regional_lv")
"""Of the files that are locked: `<study>.runs` by Snakemake, `<study>.jobs` by jobs."""
SNAKEMAKES = Path(".snakemake/locks")

_held: dict[str, TextIO] = {}


def begin(study: str) -> None:
    """Take part in a study as the process that plans and starts its jobs.

    If no other one is alive, what a killed one had locked is free again; jobs that go on without
    it are waited for, and a line on stderr says so. Without a file system that has such locks,
    nothing happens.
    """
    if "runs" in _held or not (file := _open(study, "runs")):
        return
    left = _left(study)
    if left and _lock(file, fcntl.LOCK_EX | fcntl.LOCK_NB):
        _wait_for_jobs(study)
        for path in left:
            path.unlink(missing_ok=True)
    if _lock(file, fcntl.LOCK_SH):
        _held["runs"] = file


def take_part(study: str) -> None:
    """Take part in a study as a job of it."""
    if "jobs" not in _held and (file := _open(study, "jobs")) and _lock(file, fcntl.LOCK_SH):
        _held["jobs"] = file


def others() -> str:
    """In words, who has locked what this process wants to make."""
    found = {path.stem: _holders(path) for path in sorted(FOLDER.glob("*.runs"))}
    runs = [f"{study} (process {n})" for study, numbers in found.items() for n in numbers]
    if runs:
        return (
            f"another run is under way in this folder: {', '.join(runs)}; wait until it ends, or "
            "end it, and run the same command again"
        )
    return (
        "another run has locked files of this study, and it is not under way on this machine; wait "
        "until it ends elsewhere, or run the same snakemake command with --unlock and then again"
    )


def _open(study: str, kind: str) -> TextIO | None:
    try:
        FOLDER.mkdir(parents=True, exist_ok=True)
        return (FOLDER / f"{study}.{kind}").open("a")
    except OSError:  # a folder that cannot be written
        return None


def _lock(file: TextIO, how: int) -> bool:
    try:
        fcntl.flock(file, how)
    except OSError:  # held by another process, or not known to the file system
        return False
    return True


def _left(study: str) -> list[Path]:
    """Snakemake's locks of files of the study."""
    files, found = f"{Layout.of(study).folder}/", []
    for path in SNAKEMAKES.glob("*.lock"):
        try:
            if any(line.startswith(files) for line in path.read_text().splitlines()):
                found.append(path)
        except OSError:  # gone meanwhile
            continue
    return found


def _wait_for_jobs(study: str) -> None:
    file = _open(study, "jobs")
    if file is None:
        return
    with file:
        if not _lock(file, fcntl.LOCK_EX | fcntl.LOCK_NB):
            numbers = ", ".join(map(str, _holders(FOLDER / f"{study}.jobs")))
            print(
                f"note: waiting for jobs of a run that was killed (process {numbers})",
                file=sys.stderr,
            )
            _lock(file, fcntl.LOCK_EX)


def _holders(path: Path) -> list[int]:
    """Processes on this machine, without this one, that share the lock of a file."""
    inode = path.stat().st_ino
    rows = (line.split() for line in Path("/proc/locks").read_text().splitlines())
    # Such as `1: FLOCK ADVISORY READ 1234 08:01:5678 0 EOF`; who waits has `->` before FLOCK.
    holds = [row for row in rows if row[1] == "FLOCK" and row[5].rpartition(":")[2] == str(inode)]
    return sorted({int(row[4]) for row in holds} - {os.getpid()})
