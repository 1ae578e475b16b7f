"""What every observed quantity is: its name, unit and places, and how it follows from a motion.

Values are computed with torch operations from the motion of the wall
(`mechanics.observables.motion`), so that derivatives need no code of their own: the observer
differentiates. Torch is imported by whoever computes.
"""

from abc import ABC, abstractmethod
from typing import ClassVar

from regional_lv.aha import LEVELS, SEGMENTS

SEGMENT_PLACES = tuple(f"{s.number:02d}" for s in SEGMENTS)
"""Places of a quantity that every AHA segment has: 01 to 17."""

NOWHERE = ("",)
"""The one place of a quantity of the whole ventricle."""


class Quantity(ABC):
    """Something that is measured; a new one is one file and one entry in `QUANTITIES`.

    name: in measured files and in the configuration. column: of the tables, with the unit if it
    has one; the same as `name` by default. unit: inside the project; units: what a measured file
    may say, with the factor to `unit`. sign: -1 or 1 where values of a filling ventricle have that
    sign, else 0. limits: smallest and largest plausible value. noise: which entry of a subject's
    noise scales is its own.
    """

    name: ClassVar[str]
    column: ClassVar[str] = ""
    unit: ClassVar[str] = "1"
    units: ClassVar[dict[str, float]] = {"1": 1.0, "%": 0.01}
    sign: ClassVar[int] = 0
    limits: ClassVar[tuple[float, float]]
    noise: ClassVar[str]
    places: ClassVar[tuple[str, ...]] = NOWHERE
    """All places that it can have, in order."""
    default_places: ClassVar[tuple[str, ...] | None] = None
    """Those of a study that does not name any; None: all."""
    is_positive: ClassVar[bool] = False
    """Whether it is above zero, and changes by factors rather than by amounts."""
    is_strain: ClassVar[bool] = False
    """Whether it is a wall strain: subject to the strain measure, the layer and the segments'
    rotation, and part of the principal components."""

    @classmethod
    def column_of(cls, place: str) -> str:
        """Column of the tables, at end diastole."""
        stem = cls.column or cls.name
        return f"{stem}_{place}" if place else stem

    @classmethod
    def words(cls) -> str:
        """What texts call it, such as `radial strain`."""
        return f"{cls.name} strain" if cls.is_strain else cls.name

    def densities(self, point) -> dict:
        """What is averaged over the wall: name -> (M,), torch, of a `PointMotion`; nothing if the
        quantity does not need averages. Those of wall strains are averaged over the layer and the
        turned segments of the study, others over the whole wall."""
        return {}

    @abstractmethod
    def values(self, motion, places: tuple[str, ...]):
        """Values (len(places),), torch, of a `Motion`, which has the averages of `densities`."""


def levels_of(place: str) -> tuple[str, str]:
    """The two levels of a place such as `basal-apical`."""
    first, _, second = place.partition("-")
    return first, second


LEVEL_PAIRS = tuple(
    f"{first}-{second}"
    for i, first in enumerate(LEVELS)
    for second in list(LEVELS)[i + 1 :]
    if second != "apex"
)
"""Pairs of levels, the upper one first: basal-mid, basal-apical, mid-apical."""
