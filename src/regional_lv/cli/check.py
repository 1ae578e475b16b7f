"""`regional-lv check`: errors and warnings about the input files, before anything runs."""

import contextlib
import io
import json
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

import click
import pandas as pd

from regional_lv import config as study_config
from regional_lv.cli.cohort import inspect_cohort
from regional_lv.cli.folder import Mistakes, check_results, config_file, load
from regional_lv.cli.scale import heart_lines, role_lines, subject_lines
from regional_lv.errors import InputError
from regional_lv.hearts import CONFIG, ONE_HEART
from regional_lv.hearts.checks import (
    geometry_of,
    heart_warnings,
    measured_subjects,
    not_given,
    place_warnings,
    read_subject,
    uneven,
    unusual,
)
from regional_lv.input_files import reason_of
from regional_lv.study.layout import HeartFiles, Layout

PICTURE = "check.png"


@click.command()
@click.argument("name")
def check(name: str) -> None:
    """Report errors, missing values and unusual values in the folder NAME (or the configuration
    NAME), and draw the heart and its strains (check.png). Of a cohort: of every heart, without
    pictures."""
    path = config_file(name)
    base = ONE_HEART if path.name == CONFIG else None  # as `run` takes a heart's folder
    config = load(path, base)
    if config["cohort"]["hearts"]:
        inspect_cohort(path, config)
    else:
        inspect(path, config, base)


def inspect(path: Path, config: dict, base: Path | None = None) -> None:
    """Check the heart and the measured values of a loaded configuration, print what sets the scale
    of the answer and warnings, and draw them beside `path`. base: what `path` went on top of.

    Raises Mistakes for a geometry that cannot be meshed, volumes that it cannot have, and results
    that are another configuration's.
    """
    # Imported here: they take seconds, and a mistake in a table need not wait for them.
    from vtkmodules.vtkCommonCore import vtkLogger

    from regional_lv.channels import Channels
    from regional_lv.geometry.from_config import make_heart
    from regional_lv.geometry.meshing import write_plain
    from regional_lv.inputs.space import Inputs, sections_of
    from regional_lv.inputs.stiffness import StiffnessInputs
    from regional_lv.measured.plausibility import data_warnings, too_small
    from regional_lv.plots import inputs
    from regional_lv.quantities.seth_hill import Measure

    # Without a display VTK says so, and draws all the same.
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    layers = [(file, study_config.read(file)) for file in (path, base) if file]
    own = layers[0][1]
    if lines := not_given(config, own):
        raise Mistakes("\n".join(f"{path}: {line}" for line in lines))
    check_results(path, config["study"])
    parameters, channels = StiffnessInputs.from_config(config), Channels.from_config(config)
    measure = Measure.of(config["observables"])
    measured = {name: read_subject(name, config, channels) for name in measured_subjects(config)}
    tables = {name: subject.table for name, subject in measured.items()}
    click.echo(f"{path}: study {config['study']}, geometry {geometry_of(config)}")
    picture, found = path.parent / PICTURE, heart_warnings(config)
    with tempfile.TemporaryDirectory() as temporary:
        files = HeartFiles(f"{temporary}/")
        try:
            with _own_words(found):
                mesh = make_heart(config, files, lay_out=write_plain)
        except InputError as error:
            _echo_warnings(found)
            raise Mistakes(str(error)) from None
        summary = json.loads(Path(files.summary).read_text())
        cavity, wall = summary["cavity_volume_ml"], summary["wall_volume_ml"]
        for line in heart_lines(config, layers, cavity, wall, geometry_of(config)):
            click.echo(line)
        if config["simulations"]["source"] != "table":
            for line in role_lines(Inputs.from_config(sections_of(config))):
                click.echo(line)
        segments = pd.read_csv(files.segments, index_col="aha_segment")
        found += uneven(segments)
        found += unusual(segments["thickness_mm"].median(), cavity)
        try:
            with _own_words(found):
                inputs.draw(mesh, tables, parameters, picture)
        except OSError as error:
            found.append(f"{picture}: the picture cannot be written ({reason_of(error)})")
    found += place_warnings(path, own, config)
    folder = path.resolve().parent.name
    if path.name == CONFIG and folder != config["study"]:
        found.append(
            f"the folder is {folder}, and the results go to {Layout.of(config['study']).folder}; "
            "if the folder is a copy, give `study` a name of its own"
        )
    for name, table in tables.items():
        subject = config["subjects"][name]
        file = subject["curves" if subject["source"] == "curves" else "measured"]
        told = f"{len(table)} of {len(channels)} channels, {file}{measured[name].told}"
        for line in (told, *subject_lines(name, subject, layers, table, measured[name].frames)):
            click.echo(f"{name}: {line}")
        known = (len(parameters), measure, cavity, wall, subject["source"] == "curves")
        lines = data_warnings(table, channels, *known)
        found += [f"{name}: {line}" for line in (*measured[name].doubts, *lines)]
    if all(subject["source"] == "synthetic" for subject in config["subjects"].values()):
        found.append(
            "no measured subject; the synthetic ones of the configuration would be run: name a "
            "file in `subjects`"
        )
    _echo_warnings(found)
    if picture.is_file():
        click.echo(f"picture: {picture}")
    mistakes = {name: too_small(table, cavity) for name, table in tables.items()}
    lines = [f"{path}: subjects.{name}: {mistake}" for name, mistake in mistakes.items() if mistake]
    if lines:
        raise Mistakes("\n".join(lines))
    click.echo(f"No errors{', but see the warnings above' if found else ''}.")


def _echo_warnings(found: list[str]) -> None:
    for line in found:
        click.echo(f"warning: {line}")


@contextlib.contextmanager
def _own_words(found: list[str]) -> Iterator[None]:
    """Within it, warnings that the package logs about the heart go to `found`. What libraries log,
    warn of and print speaks of their insides, and is kept back."""
    from regional_lv.hearts.cohort import collected_warnings

    with collected_warnings() as told:
        try:
            with (
                warnings.catch_warnings(action="ignore"),
                contextlib.redirect_stdout(io.StringIO()),
                contextlib.redirect_stderr(io.StringIO()),
            ):
                yield
        finally:
            found += [f"heart: {line}" for line in told]
