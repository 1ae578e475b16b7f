"""`regional-lv run`: the study of a heart, from its folder to posterior and criticism."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import click

from regional_lv.cli.check import inspect
from regional_lv.cli.folder import Mistakes, checkout, config_file, load
from regional_lv.config import final_emulator

RESULTS = {
    "page": "pages/{subject}.html",
    "findings": "criticism/{subject}/findings.json",
    "posterior averaged over models": "criticism/{subject}/posterior.nc",
    "posterior of the model as it is": "posteriors/{emulator}/subjects/{subject}.nc",
}
"""What a person looks at, per subject, below `results/<study>`."""


@click.command()
@click.argument("name")
@click.option("--cores", default=2, show_default=True, type=click.IntRange(min=1))
@click.option(
    "--study",
    default="quick",
    show_default=True,
    help="The study's size: a configuration in the project's `config`, which NAME goes on top of.",
)
@click.option(
    "--workflow",
    metavar="FOLDER",
    help="The project with its Snakefile; the one that the package was installed from, or the "
    "working directory, if this is not given.",
)
@click.option("--dry-run", is_flag=True, help="Say what would be made, and make nothing.")
def run(name: str, cores: int, study: str, workflow: str | None, dry_run: bool) -> None:
    """Check the folder NAME, run its study, and say where the results are.

    They go to results/<study> of the folder in which you start.
    """
    path, project = config_file(name), checkout(workflow)
    base = project / "config" / f"{study}.yaml"
    if not base.is_file():
        offered = ", ".join(sorted(file.stem for file in base.parent.glob("*.yaml")))
        raise Mistakes(f"--study {study}: there is no {base}; choose one of {offered}")
    if importlib.util.find_spec("snakemake") is None:
        raise Mistakes("snakemake is not installed; `pip install 'regional-lv[workflow]'`")
    config = load(path, base)
    inspect(path, config, base)
    command = [sys.executable, "-P", "-m", "snakemake", "--snakefile", str(project / "Snakefile")]
    command += ["--cores", str(cores), "--configfile", str(base), str(path)]
    # Each job is a process of its own; libraries that take all cores in each slow them down.
    environment = {"OMP_NUM_THREADS": "1"} | os.environ
    done = subprocess.run(command + ["--dry-run"] * dry_run, env=environment)
    if done.returncode:
        raise Mistakes(f"snakemake ended with {done.returncode}; its last lines say why")
    folder = Path("results") / config["study"]
    for subject in config["subjects"]:
        for what, file in RESULTS.items():
            place = folder / file.format(subject=subject, emulator=final_emulator(config))
            if place.is_file():
                click.echo(f"{what} of {subject}: {place}")
