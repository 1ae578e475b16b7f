"""`regional-lv check`: errors and warnings about the input files, before anything runs."""

import contextlib
import io
import json
import logging
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import click
import pandas as pd

from regional_lv import config as study_config
from regional_lv import manifest
from regional_lv.aha import LEVELS
from regional_lv.cli.folder import CONFIG, Mistakes, config_file, load
from regional_lv.cli.scale import heart_lines, subject_lines
from regional_lv.data import VOLUNTEER
from regional_lv.errors import InputError
from regional_lv.geometry.table import read_segments
from regional_lv.input_files import reason_of
from regional_lv.schema import load_schema

PICTURE = "check.png"

UNEVEN = 2.0
"""Ratio of a wall's thickness to the median of its level, either way, beyond which it is odd."""

USUAL_MM, USUAL_ML = (4.0, 20.0), (25.0, 400.0)
"""Median thickness of the wall and cavity of an unloaded adult ventricle, hypertrophic and dilated
ones among them. A heart outside may be right, and is more often in another unit."""

SIZES = ["wall_thickness_mm", "endo_radius_mm"]

LOW_PRESSURE_MMHG, HIGH_PRESSURE_MMHG = 3.0, 30.0
"""An end-diastolic pressure below is in kPa more likely than true; one above is rare."""


@click.command()
@click.argument("name")
def check(name: str) -> None:
    """Report errors, missing values and unusual values in the folder NAME (or the configuration
    NAME), and draw the heart and its strains (check.png)."""
    path = config_file(name)
    inspect(path, load(path))


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
    from regional_lv.measured.plausibility import data_warnings, too_small
    from regional_lv.parameters import Parameterisation
    from regional_lv.plots import inputs

    # Without a display VTK says so, and draws all the same.
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    layers = [(file, study_config.read(file)) for file in (path, base) if file]
    own = layers[0][1]
    _check_given(path, config, own)
    _check_results(path, config["study"])
    parameters, channels = Parameterisation.from_config(config), Channels.from_config(config)
    exponent = config["observables"]["strain_exponent"]
    measured = {name: _read(name, config, channels) for name in _own(config)}
    tables = {name: subject.table for name, subject in measured.items()}
    click.echo(f"{path}: study {config['study']}, geometry {_geometry(config)}")
    picture, found = path.parent / PICTURE, _heart_warnings(config)
    with tempfile.TemporaryDirectory() as folder:
        try:
            with _own_words(found):
                mesh = make_heart(config, folder, lay_out=write_plain)
        except InputError as error:
            _echo_warnings(found)
            raise Mistakes(str(error)) from None
        summary = json.loads((Path(folder) / "summary.json").read_text())
        cavity, wall = summary["cavity_volume_ml"], summary["wall_volume_ml"]
        for line in heart_lines(config, layers, cavity, wall, _geometry(config)):
            click.echo(line)
        segments = pd.read_csv(Path(folder) / "segments.csv", index_col="aha_segment")
        found += _uneven(segments)
        found += _unusual(segments["thickness_mm"].median(), cavity)
        try:
            with _own_words(found):
                inputs.draw(mesh, tables, parameters, picture)
        except OSError as error:
            found.append(f"{picture}: the picture cannot be written ({reason_of(error)})")
    found += _place_warnings(path, own, config)
    folder = path.resolve().parent.name
    if path.name == CONFIG and folder != config["study"]:
        found.append(
            f"the folder is {folder}, and the results go to results/{config['study']}; if the "
            "folder is a copy, give `study` a name of its own"
        )
    for name, table in tables.items():
        subject = config["subjects"][name]
        file = subject["curves" if subject["source"] == "curves" else "measured"]
        told = f"{len(table)} of {len(channels)} channels, {file}{measured[name].told}"
        for line in (told, *subject_lines(name, subject, layers, table, measured[name].frames)):
            click.echo(f"{name}: {line}")
        known = (len(parameters), exponent, cavity, wall, subject["source"] == "curves")
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

    class Handler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.name.startswith("regional_lv"):
                found.append(f"heart: {record.getMessage()}")

    handler, root = Handler(logging.WARNING), logging.getLogger()
    root.addHandler(handler)
    try:
        with (
            warnings.catch_warnings(action="ignore"),
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(io.StringIO()),
        ):
            yield
    finally:
        root.removeHandler(handler)


def _check_results(path: Path, study: str) -> None:
    """Raise Mistakes if the study would overwrite the results of another one of its name, whose
    configuration is still there: the folder of one of them is a copy."""
    results = Path("results") / study
    try:
        files = manifest.read_manifest(results)["configfiles"]
    except InputError:
        return  # no study of this name has run to its end
    same = path.resolve() in [Path(file).resolve() for file in files]
    if files and not same and Path(files[-1]).is_file():
        raise Mistakes(
            f"{path}: study: {results} holds the results of {files[-1]}, which this study would "
            f"overwrite; give `study` a name of its own, or move {results} to another place"
        )


def _check_given(path: Path, config: dict, own: dict) -> None:
    """Raise Mistakes for what a measured heart may not have by default: the pressure and shape of
    the paper's volunteer. own: what the configuration `path` itself holds."""
    if not _own(config):
        return
    lines = []
    if (own.get("loading") or {}).get("pressure_mmhg") is None:
        pressure = load_schema()["properties"]["loading"]["properties"]["pressure_mmhg"]
        lines.append(f"{path}: loading.pressure_mmhg: missing; {pressure['if_empty']}")
    if not own.get("geometry"):
        lines.append(
            f"{path}: geometry: missing; the heart would be that of the paper's volunteer: give "
            "geometry.segments, the table of this heart's segments, or surfaces or a mesh"
        )
    if lines:
        raise Mistakes("\n".join(lines))


