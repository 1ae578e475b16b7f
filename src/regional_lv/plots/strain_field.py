"""Strains through the wall and how they spread within a zone (the paper's Figure 2)."""

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

import numpy as np
import pandas as pd
import seaborn
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.ticker import MaxNLocator

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.plots import heart, style
from regional_lv.quantities import QUANTITIES, seth_hill

LINES = ("-", "--", "-.", ":", (0, (6, 1, 1, 1, 1, 1)))
COLOURS = (style.BLUE, style.VERMILLION, style.GREEN, style.PINK, style.BLACK)
GRID = 160


@style.context
def draw(
    vtu: Path,
    strains: Path,
    strain_exponent: float,
    parameters: StiffnessInputs,
    png: Path,
    csv: Path,
) -> None:
    """Draw each strain on the deformed heart, cut open, and its densities in every segment.

    vtu, strains: mesh with `displacement` and table of strains of `strain_field.map_strains`;
    strain_exponent: the member of the Seth-Hill family that they are. Densities
    weight each integration point with its volume; dashes at the foot are the medians. The table is
    long: zone, segment, direction, item (mean, sd, median, q025, q975, density), value, density.
    """
    table = pd.read_parquet(strains)
    directions = [name for name in QUANTITIES if QUANTITIES[name].is_strain and name in table]
    zones, per_zone = parameters.zones, len(directions)
    (lines, across), _ = style.zone_places(len(zones), per_zone)
    fig = style.figure(1.6 * max(across, 3) + 2.4, 2.3 * lines + 0.6)
    ratios = [1, 0.66 * max(across, 3)]
    left, right = fig.subfigures(1, 2, squeeze=False, width_ratios=ratios)[0]
    measure = f"{seth_hill.measure_name(strain_exponent)} strain"
    _pictures(left, vtu, table, directions, measure)
    rows = []
    axes = style.zone_panels(right, len(zones), per_zone)
    for line, direction in zip(axes, directions, strict=True):
        for ax in line[1:]:
            ax.sharex(line[0])
        for ax, (zone, segments) in zip(line, zones.items(), strict=True):
            rows += _densities(ax, table, zone, segments, direction)
        for ax in line[:: style.ZONES_PER_ROW]:
            ax.set_ylabel(f"{direction}\ndensity")
    for ax, (zone, segments) in zip(axes[0], zones.items(), strict=True):
        many = len(segments) > len(COLOURS)
        ax.legend(
            title=f"{style.zone_label(zone)}, AHA",
            title_fontproperties={"size": 9, "weight": "bold"},
            loc="lower center",
            bbox_to_anchor=(0.5, 1.0),
            handlelength=1.6,
            columnspacing=0.8,
            labelspacing=0.2,
            ncols=5 if many else 3,
            fontsize=6 if many else None,
        )
        ax.spines["top"].set(visible=True, color=parameters.colours[zone], linewidth=4)
    for ax in axes[-1]:
        ax.set_xlabel(measure)
    style.suptitle(fig, r"Strains at end diastole, all factors 1 ($\theta = 1$)")
    columns = ["zone", "segment", "direction", "item", "value", "density"]
    style.save(fig, pd.DataFrame(rows, columns=columns), png, csv)


def _pictures(fig, vtu: Path, table: pd.DataFrame, directions: Sequence[str], measure: str) -> None:
    per_edge = round(np.cbrt(table["point"].nunique()))  # a piece of a cell around each point
    grid = heart.straight_cells(vtu, per_edge, linear=per_edge, moved=True)
    part = pd.MultiIndex.from_arrays([grid.cell_data["element"], grid.cell_data["part"]])
    values = table.set_index(["cell", "point"])[list(directions)].loc[part]
    for name in directions:
        grid.cell_data[name] = values[name].to_numpy()
    shown = heart.cut(grid)
    for ax, name in zip(
        fig.subplots(len(directions), 1, squeeze=False)[:, 0], directions, strict=True
    ):
        norm = Normalize(*np.quantile(table[name], [0.01, 0.99]))
        # Bright where the strain is large, whatever its sign.
        scale = ScalarMappable(norm, "cividis" if table[name].mean() > 0 else "cividis_r")
        ax.imshow(heart.render(shown, 255 * scale.to_rgba(shown.cell_data[name])[:, :3]))
        ax.set_title(name)
        ax.set_axis_off()
        fig.colorbar(scale, ax=ax, shrink=0.8, label=measure)


def _densities(
    ax: Axes, table: pd.DataFrame, zone: str, segments: Sequence[int], direction: str
) -> list[tuple]:
    rows: list[tuple] = []
    for number, line, colour in zip(segments, cycle(LINES), cycle(COLOURS), strict=False):
        part = table[table["segment"] == number]
        values, weights = part[direction].to_numpy(), part["volume_mm3"].to_numpy()
        mean = np.average(values, weights=weights)
        low, median, high = weighted_quantiles(values, weights, [0.025, 0.5, 0.975])
        sd = np.sqrt(np.average((values - mean) ** 2, weights=weights))
        for item, value in zip(
            ("mean", "sd", "median", "q025", "q975"), (mean, sd, median, low, high), strict=True
        ):
            rows.append((zone, number, direction, item, value, None))
        seaborn.kdeplot(
            x=values,
            weights=weights,
            ax=ax,
            gridsize=GRID,
            cut=1.5,
            color=colour,
            linestyle=line,
            label=str(number),
        )
        at, heights = map(np.asarray, ax.lines[-1].get_data())
        rows += [
            (zone, number, direction, "density", v, h) for v, h in zip(at, heights, strict=True)
        ]
        ax.axvline(median, ymax=0.12, color=colour, linewidth=1.6)
    ax.set_ylim(bottom=0)
    ax.set(yticks=[], ylabel="")
    ax.xaxis.set_major_locator(MaxNLocator(3))
    return rows


def weighted_quantiles(values: np.ndarray, weights: np.ndarray, levels) -> np.ndarray:
    """Values below which `levels` of the total weight lie."""
    order = np.argsort(values)
    reached = np.cumsum(weights[order])
    return np.interp(np.asarray(levels) * reached[-1], reached - weights[order] / 2, values[order])
