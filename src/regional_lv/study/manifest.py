"""The manifest of a study: what it was made with, and checksums of what it made."""

import hashlib
import json
import os
import platform
import subprocess
from collections.abc import Iterable, Mapping
from fnmatch import fnmatch
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from regional_lv.errors import InputError
from regional_lv.input_files import reason_of
from regional_lv.study.layout import Layout

PACKAGES = {
    "dolfinx": ("fenics-dolfinx", "dolfinx-solver-real"),
    **{
        name: (name,)
        for name in (
            "numpy",
            "scipy",
            "pandas",
            "pyarrow",
            "scikit-learn",
            "gmsh",
            "matplotlib",
            "torch",
            "gpytorch",
            "linear-operator",
            "pyro-ppl",
            "arviz",
            "snakemake",
        )
    },
    "regional-lv": ("regional-lv",),
}
"""What numbers and figures depend on, and the names under which it may be installed."""

HOLD_TIMES = (
    "screening/*.parquet",
    "all_inputs/*.parquet",
    "all_inputs/*emulator.pt",
    "all_inputs/*fit.json",
    "emulators/*.pt",
    "posteriors/*.nc",
    "posteriors/*/diagnostics.csv",
    "tables/ranking.*",
    "tables/paper_comparison.*",
    "tables/sample_efficiency.*",
    "figures/sample_efficiency.csv",
)
"""Files that also hold wall or CPU seconds, and differ from run to run in these alone."""


def write_manifest(
    results: Iterable[str | Path],
    config: Mapping,
    configfiles: Iterable[str],
    overrides: Mapping,
    manifest: str | Path,
) -> None:
    """Write the manifest (JSON) of a study beside what it made.

    Parameters
    ----------
    results: files that the study made, in the folder of the manifest or below it.
    config: the study's configuration, complete.
    configfiles: where it came from, the last one counts first; paths from the working directory.
    overrides: keys that were given on the command line and count before all files.

    The file holds `study`, `seed`, `versions` (`versions()`), `config`, `configfiles`, `overrides`,
    and SHA-256 checksums by path: in `files` of what another run of the study makes bit by bit, in
    `files_with_times` of what also holds the seconds that something took (`HOLD_TIMES`).
    """
    folder = Path(manifest).parent
    names = sorted(Path(os.path.relpath(file, folder)).as_posix() for file in set(results))
    checksums = {name: checksum(folder / name) for name in names}
    content = {
        "study": config["study"],
        "seed": config["seed"],
        "versions": versions(),
        "config": config,
        "configfiles": list(configfiles),
        "overrides": dict(overrides),
        "files": {n: c for n, c in checksums.items() if not holds_times(n)},
        "files_with_times": {n: c for n, c in checksums.items() if holds_times(n)},
    }
    Path(manifest).write_text(json.dumps(content, indent=1) + "\n")


def read_manifest(folder: str | Path) -> dict:
    """What the manifest of the results in `folder` holds. Raises InputError."""
    path = Path(Layout(str(folder)).manifest)
    try:
        content = json.loads(path.read_text())
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({reason_of(error)}); name the folder of a study that has run "
            "to its end, such as results/quick"
        ) from error
    except ValueError as error:
        raise InputError(
            f"{path}: not valid JSON ({error}); restore it, or delete it and run the study again"
        ) from error
    sections = ("versions", "config", "overrides", "files", "files_with_times")
    if (
        not isinstance(content, dict)
        or not all(isinstance(content.get(key), dict) for key in sections)
        or not isinstance(content.get("configfiles"), list)
    ):
        raise InputError(
            f"{path}: not the manifest of a study; restore it, or delete it and run the study again"
        )
    return content


def checksum(file: str | Path) -> str:
    """SHA-256 of a file's content, in hexadecimal digits."""
    with open(file, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def holds_times(name: str) -> bool:
    """Whether the result `name` (its path below the study's folder) differs from run to run."""
    return any(fnmatch(name, pattern) for pattern in HOLD_TIMES)


def versions() -> dict[str, str | None]:
    """Versions of Python, of `PACKAGES`, and the commit of the project's checkout, with `-dirty`
    behind it if files were edited; None for what is not there."""
    found: dict[str, str | None] = {"python": platform.python_version()}
    found |= {name: _version(names) for name, names in PACKAGES.items()}
    return found | {"regional-lv commit": _commit(Path(__file__).resolve().parents[3])}


def _version(names: Iterable[str]) -> str | None:
    for name in names:
        try:
            return version(name)
        except PackageNotFoundError:
            continue
    return None


def _commit(checkout: Path) -> str | None:
    # A copy of the project inside another repository has no commit of its own.
    if not (checkout / ".git").exists():
        return None
    describe = ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    try:
        done = subprocess.run(describe, cwd=checkout, capture_output=True, text=True)
    except OSError:
        return None
    return done.stdout.strip() or None
