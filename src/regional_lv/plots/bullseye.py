"""The 17-segment bullseye of the American Heart Association, and the zones on it.

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
from matplotlib.patches import PathPatch, Polygon
from matplotlib.path import Path

from regional_lv import aha
from regional_lv.inputs.stiffness import StiffnessInputs

RINGS = {"basal": (0.75, 1.0), "mid": (0.5, 0.75), "apical": (0.25, 0.5), "apex": (0.0, 0.25)}
"""Inner and outer radius of each level."""

FEW_ZONES = 8
"""Up to so many, what is written into a zone has the figure's own size of letters."""


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
    level = aha.level_of(number)
    numbers = aha.LEVELS[level]
    width = 360 / len(numbers)
    middle = 90 + width * (number - numbers[0])  # first of each ring at the top, then to the left
    return Cell(*RINGS[level], middle - width / 2, middle + width / 2)


SEGMENT_CELLS = tuple(_segment_cell(segment.number) for segment in aha.SEGMENTS)
"""Cell of segment number i + 1."""


def segment_at(points: np.ndarray) -> np.ndarray:
    """AHA number (n,) of the segment that holds each of `points` (n, 2), 0 outside the disk."""
    x, y = np.transpose(points)
    radius, angle = np.hypot(x, y), np.degrees(np.arctan2(y, x))
    found = np.zeros(len(points), dtype=int)
    for number, cell in enumerate(SEGMENT_CELLS, start=1):
        inside = (angle - cell.start) % 360 < cell.stop - cell.start
        found[inside & (radius >= cell.inner) & (radius < cell.outer)] = number
    return found


STEP_DEG = 15.0
"""Borders of all segments lie on multiples of this angle."""


class ZoneShape:
    """The part of the disk that some segments make, in one piece or in several."""

    def __init__(self, segments: Sequence[int]):
        self.segments = tuple(segments)
        self.outline = _outline([SEGMENT_CELLS[number - 1] for number in self.segments])

    @property
    def centre(self) -> tuple[float, float]:
        """Where to write into the zone: half way between its inner and outer radius, in its mean
        direction; a zone all around is written into at the top, or at the apex if it has that."""
        cells = [SEGMENT_CELLS[number - 1] for number in self.segments]
        inner, outer = min(c.inner for c in cells), max(c.outer for c in cells)
        area = np.array([(c.outer**2 - c.inner**2) * (c.stop - c.start) for c in cells])
        angle = np.radians([(c.start + c.stop) / 2 for c in cells])
        area[[c.full_circle for c in cells]] = 0.0
        x, y = area @ np.cos(angle), area @ np.sin(angle)
        if np.hypot(x, y) <= 1e-6 * area.sum():
            at = (0.0, 0.0) if inner == 0 else (0.0, (inner + outer) / 2)
        else:
            at = np.array([x, y]) * (inner + outer) / 2 / np.hypot(x, y)
        if self.holds(np.array([at])).all():
            return float(at[0]), float(at[1])
        return min((c.centre for c in cells), key=lambda c: np.hypot(*np.subtract(c, at)))

    def holds(self, points: np.ndarray) -> np.ndarray:
        """Mask (n,) of the points (n, 2) of the disk that lie in the zone."""
        return np.isin(segment_at(points), self.segments)

    def patch(self, **options) -> PathPatch:
        """The zone as a patch; options: its colours and lines."""
        return PathPatch(self.outline, **options)


def _outline(cells: Sequence[Cell]) -> Path:
    """Border of the union of cells: the sides of their pieces that no two of them share."""
    sides: dict[tuple, np.ndarray] = {}
    for cell in cells:
        first, last = (round(angle / STEP_DEG) for angle in (cell.start, cell.stop))
        for k in range(first, last):
            corners = [(cell.inner, k), (cell.outer, k), (cell.outer, k + 1), (cell.inner, k + 1)]
            corners = [(r, n % round(360 / STEP_DEG) if r else 0) for r, n in corners]
            for side in zip(corners, corners[1:] + corners[:1], strict=True):
                if side[0] == side[1]:
                    continue
                if side[::-1] in sides:
                    del sides[side[::-1]]
                else:
                    sides[side] = _points(*side)
    vertices, codes = [], []
    while sides:
        start, end = next(iter(sides))
        loop = [sides.pop((start, end))]
        while end != start:
            start_of_next = next(side for side in sides if side[0] == end)
            loop.append(sides.pop(start_of_next))
            end = start_of_next[1]
        points = np.concatenate(loop)
        vertices.append(np.vstack([points, points[:1]]))
        codes.append([Path.MOVETO, *[Path.LINETO] * (len(points) - 1), Path.CLOSEPOLY])
    return Path(np.concatenate(vertices), np.concatenate(codes))


