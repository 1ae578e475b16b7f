"""Where the configuration of a heart is, and the project that runs it."""

from collections.abc import Mapping
from pathlib import Path

import click

import regional_lv
from regional_lv import config as study_config
from regional_lv.errors import InputError
from regional_lv.input_files import reason_of

CONFIG = "config.yaml"


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
