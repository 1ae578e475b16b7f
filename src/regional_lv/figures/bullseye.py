"""The 17-segment bullseye of the American Heart Association and its five-zone form.

The disk has radius 1. As in the standard (doi 10.1161/hc0402.102975) the heart is seen from the
apex: anterior at the top, septum on the left, inferior at the bottom, lateral wall on the right;
rings from the rim inwards are basal, mid, apical and apex. Angles are degrees counter-clockwise
from the right-hand side.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_rgb
from matplotlib.patches import Polygon

from regional_lv import aha

RINGS = {"basal": (0.75, 1.0), "mid": (0.5, 0.75), "apical": (0.25, 0.5), "apex": (0.0, 0.25)}
"""Inner and outer radius of each level."""


class Cell(NamedTuple):
    """Part of a ring: inner and outer radius, first and last angle (degrees)."""

    inner: float
    outer: float
    start: float
    stop: float

    @property
    def full_circle(self) -> bool:
        return self.stop - self.start >= 360

    @property
    def centre(self) -> tuple[float, float]:
        """Middle of the cell; of a whole disk, its centre."""
        if self.full_circle and self.inner == 0:
            return 0.0, 0.0
        angle = np.radians((self.start + self.stop) / 2)
        radius = (self.inner + self.outer) / 2
        return radius * np.cos(angle), radius * np.sin(angle)

    def outline(self, step_deg: float = 1.0) -> np.ndarray:
        """Corner points (n, 2) of the cell's border, counter-clockwise."""
        n = int(np.ceil((self.stop - self.start) / step_deg)) + 1
        angle = np.radians(np.linspace(self.start, self.stop, n))
        rim = np.column_stack([np.cos(angle), np.sin(angle)])
        if self.inner == 0:
            hub = np.zeros((0 if self.full_circle else 1, 2))
        else:
            hub = self.inner * rim[::-1]
        return np.vstack([self.outer * rim, hub])


def _segment_cell(number: int) -> Cell:
    level = next(name for name, numbers in aha.LEVELS.items() if number in numbers)
    numbers = aha.LEVELS[level]
    width = 360 / len(numbers)
    middle = 90 + width * (number - numbers[0])  # first of each ring at the top, then to the left
    return Cell(*RINGS[level], middle - width / 2, middle + width / 2)


SEGMENT_CELLS = tuple(_segment_cell(segment.number) for segment in aha.SEGMENTS)
"""Cell of segment number i + 1."""


def _zone_cell(zone: str) -> Cell:
    cells = [SEGMENT_CELLS[s.number - 1] for s in aha.SEGMENTS if s.zone == zone]
    return Cell(
        min(c.inner for c in cells),
        max(c.outer for c in cells),
        min(c.start for c in cells) if not any(c.full_circle for c in cells) else 0.0,
        max(c.stop for c in cells) if not any(c.full_circle for c in cells) else 360.0,
    )


ZONE_CELLS = {zone: _zone_cell(zone) for zone in aha.ZONES}
"""Cell of each zone: four wedges of the basal and mid rings, and the apical disk."""


def paint(
    ax: Axes,
    colours: Sequence,
    labels: Sequence[str] | None = None,
    edge: str = "white",
    zone_outlines: bool = True,
) -> None:
    """Fill the 17 segments of `ax` with `colours` and write `labels` into them.

    Colours and labels are in the order of the AHA numbers; `zone_outlines` adds the five zones'
    borders in dark lines over the segments' borders, which are drawn in `edge`.
    """
    for cell, colour in zip(SEGMENT_CELLS, colours, strict=True):
        ax.add_patch(Polygon(cell.outline(), facecolor=colour, edgecolor=edge, linewidth=1.0))
    for cell, label, colour in zip(SEGMENT_CELLS, labels or [""] * 17, colours, strict=True):
        ax.text(*cell.centre, label, ha="center", va="center", color=_legible_on(colour))
    if zone_outlines:
        outline_zones(ax)
    frame(ax)


def _legible_on(colour) -> str:
    """Black or white, by the luma of the colour beneath (ITU-R BT.601 weights)."""
    return "black" if np.dot(to_rgb(colour), (0.299, 0.587, 0.114)) > 0.45 else "white"


def paint_values(
    ax: Axes, values: np.ndarray, norm: Normalize, cmap: str, labels: Sequence[str] | None = None
) -> ScalarMappable:
    """Colour the segments by `values` (17, AHA order); NaN is light grey. Return the colour scale.

    The result goes to `fig.colorbar`.
    """
    scale = ScalarMappable(norm, cmap)
    colours = [scale.to_rgba(v) if np.isfinite(v) else "#EEEEEE" for v in np.asarray(values)]
    paint(ax, colours, labels)
    return scale


def paint_zones(
    ax: Axes, values: Sequence[float], norm: Normalize, cmap: str, labels: Sequence[str]
) -> ScalarMappable:
    """Fill the five zones by `values` and write `labels` into them, both in the order of
    `aha.ZONES`; NaN is light grey and stays empty. Return the colour scale.
    """
    scale = ScalarMappable(norm, cmap)
    for cell, value, label in zip(ZONE_CELLS.values(), values, labels, strict=True):
        known = np.isfinite(value)
        colour = scale.to_rgba(value) if known else "#EEEEEE"
        ax.add_patch(Polygon(cell.outline(), facecolor=colour, edgecolor="white", linewidth=1.2))
        if known:
            ax.text(*cell.centre, label, ha="center", va="center", color=_legible_on(colour))
    frame(ax)
    return scale


def outline_zones(ax: Axes, colour: str = "#333333", linewidth: float = 1.6) -> None:
    """Draw the borders of the five zones."""
    for cell in ZONE_CELLS.values():
        ax.add_patch(Polygon(cell.outline(), fill=False, edgecolor=colour, linewidth=linewidth))


def frame(ax: Axes, margin: float = 0.03) -> None:
    """Square axes around the disk, without ticks."""
    ax.set(xlim=(-1 - margin, 1 + margin), ylim=(-1 - margin, 1 + margin), aspect="equal")
    ax.set_axis_off()