def _points(first: tuple[float, int], last: tuple[float, int]) -> np.ndarray:
    """Points (n, 2) along one side of a piece, a radius or an arc, without its end."""
    (r, k), (r_end, k_end) = first, last
    if r != r_end:
        angles = np.array([(k if r else k_end) * STEP_DEG])
    else:
        turn = 1 if (k_end - k) % round(360 / STEP_DEG) == 1 else -1
        angles = k * STEP_DEG + turn * np.arange(STEP_DEG)
    angles = np.radians(angles)
    return r * np.column_stack([np.cos(angles), np.sin(angles)])


def zone_shapes(parameters: StiffnessInputs) -> dict[str, ZoneShape]:
    """Zone -> its part of the disk."""
    return {zone: ZoneShape(segments) for zone, segments in parameters.zones.items()}


def paint(
    ax: Axes,
    colours: Sequence,
    labels: Sequence[str] | None = None,
    parameters: StiffnessInputs | None = None,
    edge: str = "white",
) -> None:
    """Fill the 17 segments of `ax` with `colours` and write `labels` into them.

    Colours and labels are in the order of the AHA numbers; with `parameters`, the borders of the
    zones are drawn in dark lines over the segments' borders, which are drawn in `edge`.
    """
    for cell, colour in zip(SEGMENT_CELLS, colours, strict=True):
        ax.add_patch(Polygon(cell.outline(), facecolor=colour, edgecolor=edge, linewidth=1.0))
    for cell, label, colour in zip(SEGMENT_CELLS, labels or [""] * 17, colours, strict=True):
        ax.text(*cell.centre, label, ha="center", va="center", color=_legible_on(colour))
    if parameters is not None:
        outline_zones(ax, parameters)
    frame(ax)


def _legible_on(colour) -> str:
    """Black or white, by the luma of the colour beneath (ITU-R BT.601 weights)."""
    return "black" if np.dot(to_rgb(colour), (0.299, 0.587, 0.114)) > 0.45 else "white"


def paint_values(
    ax: Axes,
    values: np.ndarray,
    norm: Normalize,
    cmap: str,
    labels: Sequence[str] | None = None,
    parameters: StiffnessInputs | None = None,
) -> ScalarMappable:
    """Colour the segments by `values` (17, AHA order); NaN is light grey. Return the colour scale.

    labels, parameters: as in `paint`. The result goes to `fig.colorbar`.
    """
    scale = ScalarMappable(norm, cmap)
    colours = [scale.to_rgba(v) if np.isfinite(v) else "#EEEEEE" for v in np.asarray(values)]
    paint(ax, colours, labels, parameters)
    return scale


def paint_zones(
    ax: Axes,
    values: Sequence[float],
    norm: Normalize,
    cmap: str,
    labels: Sequence[str],
    parameters: StiffnessInputs,
) -> ScalarMappable:
    """Fill the zones by `values` and write `labels` into them, both in the order of
    `parameters.zones`; NaN is light grey and stays empty. Return the colour scale.
    """
    scale = ScalarMappable(norm, cmap)
    shapes = zone_shapes(parameters)
    size = None if len(shapes) <= FEW_ZONES else 6
    for shape, value, label in zip(shapes.values(), np.asarray(values), labels, strict=True):
        known = np.isfinite(value)
        colour = scale.to_rgba(value) if known else "#EEEEEE"
        ax.add_patch(shape.patch(facecolor=colour, edgecolor="white", linewidth=1.2))
        if known:
            ax.text(
                *shape.centre,
                label,
                ha="center",
                va="center",
                color=_legible_on(colour),
                fontsize=size,
            )
    frame(ax)
    return scale


def outline_zones(
    ax: Axes, parameters: StiffnessInputs, colour: str = "#333333", linewidth: float = 1.6
) -> None:
    """Draw the borders of the zones."""
    for shape in zone_shapes(parameters).values():
        ax.add_patch(shape.patch(fill=False, edgecolor=colour, linewidth=linewidth))


def name(ax: Axes, text: str, shape: ZoneShape) -> None:
    """Write the name of a part of the disk outside the rim beside it, or inside above its middle.

    Outside, it needs axes with `NAMED` as the margin.
    """
    x, y = shape.centre
    middle: dict = {"ha": "center", "va": "center"}
    if x == y == 0 or max(SEGMENT_CELLS[number - 1].outer for number in shape.segments) < 1:
        ax.text(x, y + 0.12, text, **middle)
        return
    angle = np.arctan2(y, x)
    # Along the rim, and never upside down.
    turned = np.degrees(angle) + (-90 if y > -1e-6 else 90)
    ax.text(1.07 * np.cos(angle), 1.07 * np.sin(angle), text, rotation=turned, **middle)


def name_walls(ax: Axes) -> None:
    """Write anterior, septal, inferior and lateral around the disk."""
    for wall, numbers in aha.WALLS.items():
        name(ax, wall, ZoneShape(numbers))
    frame(ax, NAMED)


NAMED = 0.17
"""Margin of axes with names around the disk."""


def frame(ax: Axes, margin: float = 0.03) -> None:
    """Square axes around the disk, without ticks."""
    ax.set(xlim=(-1 - margin, 1 + margin), ylim=(-1 - margin, 1 + margin), aspect="equal")
    ax.set_axis_off()
