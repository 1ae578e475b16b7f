"""The AHA segment of every element of an imported mesh, from the files that can hold it, and
whether the segments lie where those of the AHA do."""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from regional_lv import aha
from regional_lv.csv_lines import error_at
from regional_lv.errors import InputError
from regional_lv.geometry.mesh import Mesh
from regional_lv.geometry.summary import cell_volumes
from regional_lv.geometry.table import check_septum
from regional_lv.input_files import reading
from regional_lv.typed_tables import Column, read_table

COLUMNS = [Column("element", whole=True), Column("aha_segment", whole=True)]
PUBLISHED_FIELD = "elRegions"
"""Field of the paper's .mat file with one label per element, in the published order."""


def read_segment_tags(path: str | Path, numbers: np.ndarray) -> np.ndarray:
    """AHA segment (m,) of the elements `numbers` (m,).

    `path`: a CSV with the columns `element` and `aha_segment`, or the paper's .mat file, whose
    labels are in the published order and in the order of the mesh file.
    """
    path = Path(path)
    if path.suffix.lower() == ".mat":
        return _read_published(path, len(numbers))
    known, by_element = set(numbers.tolist()), {}
    table = read_table(path, COLUMNS)
    for line, element, segment in zip(
        table.index, table["element"], table["aha_segment"], strict=True
    ):
        if element in by_element:
            raise error_at(
                path, line, f"element {element} was given before; keep one row per element"
            )
        if element not in known:
            raise error_at(
                path,
                line,
                f"the mesh has no element {element}; use the mesh file's own element numbers (from "
                "1 in the file's order if it has none)",
            )
        by_element[element] = segment
    # Elements without a row get 0, which is no segment.
    return np.array([by_element.get(number, 0) for number in numbers.tolist()])


def check_segment_tags(segment: np.ndarray, numbers: np.ndarray, origin: str | Path) -> None:
    """Raise InputError for elements that belong to no segment and for segments without any."""
    wrong = numbers[~np.isin(segment, range(1, 18))]
    if len(wrong):
        raise InputError(
            f"{origin}: {name_elements(wrong)} without an AHA segment from 1 to 17; tag each "
            "element"
        )
    empty = sorted(set(range(1, 18)) - set(segment.tolist()))
    if empty:
        raise InputError(
            f"{origin}: segment {', '.join(map(str, empty))} has no element; tag the elements of "
            "all 17 segments with the official AHA numbers"
        )


def check_segment_places(mesh: Mesh, origin: str | Path) -> None:
    """Raise InputError for segments that do not lie as those of the AHA do: level below level,
    clockwise seen from the base, the septum on one side."""
    volume = cell_volumes(mesh)
    _check_heights(mesh, volume, origin)
    middle = middle_angles(mesh, volume)
    for level, numbers in aha.LEVELS.items():
        if level != "apex":
            _check_turn(level, {s: (middle[numbers[0]] - middle[s]) % 360 for s in numbers}, origin)
    check_septum(origin, middle, "correct the tags of one of the two levels")


def _check_heights(mesh: Mesh, volume: np.ndarray, origin: str | Path) -> None:
    """In each wall, every segment lies above those of the next level."""
    z = mesh.points[mesh.cells].mean(axis=1)[:, 2]
    height = {
        s.number: np.average(z[mesh.segment == s.number], weights=volume[mesh.segment == s.number])
        for s in aha.SEGMENTS
    }
    for wall in aha.WALLS.values():
        down = [*wall, *aha.LEVELS["apex"]]
        levels = [[s for s in down if s in numbers] for numbers in aha.LEVELS.values()]
        for above, below in pairwise(levels):
            upper, lower = min(above, key=height.__getitem__), max(below, key=height.__getitem__)
            if height[upper] <= height[lower]:
                at = [
                    f"segment {s} ({aha.SEGMENTS[s - 1].name}) is at z = {height[s]:.0f} mm"
                    for s in (upper, lower)
                ]
                raise InputError(
                    f"{origin}: the middle of {at[0]}, and that of {at[1]}; correct the tags: "
                    "levels go from the base (z = 0) down to the apex"
                )


def _check_turn(level: str, turn: Mapping[int, float], origin: str | Path) -> None:
    """turn: angle (degrees) from a level's first segment clockwise to each, by number."""
    steps = np.diff([*turn.values(), 360])
    if not ((steps > 0) & (steps < 180)).all():
        first, *others = sorted(turn, key=turn.__getitem__)
        found = ", ".join(f"{s} at {turn[s]:.0f} degrees" for s in others)
        raise InputError(
            f"{origin}: clockwise seen from the base, segment {first} of the {level} level is "
            f"followed by {found}; the AHA's order is {', '.join(map(str, turn))}, each less than "
            "180 degrees after the one before: correct the tags, or mirror the mesh"
        )


def middle_angles(mesh: Mesh, volume: np.ndarray) -> dict[int, float]:
    """Angle (degrees) about the long axis of the middle of each segment, by number.

    volume (m,): of the cells.
    """
    x, y, _ = np.moveaxis(mesh.points[mesh.cells[:, :8]], -1, 0)
    turned = volume[:, None] * np.exp(1j * np.arctan2(y, x))
    return {
        s.number: np.degrees(np.angle(turned[mesh.segment == s.number].sum())) for s in aha.SEGMENTS
    }


def name_elements(numbers: np.ndarray) -> str:
    """The first few element numbers in words."""
    shown = ", ".join(map(str, numbers[:5]))
    more = f" and {len(numbers) - 5} more" if len(numbers) > 5 else ""
    return f"element{'s' if len(numbers) > 1 else ''} {shown}{more}"


def _read_published(path: Path, size: int) -> np.ndarray:
    with reading(path, "give geometry.imported.segments the paper's .mat file, or a CSV instead"):
        content = loadmat(path, simplify_cells=True)
        fields = [value for value in content.values() if isinstance(value, dict)]
        labels = next((f[PUBLISHED_FIELD] for f in fields if PUBLISHED_FIELD in f), None)
        if labels is None:
            raise InputError(f"{path}: holds no {PUBLISHED_FIELD}; give a CSV of elements instead")
        labels = np.asarray(labels, dtype=int)
    if labels.shape != (size,):
        raise InputError(
            f"{path}: labels {labels.size} elements but the mesh has {size}; give the labels of "
            "this mesh"
        )
    known = (labels >= 1) & (labels <= 17)
    segment = np.zeros(size, dtype=int)
    segment[known] = aha.aha_to_published[labels[known] - 1] + 1
    return segment
