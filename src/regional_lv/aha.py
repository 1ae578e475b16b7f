"""The AHA segments: numbers, names, levels, and the order in which the paper publishes them.

Inside the project, segments carry the official numbers of the 17-segment model of the American
Heart Association (doi 10.1161/hc0402.102975). The paper's data files order them differently
(`published_order`); `published_to_aha` and `aha_to_published` convert at import and export.
"""

from typing import NamedTuple

import numpy as np


class Segment(NamedTuple):
    """One AHA segment: official number (1-17), name, 1-based place in the published order."""

    number: int
    name: str
    published_order: int


SEGMENTS = (
    Segment(1, "basal anterior", 3),
    Segment(2, "basal anteroseptal", 2),
    Segment(3, "basal inferoseptal", 1),
    Segment(4, "basal inferior", 6),
    Segment(5, "basal inferolateral", 5),
    Segment(6, "basal anterolateral", 4),
    Segment(7, "mid anterior", 9),
    Segment(8, "mid anteroseptal", 8),
    Segment(9, "mid inferoseptal", 7),
    Segment(10, "mid inferior", 12),
    Segment(11, "mid inferolateral", 11),
    Segment(12, "mid anterolateral", 10),
    Segment(13, "apical anterior", 14),
    Segment(14, "apical septal", 13),
    Segment(15, "apical inferior", 16),
    Segment(16, "apical lateral", 15),
    Segment(17, "apex", 17),
)

LEVELS = {"basal": range(1, 7), "mid": range(7, 13), "apical": range(13, 17), "apex": range(17, 18)}

WALLS = {
    "anterior": (1, 7, 13),
    "septal": (2, 3, 8, 9, 14),
    "inferior": (4, 10, 15),
    "lateral": (5, 6, 11, 12, 16),
}
"""Segments of the walls from base to apex; the apex (17) belongs to none."""

SEPTUM = (2, 3, 8, 9)
"""Segments whose epicardium is the right ventricle's wall."""

SIX_WALLS = range(13, 19)
"""Apical segments of the 18-segment model of echocardiography, which has six walls at every level,
numbered as those of the mid level, and no apex (Lang 2015, doi 10.1016/j.echo.2014.10.003)."""


def _apical_shares() -> dict[int, dict[int, float]]:
    four, six = LEVELS["apical"], SIX_WALLS
    width, width_six = 360 / len(four), 360 / len(six)
    # Both begin with the anterior wall, whose middle is at one angle at all levels.
    turn = np.arange(len(four))[:, None] * width - np.arange(len(six)) * width_six
    apart = np.abs((turn + 180) % 360 - 180)
    common = np.clip((width + width_six) / 2 - apart, 0, min(width, width_six))
    return {
        segment: {wall: float(share) for wall, share in zip(six, row / width, strict=True) if share}
        for segment, row in zip(four, common, strict=True)
    }


APICAL_SHARES = _apical_shares()
"""By apical AHA segment, the walls of the 18-segment model that it consists of, and the share of
its sector of 90 degrees that each of their sectors of 60 degrees has; the shares add up to one."""

published_to_aha = np.array([s.published_order - 1 for s in SEGMENTS])
"""`published[..., published_to_aha]` puts 17 values in published order into AHA order."""

aha_to_published = np.argsort(published_to_aha)
"""`aha[..., aha_to_published]` puts 17 values in AHA order into the published order."""


def outputs_from_published(table: np.ndarray) -> np.ndarray:
    """Rows (..., 52) of published outputs in the order of the default channels.

    Both have the volume first, then 17 strains in each of three directions.
    """
    blocks = [1 + 17 * d + published_to_aha for d in range(3)]
    return table[..., np.concatenate([[0], *blocks])]


def level_of(segment: int) -> str:
    """The level of a segment's number."""
    return next(level for level, numbers in LEVELS.items() if segment in numbers)


def beside(segment: int) -> tuple[int, int]:
    """The next segment of the level, in the order of their numbers, and the one before."""
    level = LEVELS[level_of(segment)]
    at = level.index(segment)
    return level[(at + 1) % len(level)], level[at - 1]


def adjoin(one: int, two: int) -> bool:
    """Whether two segments share a border: in one level, or in one wall of adjacent levels."""
    upper, lower = sorted((one, two))
    if level_of(upper) == level_of(lower):
        return upper != lower and lower in beside(upper)
    if upper in LEVELS["basal"]:
        return lower == upper + len(LEVELS["basal"])
    if upper in LEVELS["mid"]:
        return any({upper, lower} <= set(wall) for wall in WALLS.values())
    return True  # the apex adjoins all apical segments
