"""The segment table: read, checked, and in AHA order."""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.aha import LEVELS, SEGMENTS, WALLS, beside
from regional_lv.data import segment_table
from regional_lv.errors import InputError
from regional_lv.typed_tables import Column, read_table

COLUMNS = (
    "aha_segment",
    "name",
    "wall_thickness_mm",
    "endo_radius_mm",
    "angle_from_deg",
    "angle_to_deg",
    "z_top_mm",
    "z_bottom_mm",
)
# Segment averages that a human left ventricle, thin scar to gross dilatation, can have.
PLAUSIBLE_MM = {"wall_thickness_mm": (2.0, 30.0), "endo_radius_mm": (3.0, 80.0)}
# The same at the apex, where a small cavity ends in a tip.
LEAST_APICAL_RADIUS_MM = 1.0

SD_COLUMNS = {column: f"{column.removesuffix('_mm')}_sd_mm" for column in PLAUSIBLE_MM}
"""Columns that may say how well another one is known; an empty cell: as if it were exact."""

LIKE_SD = re.compile(r"(?<![a-z])(sd|std|sigma|uncertainty)(?![a-z])", re.IGNORECASE)
"""In the name of a column that would be ignored, though it is meant as one of `SD_COLUMNS`."""

ROUND_OFF_DEG = 1e-6
"""Between a sector's border and its neighbour's, which is taken for the same."""

SAME_BORDER_DEG = 1.0
"""Borders of two levels' sectors that are no further apart are one mesh line: images do not tell
them apart, and a column of elements between them would be too narrow."""

MOST_TWIST_DEG = 50.0
"""Between the septa of two levels: one segment of 60 degrees is a mistake, twenty are a heart."""


def plausible_mm(column: str, segment: int) -> tuple[float, float]:
    """Least and largest value (mm) of a key of `PLAUSIBLE_MM` in an AHA segment."""
    low, high = PLAUSIBLE_MM[column]
    return (LEAST_APICAL_RADIUS_MM if (column, segment) == ("endo_radius_mm", 17) else low), high


def read_segments(path: str | Path) -> pd.DataFrame:
    """Read and check a segment table (CSV); one row per AHA segment, returned in AHA order.

    `path` may be the word `volunteer`, the table that comes with the package. Columns: aha_segment
    (1-17), name, wall_thickness_mm, endo_radius_mm (means over angle and latitude, as
    `geometry.surfaces` defines them), angle_from_deg, angle_to_deg (sector, counter-clockwise seen
    from the base), z_top_mm, z_bottom_mm (level, base plane at 0). `SD_COLUMNS` may say how well a
    size is known. Further columns are kept, as text; `line` is added. Raises InputError that names
    the file, the row and the remedy.
    """
    path = segment_table(path)
    columns = [column if column == "name" else Column(column) for column in COLUMNS]
    sds = [Column(column, "mm", least=0, empty=0.0) for column in SD_COLUMNS.values()]
    table = read_table(path, [*columns, *sds])
    for name in table.columns.difference([*COLUMNS, *SD_COLUMNS.values()], sort=False):
        if LIKE_SD.search(name):
            raise InputError(
                f"{path}: column {name} looks like a standard deviation, and none of this name is "
                f"read; rename it to {' or '.join(SD_COLUMNS.values())} (mm), or remove it"
            )
    table.index = pd.Index([f"line {line}" for line in table.index], name="line")
    return check_segments(table, path).reset_index()


def check_segments(table: pd.DataFrame, path: str | Path) -> pd.DataFrame:
    """The table in AHA order, its sectors' borders closed.

    table: of the `COLUMNS`; its index says in messages which row is meant ("line 5"). path: where
    the table comes from. Raises InputError for what a left ventricle cannot have.
    """
    for at, number in table["aha_segment"].items():
        if number not in range(1, 18):
            raise InputError(f"{path}, {at}: aha_segment {number:g} does not exist; use 1 to 17")
    table["aha_segment"] = table["aha_segment"].astype(int)
    for at in table.index[table["aha_segment"].duplicated()]:
        raise InputError(
            f"{path}, {at}: segment {table.at[at, 'aha_segment']} was given before; "
            "keep one row per segment"
        )
    absent = sorted(set(range(1, 18)) - set(table["aha_segment"]))
    if absent:
        raise InputError(f"{path}: segment {', '.join(map(str, absent))} is missing; add its row")
    table = table.sort_values("aha_segment")

    for at, row in table.iterrows():
        segment = SEGMENTS[row["aha_segment"] - 1]
        if str(row["name"]).strip() != segment.name:
            raise InputError(
                f"{path}, {at}: name of segment {segment.number} is {row['name']!r}; it "
                f"must be {segment.name!r}"
            )
    _check_sizes(path, table)
    _check_levels(path, table)
    _check_sectors(path, table)
    table["angle_to_deg"] = _closed(table)
    middle = (table["angle_from_deg"] + table["angle_to_deg"]) / 2
    check_septum(
        path,
        dict(zip(table["aha_segment"], middle, strict=True)),
        "count angles of all levels from one direction, and check the numbers of the segments",
    )
    return table


