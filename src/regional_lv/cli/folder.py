"""Where the configuration of a heart is, and the project that runs it."""

from collections.abc import Mapping
from pathlib import Path

import click

import regional_lv
from regional_lv import config as study_config
from regional_lv.errors import InputError
from regional_lv.hearts import CONFIG
from regional_lv.input_files import reason_of
from regional_lv.study import manifest
from regional_lv.study.layout import Layout


class Mistakes(click.ClickException):
    """What has to be corrected, one line per mistake; the command ends with 1."""

    def show(self, file=None) -> None:
        click.echo(self.message, err=True)


def config_file(name: str) -> Path:
    """The configuration of a folder that `new` wrote, or `name` itself if it is a file."""
    try:
        path = Path(name) / CONFIG if Path(name).is_dir() else Path(name)
        found = path.is_file()
    except OSError as error:  # no permission, a name that is too long
        raise Mistakes(f"{name[:100]}: {reason_of(error)}; check the path") from None
    if not found:
        raise Mistakes(f"{name}: no folder with a {CONFIG}, nor a configuration; check the path")
    return path


def load(path: Path, base: Path | None = None) -> dict:
    """The configuration `path`, on top of `base` if that is given, checked and completed."""
    files = [base, path] if base else [path]
    try:
        given = study_config.gather(files, {})
        return study_config.load(given, str(path), [file.parent for file in reversed(files)])
    except InputError as error:
        raise Mistakes(str(error)) from None


def check_results(path: Path, study: str) -> None:
    """Raise Mistakes if the study would overwrite the results of another one of its name, whose
    configuration is still there: the folder of one of them is a copy."""
    made = Layout.of(study)
    files = _written_from(made)
    same = path.resolve() in [Path(file).resolve() for file in files]
    if files and not same and Path(files[-1]).is_file():
        raise Mistakes(
            f"{path}: study: {made.folder} holds the results of {files[-1]}, which this study "
            f"would overwrite; give `study` a name of its own, or move {made.folder} to another "
            "place"
        )


def _written_from(made: Layout) -> list[str]:
    """The configuration files of a study's results: that of `claim_results`, or, of a study that
    Snakemake alone has run to its end, those of its manifest; none if there are no results."""
    if Path(made.claimed_by).is_file():
        return [Path(made.claimed_by).read_text().strip()]
    try:
        return manifest.read_manifest(made.folder)["configfiles"]
    except InputError:
        return []


def claim_results(path: Path, study: str) -> None:
    """Say in the folder of a study's results from which configuration they are."""
    file = Path(Layout.of(study).claimed_by)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f"{path}\n")
    except OSError as error:
        raise Mistakes(f"{file}: cannot be written ({reason_of(error)}); correct that") from None


def say_where(files: Mapping[str, str]) -> None:
    """Where those files are that there are, each by what it is."""
    for what, file in files.items():
        if Path(file).is_file():
            click.echo(f"{what}: {file}")


def checkout(given: str | None) -> Path:
    """The folder of the project, with its Snakefile: the one that is given, that the package was
    installed from, or the working directory."""
    installed_from = Path(regional_lv.__file__).resolve().parents[2]
    for folder in [Path(given)] if given else [installed_from, Path()]:
        if (folder / "workflow" / "rules").is_dir() and (folder / "Snakefile").is_file():
            return folder
    raise Mistakes(
        f"{given or 'here'}: no Snakefile of regional-lv; clone the project and name its folder "
        "(--workflow)"
    )
