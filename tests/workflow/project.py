"""A copy of the project, and Snakemake run in it on the smoke study."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PARTS = ("Snakefile", "workflow", "config", "src", "envs", "profiles")


def copy_project(root: Path, target: Path) -> Path:
    for part in PARTS:
        source = root / part
        if source.is_dir():
            shutil.copytree(source, target / part, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            target.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target / part)
    return target


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "snakemake", "--configfile", "config/smoke.yaml", *arguments]


def run(project: Path, *arguments: str, check: bool = True) -> str:
    done = subprocess.run(
        command(*arguments), cwd=project, capture_output=True, text=True, timeout=1200
    )
    output = done.stdout + done.stderr
    if check and done.returncode:
        pytest.fail(f"snakemake {' '.join(arguments)} failed:\n{output[-6000:]}")
    return output