def check_apices(
    path: str | Path, table: pd.DataFrame, endo_apex_z_mm: float, epi_apex_z_mm: float
) -> None:
    """Raise InputError for apices (z in mm) that do not belong to the table that `read_segments`
    returned for `path`."""
    bottom = table["z_bottom_mm"].iloc[15]
    if not epi_apex_z_mm < endo_apex_z_mm < bottom:
        raise InputError(
            f"geometry.endo_apex_z_mm {endo_apex_z_mm:g} and geometry.epi_apex_z_mm "
            f"{epi_apex_z_mm:g} must lie, in this order, below the apical level of {path}, which "
            f"ends at {bottom:g}"
        )
    given = table["z_bottom_mm"].iloc[16]
    if not epi_apex_z_mm - 0.5 <= given <= endo_apex_z_mm + 0.5:
        raise InputError(
            f"{path}, {table['line'].iloc[16]}: segment 17 ends at z = {given:g} mm, not at "
            f"the apex (geometry.endo_apex_z_mm {endo_apex_z_mm:g}, geometry.epi_apex_z_mm "
            f"{epi_apex_z_mm:g}); correct one of them"
        )


def _check_sizes(path: str | Path, table: pd.DataFrame) -> None:
    for column, (low, high) in PLAUSIBLE_MM.items():
        for unit, factor in (("cm", 10), ("m", 1000)):
            if (table[column] * factor).between(low, high).all() and table[column].median() < low:
                raise InputError(
                    f"{path}: column {column} looks like {unit}; multiply by {factor} to give mm"
                )
        for at, value in table[column].items():
            low, high = plausible_mm(column, table.at[at, "aha_segment"])
            if not low <= value <= high:
                raise InputError(
                    f"{path}, {at}: {column} is {value:g}; a left ventricle has between "
                    f"{low:g} and {high:g} mm; correct it"
                )


def _check_levels(path: str | Path, table: pd.DataFrame) -> None:
    """One z range per level, and ranges that join from the base plane z = 0 downwards."""
    above, name_above = 0.0, "the base plane"
    for level, numbers in LEVELS.items():
        rows = table[table["aha_segment"].isin(numbers)]
        first = rows.iloc[0]
        for at, row in rows.iterrows():
            if row["z_top_mm"] != first["z_top_mm"] or row["z_bottom_mm"] != first["z_bottom_mm"]:
                raise InputError(
                    f"{path}, {at}: the z range of segment {row['aha_segment']} differs "
                    f"from segment {first['aha_segment']}'s; give the {level} level one z range"
                )
        at = rows.index[0]
        if abs(first["z_top_mm"] - above) > 1e-6:
            raise InputError(
                f"{path}, {at}: the {level} level begins at z = {first['z_top_mm']:g} mm "
                f"but {name_above} is at {above:g}; make them meet"
            )
        if first["z_bottom_mm"] >= first["z_top_mm"]:
            raise InputError(
                f"{path}, {at}: z_bottom_mm {first['z_bottom_mm']:g} is not below z_top_mm "
                f"{first['z_top_mm']:g}; the apex points to negative z"
            )
        above, name_above = first["z_bottom_mm"], f"the {level} level's end"
    if -above < 30:
        raise InputError(
            f"{path}: the ventricle is {-above:g} mm long; z looks like cm, multiply by 10"
            if -above > 3
            else f"{path}: the ventricle is {-above:g} mm long; give z in mm"
        )


