"""What is missing or unusual about one heart and what was measured of it, before anything runs."""

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from regional_lv.aha import LEVELS
from regional_lv.channels import Channels
from regional_lv.config.sections.heart import NO_PRESSURE
from regional_lv.data import VOLUNTEER
from regional_lv.geometry.table import read_segments

UNEVEN = 2.0
"""Ratio of a wall's thickness to the median of its level, either way, beyond which it is odd."""

USUAL_MM, USUAL_ML = (4.0, 20.0), (25.0, 400.0)
"""Median thickness of the wall and cavity of an unloaded adult ventricle, hypertrophic and dilated
ones among them. A heart outside may be right, and is more often in another unit."""

SIZES = ["wall_thickness_mm", "endo_radius_mm"]

LOW_PRESSURE_MMHG, HIGH_PRESSURE_MMHG = 3.0, 30.0
"""An end-diastolic pressure below is in kPa more likely than true; one above is rare."""


GEOMETRY_FILES = (
    ("geometry", "segments"),
    ("geometry", "surfaces", "endocardium"),
    ("geometry", "surfaces", "epicardium"),
    ("geometry", "imported", "file"),
    ("geometry", "imported", "segments"),
)
"""Keys that name the files of a heart's shape."""


def not_given(config: Mapping, own: Mapping) -> list[str]:
    """What a measured heart may not have by default: the pressure and shape of the paper's
    volunteer. own: what its own configuration holds."""
    if not measured_subjects(config):
        return []
    lines = []
    if (own.get("loading") or {}).get("pressure_mmhg") is None:
        lines.append(f"loading.pressure_mmhg: missing; {NO_PRESSURE}")
    if not own.get("geometry"):
        lines.append(
            "geometry: missing; the heart would be that of the paper's volunteer: give "
            "geometry.segments, the table of this heart's segments, or surfaces or a mesh"
        )
    return lines


def place_warnings(path: Path, own: Mapping, config: Mapping) -> list[str]:
    """Files with a relative path that were found elsewhere than in the configuration's folder."""
    found = []
    subjects = config["subjects"]
    given = [
        (f"subjects.{name}.{key}", subject.get(key), subjects.get(name, {}).get(key))
        for name, subject in (own.get("subjects") or {}).items()
        if isinstance(subject, dict)
        for key in ("measured", "curves")
    ]
    given += [(".".join(keys), _at(own, keys), _at(config, keys)) for keys in GEOMETRY_FILES]
    for key, written, used in given:
        # Words for what comes with the package are no files.
        if not written or Path(written).is_absolute() or not Path(used).is_file():
            continue
        if not (path.parent / written).is_file():
            found.append(
                f"{key}: {written} is not in {path.parent}; {Path(used).resolve()} is used"
            )
    return found


def _at(content: Mapping, keys: Sequence[str]):
    """The value of a key in sections, of which any may be absent or empty."""
    value: Any = content
    for key in keys:
        value = (value or {}).get(key)
    return value


def heart_warnings(config: Mapping) -> list[str]:
    """Unusual pressures, strain measures and tables."""
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
    if (
        measured_subjects(config)
        and observables["strain_exponent"] != 2
        and observables["line_share"] == 0
    ):
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
        if same and measured_subjects(config):
            which = "" if len(same) == len(own) else f", segments {', '.join(same)}"
            found.append(
                f"{geometry['segments']} still is the example, the paper's volunteer{which}; "
                "overwrite it with this heart's"
            )
    return [f"heart: {line}" for line in found]


def uneven(segments: pd.DataFrame) -> list[str]:
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


def unusual(thickness_mm: float, cavity_ml: float) -> list[str]:
    """Sizes of the whole heart that few adults have."""
    sizes = (
        ("the median thickness of the wall is", thickness_mm, "mm", USUAL_MM),
        ("the unloaded cavity has", cavity_ml, "mL", USUAL_ML),
    )
    return [
        f"heart: {what} {size:.4g} {unit}, few adult ventricles are outside {low:g} to {high:g} "
        f"{unit}; check the unit, and that no two columns are exchanged"
        for what, size, unit, (low, high) in sizes
        if not low < size < high
    ]


def measured_subjects(config: Mapping) -> list[str]:
    """The subjects that were measured by the user."""
    return [n for n, s in config["subjects"].items() if s["source"] in ("file", "curves")]


class Measured(NamedTuple):
    """A measured table, which frames of curves it is between, by the key that asks for each and in
    words, and what is odd about these."""

    table: pd.DataFrame
    frames: dict[str, int]
    told: str
    doubts: list[str]


def read_subject(name: str, config: Mapping, channels: Channels) -> Measured:
    """What was measured of a subject with a file. Raises InputError."""
    # Imported here: they take seconds, and a mistake elsewhere need not wait for them.
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


def geometry_of(config: Mapping) -> str:
    """The file or files that the heart is made of."""
    geometry = config["geometry"]
    if geometry["source"] == "segments":
        return geometry["segments"]
    if geometry["source"] == "surfaces":
        surfaces = geometry["surfaces"]
        return f"{surfaces['endocardium']} and {surfaces['epicardium']}"
    return geometry["imported"]["file"]
