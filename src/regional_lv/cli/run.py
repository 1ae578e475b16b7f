"""`regional-lv run`: the study of a heart, from its folder to posterior and criticism."""

from pathlib import Path

import click

from regional_lv.cli import workflow as started
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
@started.cores
@click.option(
    "--study",
    default="quick",
    show_default=True,
    help="The study's size: a configuration in the project's `config`, which NAME goes on top of.",
)
@started.workflow
@started.dry_run
def run(name: str, cores: int, study: str, workflow: str | None, dry_run: bool) -> None:
    """Check the folder NAME, run its study, and say where the results are.

    They go to results/<study> of the folder in which you start.
    """
    path, project = config_file(name), checkout(workflow)
    base = project / "config" / f"{study}.yaml"
    if not base.is_file():
        offered = ", ".join(sorted(file.stem for file in base.parent.glob("*.yaml")))
        raise Mistakes(f"--study {study}: there is no {base}; choose one of {offered}")
    started.require_snakemake()
    config = load(path, base)
    inspect(path, config, base)
    started.run_workflow(project, [base, path], cores, dry_run)
    folder = Path("results") / config["study"]
    for subject in config["subjects"]:
        for what, file in RESULTS.items():
            place = folder / file.format(subject=subject, emulator=final_emulator(config))
            if place.is_file():
                click.echo(f"{what} of {subject}: {place}")
