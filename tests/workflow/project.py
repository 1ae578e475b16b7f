"""A copy of the project, and Snakemake run in it on the smoke study."""

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from regional_lv.data.published import MIRROR_VARIABLE

PARTS = ("Snakefile", "workflow", "config", "src", "envs", "profiles")

WITHOUT_NETWORK = """
import os
import sys

ASKING = {"connect", "getaddrinfo", "gethostbyaddr", "gethostbyname", "sendmsg", "sendto"}


def refuse(event, arguments):
    if event.removeprefix("socket.") in ASKING:
        os.write(2, f"the network is asked: {event}{arguments}\\n".encode())
        os._exit(3)


sys.addaudithook(refuse)

from snakemake.cli import main

main(sys.argv[1:])
"""
"""Snakemake that ends, with exit code 3, at the first use of the network."""


def copy_project(root: Path, target: Path) -> Path:
    for part in PARTS:
        source = root / part
        if source.is_dir():
            # Compiled modules too, or jobs compile them; not those that are being written.
            shutil.copytree(source, target / part, ignore=shutil.ignore_patterns("*.pyc.*"))
        else:
            target.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target / part)
    return target


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "snakemake", "--configfile", "config/smoke.yaml", *arguments]


def planned(*arguments: str | Path) -> subprocess.CompletedProcess:
    """A dry run that may not use the network, without a mirror of published files."""
    return subprocess.run(
        [sys.executable, "-c", WITHOUT_NETWORK, "--dry-run", *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        env={name: value for name, value in os.environ.items() if name != MIRROR_VARIABLE},
    )


def environment(project: Path) -> dict[str, str]:
    """In which the copy's own library is imported, and not the one that is installed."""
    return os.environ | {"PYTHONPATH": str(project / "src")}


def attempt(
    project: Path, *arguments: str, before: Sequence[str] = (), timeout: float = 2400
) -> tuple[str, int]:
    """What Snakemake prints, and its exit code. before: a command that it is an argument of."""
    done = subprocess.run(
        [*before, *command(*arguments)],
        cwd=project,
        env=environment(project),
        capture_output=True,
        text=True,
        timeout=timeout,
    )
    return done.stdout + done.stderr, done.returncode


def run(project: Path, *arguments: str, check: bool = True, **options) -> str:
    """What Snakemake prints; options: of `attempt`. With `check` it has to succeed."""
    output, code = attempt(project, *arguments, **options)
    if check and code:
        pytest.fail(f"snakemake {' '.join(arguments)} failed:\n{output[-6000:]}")
    return output


def start(project: Path, *arguments: str, stderr: int = subprocess.DEVNULL) -> subprocess.Popen:
    """Snakemake, under way in a process group of its own."""
    return subprocess.Popen(
        command(*arguments),
        cwd=project,
        env=environment(project),
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=stderr,
        text=True,
    )
