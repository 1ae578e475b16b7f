"""`regional-lv run`: a heart, from its folder to posterior and criticism."""

import importlib.util
import tempfile
from collections.abc import Mapping
from pathlib import Path

import click
import yaml

from regional_lv.cli import workflow as started
from regional_lv.cli.check import inspect
from regional_lv.cli.folder import (
    Mistakes,
    checkout,
    claim_results,
    config_file,
    load,
    say_where,
)
from regional_lv.errors import InputError
from regional_lv.hearts import ONE_HEART
from regional_lv.study.layout import Layout

SIMULATOR = ("dolfinx", "dolfinx_solver")
"""Modules of which one brings the simulator."""


def _way(way: str, text: str):
    return click.option(f"--{way}", "way", flag_value=way, help=text)


@click.command()
@click.argument("name")
@_way(
    "fast",
    "Answer from the emulator of any heart alone, without a simulation. The default where the "
    "simulator or Snakemake is not installed.",
)
@_way(
    "full",
    "The fast answer first; then some simulations of this heart join the emulator, and what stands "
    "out gets a name. The default elsewhere. A heart that the emulator does not know gets its own.",
)
@_way("own", "An emulator of this heart alone, from simulations of it.")
@started.cores
@click.option(
    "--study",
    help="The size of a study of its own (--own): a configuration in the project's `config`, which "
    "NAME goes on top of; `quick` if this is not given.",
)
@started.workflow
@started.dry_run
def run(
    name: str, way: str | None, cores: int, study: str | None, workflow: str | None, dry_run: bool
) -> None:
    """Check the folder NAME, answer for its heart, and say where the results are.

    They go to results/<study> of the folder in which you start.
    """
    path = config_file(name)
    if study and way not in (None, "own"):
        raise Mistakes(f"--study {study}: goes with --own, not with --{way}; remove one of them")
    if way is None:
        way = "own" if study else "full" if _can_simulate(workflow) else "fast"
    base, cut = ONE_HEART, {}
    if way != "own":
        config = _checked(path, base, dry_run)
        # Imported here: it takes seconds, and a mistake in a table need not wait for it.
        from regional_lv.hearts.file import shipped
        from regional_lv.hearts.reach import OutOfReach

        try:
            shipped()
        except InputError as error:
            raise Mistakes(f"{error}; --own goes without it") from None
        try:
            if not dry_run:
                _answer_fast(config)
            if way == "full" or (dry_run and config["geometry"]["source"] == "segments"):
                cut = _cut_to_reach(config)
        except OutOfReach as error:
            if way == "fast":
                raise Mistakes(f"{path}: {error}") from None
            click.echo(f"{path}: {error}; so it is simulated")
            way = "own"
        except InputError as error:
            raise Mistakes(f"{path}: {error}") from None
    if way == "own":
        base = _base_of(study or "quick", workflow)
        _checked(path, base, dry_run)
    if way != "fast":
        _simulate(path, base, cores, workflow, dry_run, cut)


def _base_of(study: str, workflow: str | None) -> Path:
    """The project's configuration of a study of its own."""
    base = checkout(workflow) / "config" / f"{study}.yaml"
    if not base.is_file():
        offered = ", ".join(sorted(file.stem for file in base.parent.glob("*.yaml")))
        raise Mistakes(f"--study {study}: there is no {base}; choose one of {offered}")
    return base


def _checked(path: Path, base: Path, dry_run: bool) -> dict:
    """The configuration of one heart, whose files were checked as well; from now on its results are
    its own."""
    config = load(path, base)
    if config["cohort"]["hearts"]:
        raise Mistakes(
            f"{path}: cohort: names many hearts, and `run` is for one; use `regional-lv cohort`"
        )
    inspect(path, config, base)
    if not dry_run:
        claim_results(path, config["study"])
    return config


def _can_simulate(workflow: str | None) -> bool:
    """Whether the simulator and Snakemake are installed, and there is a project to run."""
    known = [importlib.util.find_spec(module) is not None for module in SIMULATOR]
    if not any(known) or importlib.util.find_spec("snakemake") is None:
        return False
    try:
        checkout(workflow)
    except Mistakes:
        return False
    return True


def _answer_fast(config: Mapping) -> None:
    """Answer for all subjects from the emulator of any heart, and say where. Raises InputError."""
    from regional_lv.hearts.fast import answer

    for subject, given in config["subjects"].items():
        files = Layout.of(config["study"]).fast(subject)
        answer({**config, "subjects": {subject: given}}, files.folder)
        say_where(_shown(subject, files.page, files.findings, files.posterior))


def _cut_to_reach(config: Mapping) -> dict[str, dict]:
    """Keys of the configuration that are cut to what the emulator knows. Raises InputError."""
    from regional_lv.hearts.file import shipped
    from regional_lv.hearts.reach import within_by_table

    with tempfile.TemporaryDirectory() as folder:
        within_reach, _ = within_by_table(config, shipped(), Path(folder, "segments.csv"))
    return _changed(within_reach, config)


def _changed(config: Mapping, before: Mapping) -> dict[str, dict]:
    """Entries of the sections of stiffness and inputs that are not as before."""
    found: dict[str, dict] = {}
    for key in ("parameters", "inputs"):
        own = {k: v for k, v in config[key].items() if v != before[key].get(k)}
        found |= {key: own} if own else {}
    return found


def _simulate(
    path: Path, base: Path, cores: int, workflow: str | None, dry_run: bool, cut: Mapping
) -> None:
    """Run the study of a heart; `cut` goes on top of its configuration."""
    project = checkout(workflow)
    started.require_snakemake()
    config = load(path, base)
    made, given = Layout.of(config["study"]), [base, path]
    with tempfile.TemporaryDirectory() as temporary:
        if cut:
            file = Path(made.cut)
            given.append(Path(temporary, file.name) if dry_run else file)
            given[-1].parent.mkdir(parents=True, exist_ok=True)
            given[-1].write_text(yaml.safe_dump(cut))
        started.run_workflow(project, given, cores, dry_run)
    for subject in config["subjects"]:
        say_where(
            _shown(subject, made.page(subject), made.findings(subject), made.posterior(subject))
        )


def _shown(subject: str, page: str, findings: str, posterior: str) -> dict[str, str]:
    """What a person looks at of a subject, in words, and where it is."""
    return {
        f"page of {subject}": page,
        f"findings of {subject}": findings,
        f"posterior averaged over models of {subject}": posterior,
    }
