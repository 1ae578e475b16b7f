"""`regional-lv verify`: whether the results of a study are still what the study wrote."""

import contextlib
import json
from collections.abc import Iterator, Mapping, Sequence
from os.path import relpath
from pathlib import Path

import click

from regional_lv import config as study_config
from regional_lv.cli.folder import Mistakes
from regional_lv.errors import InputError
from regional_lv.input_files import reason_of
from regional_lv.study.manifest import checksum, read_manifest, versions


@click.command()
@click.argument("results")
@click.option(
    "--configfile",
    "configfiles",
    multiple=True,
    metavar="FILE",
    help="The study's configuration, where it is no longer in its place; of several the last one "
    "counts first.",
)
def verify(results: str, configfiles: tuple[str, ...]) -> None:
    """Check the folder RESULTS of a finished study, such as results/quick, against its manifest.

    Every file has to be there with its checksum, and the study's configuration has to be the one
    that it ran with. Versions that differ from those of this environment are listed; they are no
    error.
    """
    try:
        manifest = read_manifest(results)
    except InputError as error:
        raise Mistakes(str(error)) from None
    for name, here in versions().items():
        there = manifest["versions"].get(name)
        if there != here:
            click.echo(f"note: {name}: made with {there or 'none'}, here {here or 'none'}")
    folder = Path(results)
    lines = [*_files(folder, manifest), *_configuration(folder, manifest, configfiles)]
    if lines:
        raise Mistakes("\n".join(lines))
    count = len(manifest["files"] | manifest["files_with_times"])
    click.echo(f"{results}: {count} files and the configuration are as the manifest says.")


def _files(folder: Path, manifest: Mapping) -> Iterator[str]:
    for name, expected in sorted((manifest["files"] | manifest["files_with_times"]).items()):
        path = folder / name
        try:
            if checksum(path) != expected:
                yield (
                    f"{path}: changed since the study wrote it; delete it and run the study again"
                )
        except FileNotFoundError:
            yield f"{path}: missing; run the study again"
        except OSError as error:
            yield f"{path}: cannot be read ({reason_of(error)}); correct that"


def _configuration(folder: Path, manifest: Mapping, given: tuple[str, ...]) -> Iterator[str]:
    """What differs between the manifest's configuration and that of the files it came from."""
    files = [Path(file).resolve() for file in given]
    # The study ran in the folder that `results/<study>` is in, and its paths count from there.
    with contextlib.chdir(folder.resolve().parent.parent):
        files = files or [Path(file) for file in manifest["configfiles"]]
        gone = [file for file in files if not file.is_file()]
        for file in gone:
            yield (
                f"{file}: missing, and the configuration cannot be compared without it; name the "
                "file with --configfile"
            )
        if gone:
            return
        source = ", ".join(map(str, files))
        try:
            content = study_config.gather(files, manifest["overrides"])
            folders = [file.parent for file in reversed(files)]
            now = study_config.load(content, source, folders)
        except InputError as error:
            yield str(error)
            return
        before = [Path(file).parent for file in reversed(manifest["configfiles"])]
        moved = list(zip(before, folders, strict=False))
        # As JSON has it: what comes out of YAML may have other types.
        now = json.loads(json.dumps(now))
        for key, (then, value) in _differences(manifest["config"], now):
            if not _moved_along(then, value, moved):
                yield (
                    f"{source}: {key} was {json.dumps(then)} when the study ran and is "
                    f"{json.dumps(value)} now; change it back, or run the study again"
                )


def _moved_along(then, now, moved: Sequence[tuple[Path, Path]]) -> bool:
    """Whether two values are the same path, or list of such, from the folder of a configuration,
    which has `moved` from one to another."""
    if isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        return all(_moved_along(a, b, moved) for a, b in zip(then, now, strict=True))
    if not isinstance(then, str) or not isinstance(now, str):
        return then == now
    return any(relpath(then, before) == relpath(now, after) for before, after in moved)


def _differences(then, now, key: str = "") -> Iterator[tuple[str, tuple]]:
    """Keys (`section.key`) whose values differ, with both; None where one has no such key."""
    if isinstance(then, dict) and isinstance(now, dict):
        for name in sorted(then.keys() | now.keys()):
            inner = f"{key}.{name}" if key else name
            yield from _differences(then.get(name), now.get(name), inner)
    elif then != now:
        yield key, (then, now)
