"""`regional-lv cohort`: many hearts, from their folders to one page."""

from pathlib import Path

import click

from regional_lv import config as study_config
from regional_lv.cli import workflow as started
from regional_lv.cli.folder import (
    Mistakes,
    check_results,
    checkout,
    claim_results,
    config_file,
    load,
    say_where,
)
from regional_lv.errors import InputError
from regional_lv.study.layout import Layout


@click.command()
@click.argument("name")
@started.cores
@started.workflow
@started.dry_run
def cohort(name: str, cores: int, workflow: str | None, dry_run: bool) -> None:
    """Check all hearts of the cohort in the folder NAME (or the configuration NAME), answer them,
    and say where the results are.

    Its config.yaml names them: `cohort: hearts/*/`, or a table. Hearts that cannot be answered are
    left out and listed. Results go to results/<study>/cohort of the folder in which you start.
    """
    path, project = config_file(name), checkout(workflow)
    started.require_snakemake()
    config = load(path)
    inspect_cohort(path, config)
    if not dry_run:
        claim_results(path, config["study"])
    started.run_workflow(project, [path], cores, dry_run)
    files = Layout.of(config["study"]).cohort
    say_where(
        {
            "page": files.page,
            "table of everything": files.hearts,
            "population": files.population,
            "shared causes": files.causes,
        }
    )


def inspect_cohort(path: Path, config: dict) -> None:
    """Check all hearts of a loaded configuration, print what sets the scale of each answer, its
    warnings, and why hearts are left out.

    Raises Mistakes for a configuration without a cohort, and for one that cannot be answered.
    """
    # Imported here: they take seconds, and a mistake in the configuration need not wait for them.
    from regional_lv.hearts.cohort import reach_of_emulator, read_cohort
    from regional_lv.hearts.listing import list_hearts, model_of_hearts

    if not config["cohort"]["hearts"]:
        raise Mistakes(
            f"{path}: cohort: missing; name the hearts, such as `cohort: hearts/*/`, or give a "
            "table (CSV) of them"
        )
    check_results(path, config["study"])
    try:
        hearts = list_hearts(config["cohort"]["hearts"])
    except InputError as error:
        raise Mistakes(f"{path}: {error}") from None
    click.echo(f"{path}: study {config['study']}, {len(hearts)} hearts")
    try:
        found = read_cohort(
            hearts,
            study_config.read(path),
            [str(path.parent)],
            model_of_hearts(config),
            reach_of_emulator(),
        )
    except InputError as error:
        raise Mistakes(str(error)) from None
    for name, heart in found.hearts.items():
        click.echo(
            f"{name}: {heart.pressure_mmhg:g} mmHg; unloaded cavity {heart.cavity_ml:.1f} mL, wall "
            f"{heart.wall_ml:.1f} mL; {len(heart.table)} channels"
        )
        for line in heart.warnings:
            click.echo(f"{name}: warning: {line}")
    for name, why in found.left_out.items():
        click.echo(f"{name}: left out: {why}")
    click.echo(f"{len(found.hearts)} of {len(hearts)} hearts can be answered.")
