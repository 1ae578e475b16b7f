"""Regional stiffness of one subject on the bullseye of its zones (the paper's Figure 11)."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from regional_lv.criticism.case_posterior import AveragedPosterior, CasePosterior, read_averaged
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.plots import bullseye, style
from regional_lv.plots.density import density

LARGEST = (0.74, 0.60)
"""Width and height that densities and text of a zone need at most (the disk has radius 1)."""

GAP = 1.1
"""Between densities and text, for the labels of the ticks, in lines of text."""

SEAM = 0.9
"""Where numbers of the average end and those of the model as it is begin, right of a zone's middle,
in lines of text: both together are centred."""

STEP = 0.02
MARGIN = 0.015


class Layout(NamedTuple):
    """Where densities and text of a zone go, in the disk's own coordinates: middle of the zero line
    and half its length, height for densities on either side, top of the text; size of its letters
    (points) and distance of its lines."""

    x: float
    y: float
    half: float
    height: float
    text: float
    size: float
    line: float


@style.context
def draw(
    posterior: Path,
    findings: Path,
    source: str,
    parameters: StiffnessInputs,
    png: Path,
    csv: Path,
    truth: Path | None = None,
) -> None:
    """`draw_posterior` of one that is averaged over models (NetCDF, and its findings), with that of
    the model as it is in grey. truth: JSON of a synthetic subject."""
    draw_posterior(read_averaged(posterior, findings, truth), source, parameters, png, csv)


def draw_posterior(
    found: CasePosterior, source: str, parameters: StiffnessInputs, png: Path, csv: Path
) -> None:
    """Draw the factors of each zone about a zero line, the first one up, the second one down.

    source: `subjects.<name>.source` of the config. Densities share one axis of values, of the same
    length in every zone, and are scaled to equal height. The table is long: zone, parameter, item
    (the columns of the posterior's summary, truth, density, and of an average as_is_density),
    value, density.
    """
    summary = found.summary()
    shown = [found.draws[name] for name in parameters.names]
    if isinstance(found, AveragedPosterior):
        shown += [found.as_it_is[name] for name in parameters.names]
    upper = max(float(np.quantile(values, 0.999)) for values in shown)
    ticks = _ticks(max([upper, *found.truth.values()]))
    shapes = bullseye.zone_shapes(parameters)

    width = 9.0 if len(shapes) <= bullseye.FEW_ZONES else 14.0
    fig = style.figure(width, width + 0.6)
    ax = fig.subplots()
    rows = []
    for zone, shape in shapes.items():
        ax.add_patch(shape.patch(facecolor=parameters.colours[zone], alpha=0.10))
    bullseye.outline_zones(ax, parameters)
    factors = len(parameters.factors)
    places = _alike([_layout(shape, factors, 0.47 * width) for shape in shapes.values()], factors)
    for zone, place in zip(shapes, places, strict=True):
        rows += _zone(ax, zone, place, parameters, found, summary, ticks)
    bullseye.frame(ax)
    handles = _legend(parameters.factors, found)
    ax.legend(handles=handles, loc="lower left", bbox_to_anchor=(-0.02, -0.04))
    if found.noise:
        lines = [f"noise scales ({found.noise_unit})"]
        for name in found.noise:
            row = summary.loc[name]
            lines.append(f"{style.label(name)}  {_numbers(row)}")
            rows += [("", name, item, row[item], np.nan) for item in summary.columns]
        ax.text(1.04, -1.05, "\n".join(lines), ha="right", va="bottom", fontsize=8)
    style.suptitle(fig, found.title("Regional stiffness factors", source), found.warning)
    table = pd.DataFrame(rows, columns=["zone", "parameter", "item", "value", "density"])
    table.insert(0, "subject", found.case)
    table["verdict"] = found.verdict
    style.save(fig, table, png, csv)


def _numbers(row: pd.Series) -> str:
    """Those of a row of the summary."""
    if "sd" in row:
        return f"{row['mean']:.2f} ± {row['sd']:.2f}"
    return f"{row['median']:.2f} [{row['lower95']:.2f}, {row['upper95']:.2f}]"


def _ticks(upper: float) -> np.ndarray:
    """Round numbers from 0 to at least `upper`: the ends of the common axis are ticks."""
    step = next(s for s in (0.5, 1, 2, 5, 10, 20, 50, np.inf) if upper <= 5 * s)
    step = upper / 2 if np.isinf(step) else step
    return np.arange(0, np.ceil(upper / step) + 1) * step


def _layout(shape: bullseye.ZoneShape, factors: int, inches: float) -> Layout:
    """Densities above, the zone's name and a line for each factor below, in the largest box that
    the zone holds; inches: what 1 is on the figure."""
    x, y, width, height = _largest_box(shape)
    # The grid of the search may miss the zone's middle by less than a step.
    x, y = (
        float(c) if abs(c - at) < STEP else at for c, at in zip(shape.centre, (x, y), strict=True)
    )
    size = float(np.clip(72 * width * inches / 12.6, 4.5, 8.5))
    line = 1.6 * size / 72 / inches
    for_text = line * (factors + 1) + 0.2 * line
    sides = 2 if factors > 1 else 1
    # A density needs less height than width; what is left over goes above and below.
    tall = min(height - for_text - GAP * line, sides * min(0.21, 0.5 * width))
    top = y + (for_text + GAP * line + tall) / 2
    zero = top - tall / sides
    return Layout(x, zero, width / 2, tall / sides, top - tall - GAP * line, size, line)


def _alike(places: list[Layout], factors: int) -> list[Layout]:
    """The same with the axis and the height of the smallest: values can be compared across zones.

    The zero line goes down with the height, so that densities stay above their text.
    """
    half, height = min(p.half for p in places), min(p.height for p in places)
    return [
        p._replace(half=half, height=height, y=p.y - (p.height - height) * (factors > 1))
        for p in places
    ]


def _largest_box(shape: bullseye.ZoneShape) -> tuple[float, float, float, float]:
    """Middle (x, y), width and height of the largest box inside a zone, neither flat nor thin."""
    at = np.arange(-1, 1 + STEP / 2, STEP)
    x, y = np.meshgrid(at, at, indexing="ij")
    inside = shape.holds(np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
    # Counts of points of the zone to the left of and below each point, for counts in boxes.
    counts = np.zeros(np.add(inside.shape, 1), dtype=int)
    counts[1:, 1:] = inside.cumsum(axis=0).cumsum(axis=1)
    centre, best = np.array(shape.centre), (0.0, 0.0, (*shape.centre, 0.1, 0.1))
    most = [round(side / STEP) + 2 for side in LARGEST]
    for n in range(4, most[0]):
        for m in range(4, most[1]):
            # What is beyond these proportions, densities and text cannot use.
            across, up = n - 1, m - 1
            area = min(across, 2 * up) * min(up, 1.4 * across)
            if area < best[0]:
                continue
            full = counts[n:, m:] - counts[:-n, m:] - counts[n:, :-m] + counts[:-n, :-m] == n * m
            if not full.any():
                break
            corner = np.argwhere(full)
            middle = at[0] + STEP * (corner + np.array([n - 1, m - 1]) / 2)
            distance = np.hypot(*(middle - centre).T)
            near = distance.argmin()
            if (area, -distance[near]) > best[:2]:
                sides = STEP * np.array([n - 1, m - 1]) - 2 * MARGIN
                best = (area, -distance[near], (*middle[near], *sides))
    return best[2]


def _zone(
    ax,
    zone: str,
    layout: Layout,
    parameters: StiffnessInputs,
    posterior: CasePosterior,
    summary: pd.DataFrame,
    ticks: np.ndarray,
) -> list[tuple]:
    x0, y0, half, height, text, size, line = layout

    def place(value):
        return x0 - half + 2 * half * np.asarray(value) / ticks[-1]

    rows = []
    foot = y0 - height * (len(parameters.factors) > 1)
    ax.plot([x0 - half, x0 + half], [y0, y0], ":", color=style.GREY, linewidth=1)
    ax.plot([x0 - half, x0 + half], [foot, foot], color=style.GREY, linewidth=0.8)
    colours = style.factor_colours(parameters.factors)
    for at, (factor, colour) in enumerate(colours.items()):
        name, sign = f"{factor}_{zone}", 1 if at % 2 == 0 else -1
        values, heights = density(posterior.draws[name])
        curve = y0 + sign * height * heights / heights.max()
        ax.fill_between(place(values), y0, curve, color=colour, alpha=0.45, linewidth=0)
        ax.plot(place(values), curve, color=colour, linewidth=1)
        row = summary.loc[name]
        ax.plot(
            [place(row[posterior.middle])] * 2,
            [y0, y0 + sign * 0.55 * height],
            color=colour,
            linewidth=2.2,
        )
        if isinstance(posterior, AveragedPosterior):
            at_base, of_base = density(posterior.as_it_is[name])
            curve = y0 + sign * height * of_base / of_base.max()
            ax.plot(place(at_base), curve, color=style.GREY, linewidth=0.9)
            rows += [
                (zone, name, "as_is_density", v, h) for v, h in zip(at_base, of_base, strict=True)
            ]
        rows += [(zone, name, item, row[item], np.nan) for item in summary.columns]
        if name in posterior.truth:
            value = posterior.truth[name]
            ax.plot(
                [place(value)] * 2,
                [y0, y0 + sign * height],
                "--",
                color=style.BLACK,
                linewidth=1,
                marker="v" if sign > 0 else "^",
                markersize=5,
                markevery=[1],
            )
            rows.append((zone, name, "truth", value, np.nan))
        rows += [(zone, name, "density", v, h) for v, h in zip(values, heights, strict=True)]
        words = f"{style.factor_label(factor)} {_numbers(row)}"
        top, below = text - line * (1.2 + at), {"va": "top", "fontsize": size}
        if isinstance(posterior, AveragedPosterior):
            seam = x0 + SEAM * line
            ax.text(seam, top, words, ha="right", color=colour, **below)
            base = f"  {row['as_is_mean']:.2f}"
            ax.text(seam, top, base, ha="left", color=style.GREY, **below)
        else:
            ax.text(x0, top, words, ha="center", color=colour, **below)
    for tick in ticks:
        ax.plot([place(tick)] * 2, [foot, foot - 0.008], color=style.GREY, linewidth=0.8)
        ax.text(
            place(tick),
            foot - 0.014,
            f"{tick:g}",
            ha="center",
            va="top",
            fontsize=0.82 * size,
            color=style.GREY,
        )
    ax.text(
        x0,
        text,
        style.zone_label(zone),
        ha="center",
        va="top",
        fontweight="bold",
        fontsize=size + 0.5,
    )
    return rows


def _legend(factors: tuple[str, ...], found: CasePosterior) -> list[Artist]:
    sides = (" (above the line)", " (below the line)") if len(factors) > 1 else ("",)
    handles: list[Artist] = [
        Patch(color=colour, alpha=0.45, label=style.factor_label(name) + sides[at % len(sides)])
        for at, (name, colour) in enumerate(style.factor_colours(factors).items())
    ]
    middle = f"posterior {found.middle}"
    if isinstance(found, AveragedPosterior):
        handles.append(Line2D([], [], color=style.GREY, linewidth=0.9, label="the model as it is"))
        middle += ", averaged over models"
    handles.append(Line2D([], [], color=style.BLACK, linewidth=2.2, label=middle))
    if found.truth:
        handles.append(Line2D([], [], color=style.BLACK, marker="v", linestyle="--", label="truth"))
    return handles