def _place_warnings(path: Path, own: dict, config: dict) -> list[str]:
    """Files with a relative path that were found elsewhere than in the configuration's folder."""
    found = []
    subjects = config["subjects"]
    given = [
        (f"subjects.{name}.{key}", subject.get(key), subjects.get(name, {}).get(key))
        for name, subject in (own.get("subjects") or {}).items()
        if isinstance(subject, dict)
        for key in ("measured", "curves")
    ]
    segments = (own.get("geometry") or {}).get("segments")
    given.append(("geometry.segments", segments, config["geometry"]["segments"]))
    for key, written, used in given:
        if not written or written == VOLUNTEER or Path(written).is_absolute():
            continue
        if not (path.parent / written).is_file():
            found.append(
                f"{key}: {written} is not in {path.parent}; {Path(used).resolve()} is used"
            )
    return found


def _heart_warnings(config: dict) -> list[str]:
    found, pressure = [], config["loading"]["pressure_mmhg"]
    if pressure < LOW_PRESSURE_MMHG:
        found.append(
            f"the end-diastolic pressure is {pressure:g} mmHg, which is low; 1 kPa is 7.5 mmHg, "
            "and every C_a is in proportion to the pressure"
        )
    if pressure > HIGH_PRESSURE_MMHG:
        found.append(
            f"the end-diastolic pressure is {pressure:g} mmHg, which is very high; 1 cmH2O is 0.74 "
            "mmHg, and every C_a is in proportion to the pressure"
        )
    geometry, observables = config["geometry"], config["observables"]
    if _own(config) and observables["strain_exponent"] != 2 and observables["line_share"] == 0:
        found.append(
            f"strains of exponent {observables['strain_exponent']:g} with line_share 0 are "
            "components of a tensor; those of software that tracks lengths need line_share: 1"
        )
    if geometry["source"] == "segments":
        own, example = (
            read_segments(table).set_index("aha_segment")
            for table in (geometry["segments"], VOLUNTEER)
        )
        kept = own.index.intersection(example.index)
        same = [str(at) for at in kept if own.loc[at, SIZES].equals(example.loc[at, SIZES])]
        if same and _own(config):
            which = "" if len(same) == len(own) else f", segments {', '.join(same)}"
            found.append(
                f"{geometry['segments']} still is the example, the paper's volunteer{which}; "
                "overwrite it with this heart's"
            )
    return [f"heart: {line}" for line in found]


def _uneven(segments: pd.DataFrame) -> list[str]:
    """Segments whose wall is of another thickness than those beside it.

    segments: what was meshed, by number, beside what a table of segments gives.
    """
    given = "thickness_table_mm" if "thickness_table_mm" in segments else "thickness_mm"
    thickness, found = segments[given], []
    for level, numbers in LEVELS.items():
        # The apex is a level of one segment, and thin in many hearts.
        beside, least = ("apical", 0) if level == "apex" else (level, 1 / UNEVEN)
        ratio = thickness.loc[list(numbers)] / thickness.loc[list(LEVELS[beside])].median()
        found += [
            f"heart: segment {number}: the wall is {thickness[number]:.3g} mm thick, "
            f"{ratio[number]:.1f} times the median of the {beside} level; check it"
            for number in ratio.index[~ratio.between(least, UNEVEN)]
        ]
    return found


def _unusual(thickness_mm: float, cavity_ml: float) -> list[str]:
    """Sizes of the whole heart that few adults have."""
    sizes = (
        ("the median thickness of the wall is", thickness_mm, "mm", USUAL_MM),
        ("the unloaded cavity has", cavity_ml, "mL", USUAL_ML),
    )
    return [
        f"heart: {what} {size:.4g} {unit}, few adult ventricles are outside {low:g} to {high:g} "
        f"{unit}; check the unit"
        for what, size, unit, (low, high) in sizes
        if not low < size < high
    ]


def _own(config: dict) -> list[str]:
    """The subjects that were measured by the user."""
    return [n for n, s in config["subjects"].items() if s["source"] in ("file", "curves")]


class Measured(NamedTuple):
    """A measured table, which frames of curves it is between, by the key that asks for each and in
    words, and what is odd about these."""

    table: pd.DataFrame
    frames: dict[str, int]
    told: str
    doubts: list[str]


def _read(name: str, config: dict, channels) -> Measured:
    from regional_lv.measured import read_curve_subject, read_measured
    from regional_lv.measured.curves import spikes

    subject, exponent = config["subjects"][name], config["observables"]["strain_exponent"]
    if subject["source"] == "file":
        with warnings.catch_warnings():
            # What a file lacks is reported with the other warnings.
            warnings.simplefilter("ignore")
            pressure = config["loading"]["pressure_mmhg"]
            how = (channels, pressure, exponent, subject["segments"])
            table = read_measured(subject["measured"], *how)
        return Measured(table, {}, "", [])
    curves, back, table = read_curve_subject(subject, channels, exponent)
    start, end, systole = (
        curves.frames[row] for row in (back.end_diastole, back.unloaded, back.end_systole)
    )
    told = (
        f"; from frame {start}, end diastole, back to frame {end}, taken as unloaded, where "
        f"{100 * back.contraction_left:.0f} % of the greatest contraction (frame {systole}) is left"
    )
    frames = {"frame": end, "end_diastole_frame": start}
    return Measured(table, frames, told, [*spikes(curves), *back.doubts(curves.frames)])


def _geometry(config: dict) -> str:
    geometry = config["geometry"]
    if geometry["source"] == "segments":
        return geometry["segments"]
    if geometry["source"] == "surfaces":
        surfaces = geometry["surfaces"]
        return f"{surfaces['endocardium']} and {surfaces['epicardium']}"
    return geometry["imported"]["file"]