def _check_sectors(path: str | Path, table: pd.DataFrame) -> None:
    """Sectors that tile each level, numbered clockwise seen from the base as the AHA does."""
    width = table["angle_to_deg"] - table["angle_from_deg"]
    for at, degrees in width.items():
        if not 0 < degrees <= 360 + ROUND_OFF_DEG:
            raise InputError(
                f"{path}, {at}: the sector is {degrees:g} degrees wide; angle_to_deg must "
                "exceed angle_from_deg by at most 360 (write 165 to 255, not 165 to -105)"
            )
    for level, numbers in LEVELS.items():
        rows = table[table["aha_segment"].isin(numbers)]
        for (at, row), (_, following) in zip(
            rows.iterrows(), [*list(rows.iterrows())[1:], next(rows.iterrows())], strict=True
        ):
            gap = (row["angle_from_deg"] - following["angle_to_deg"] + 180) % 360 - 180
            if abs(gap) > ROUND_OFF_DEG:
                raise InputError(
                    f"{path}, {at}: the sector of segment {row['aha_segment']} begins at "
                    f"{row['angle_from_deg']:g} degrees but that of segment "
                    f"{following['aha_segment']} ends at {following['angle_to_deg']:g}; the "
                    f"{level} sectors must tile 360 degrees, numbered clockwise seen from the base"
                )
        total = width[rows.index].sum()
        if abs(total - 360) > ROUND_OFF_DEG:
            raise InputError(
                f"{path}, {rows.index[0]}: the {level} sectors add up to {total:g} degrees; "
                "they must tile 360"
            )


def _closed(table: pd.DataFrame) -> pd.Series:
    """`angle_to_deg` without what round-off leaves between a sector and its neighbour."""
    angle_to = table["angle_to_deg"].copy()
    for numbers in LEVELS.values():
        lines = table.index[table["aha_segment"].isin(numbers)]
        for line, following in zip(lines, [*lines[1:], lines[0]], strict=True):
            begin, end = table.loc[line, "angle_from_deg"], angle_to[following]
            angle_to[following] = begin + 360 * np.round((end - begin) / 360)
    return angle_to


def check_septum(path: str | Path, middle: Mapping[int, float], remedy: str) -> None:
    """Raise InputError unless the septum is on one side at all levels.

    path: of the segments, and what to do about it (`remedy`), for the message. middle: angle
    (degrees) of the middle of each segment, by number.
    """
    basal = None
    for level in ("basal", "mid", "apical"):
        septum = [number for number in LEVELS[level] if number in WALLS["septal"]]
        angles = np.radians([middle[number] for number in septum])
        angle = np.degrees(np.angle(np.exp(1j * angles).sum()))
        basal = angle if basal is None else basal
        away = abs((angle - basal + 180) % 360 - 180)
        if away > MOST_TWIST_DEG:
            word = "segments" if len(septum) > 1 else "segment"
            numbers = f"{word} {' and '.join(map(str, septum))}"
            raise InputError(
                f"{path}: at the {level} level the middle of the septum ({numbers}) is "
                f"{away:.0f} degrees away from that of the basal level; {remedy}"
            )


def with_joined_borders(table: pd.DataFrame) -> pd.DataFrame:
    """The table for meshing, with borders that are less than `SAME_BORDER_DEG` apart made one. One
    without such borders stays as it is; so does one in which a sector would be left empty."""
    sectors = table[table["aha_segment"] < 17]
    begin = (sectors["angle_from_deg"] + 180) % 360 - 180
    lower = dict(zip(sectors["aha_segment"], begin, strict=True))
    joined = joined_borders(lower, SAME_BORDER_DEG)
    moves = {s: (joined[s] - lower[s] + 180) % 360 - 180 for s in lower}
    moves = {s: move if abs(move) > ROUND_OFF_DEG else 0.0 for s, move in moves.items()}
    if not any(moves.values()):
        return table
    numbers = sectors["aha_segment"]
    changed = table.astype({"angle_from_deg": float, "angle_to_deg": float})
    changed.loc[sectors.index, "angle_from_deg"] += numbers.map(moves)
    changed.loc[sectors.index, "angle_to_deg"] += numbers.map(lambda s: moves[beside(s)[1]])
    empty = changed["angle_to_deg"] - changed["angle_from_deg"] < ROUND_OFF_DEG
    return table if empty.any() else changed


def joined_borders(borders: Mapping[int, float], width: float) -> dict[int, float]:
    """Borders (by segment, degrees) of which those closer than `width` share their mean."""
    names = sorted(borders, key=borders.__getitem__)
    values = np.array([borders[s] for s in names])
    start = int(np.argmax(np.diff(values, prepend=values[-1] - 360)))
    values, names = np.roll(values, -start), names[start:] + names[:start]
    values = values[0] + (values - values[0]) % 360
    group = np.cumsum(np.diff(values, prepend=values[0]) > width)
    means = np.bincount(group, values) / np.bincount(group)
    return {s: (means[g] + 180) % 360 - 180 for s, g in zip(names, group, strict=True)}
