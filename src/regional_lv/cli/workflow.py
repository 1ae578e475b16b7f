"""The project's workflow, started from the command line."""

import importlib.util
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import click

from regional_lv.cli.folder import Mistakes

cores = click.option("--cores", default=2, show_default=True, type=click.IntRange(min=1))
workflow = click.option(
    "--workflow",
    metavar="FOLDER",
    help="The project with its Snakefile; the one that the package was installed from, or the "
    "working directory, if this is not given.",
)
dry_run = click.option("--dry-run", is_flag=True, help="Say what would be made, and make nothing.")


def require_snakemake() -> None:
    """Raise Mistakes where it is not installed."""
    if importlib.util.find_spec("snakemake") is None:
        raise Mistakes("snakemake is not installed; `pip install 'regional-lv[workflow]'`")


def run_workflow(project: Path, files: Iterable[Path], cores: int, dry_run: bool) -> None:
    """Make the default target of the configuration `files`, the last of which counts first.

    Raises Mistakes where that fails.
    """
    command = [sys.executable, "-P", "-m", "snakemake", "--snakefile", str(project / "Snakefile")]
    command += ["--cores", str(cores), "--configfile", *map(str, files)]
    done = subprocess.run(command + ["--dry-run"] * dry_run)
    if done.returncode:
        raise Mistakes(f"snakemake ended with {done.returncode}; its last lines say why")
