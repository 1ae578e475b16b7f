"""What the design brought: volumes, strains, and where simulations did not converge."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from regional_lv import aha
from regional_lv.figures import style

QUANTILES = {"lower95": 0.025, "lower50": 0.25, "median": 0.5, "upper50": 0.75, "upper95": 0.975}


@style.context
def draw(simulations: Path, excluded: Path, png: Path, csv: Path) -> None:
    """Draw the screened simulations (Parquet) and the excluded ones (CSV).

    The table is long: panel (volume | circumferential | radial | longitudinal | excluded), scale,
    item (output, volume bin or parameter), statistic, value.
    """
    table = pd.read_parquet(simulations, columns=["sample", "scale", *aha.OUTPUTS])
    lost = pd.read_csv(excluded)
    scales = [s for s in style.SCALE_COLOURS if s in set(table["scale"]) | set(lost["scale"])]

    fig = style.figure(11.0, 10.5)
    grid = fig.add_gridspec(4, 2, width_ratios=[1, 1.35])
    rows = _volume(fig.add_subplot(grid[0, 0]), table, scales)
    rows += _excluded(fig.add_subplot(grid[0, 1]), lost, scales, len(table))
    for row, direction in enumerate(aha.DIRECTIONS, start=1):
        ax = fig.add_subplot(grid[row, :])
        rows += _strains(ax, table, direction, scales)
        if row == len(aha.DIRECTIONS):
            ax.set_xlabel("AHA segment")
    handles = [
        Patch(color=style.SCALE_COLOURS[s], label=f"{s} scale ({(table['scale'] == s).sum()})")
        for s in scales
    ]
    fig.legend(handles=handles, loc="outside upper right", ncols=len(scales))
    style.suptitle(fig, f"{len(table)} converged simulations of the training design")
    columns = ["panel", "scale", "item", "statistic", "value"]
    style.save(fig, pd.DataFrame(rows, columns=columns), png, csv)


def _volume(ax: Axes, table: pd.DataFrame, scales: list[str]) -> list[tuple]:
    rows = []
    edges = np.histogram_bin_edges(table["volume_ml"], bins=40)
    for scale in scales:
        values = table.loc[table["scale"] == scale, "volume_ml"]
        counts, _ = np.histogram(values, edges)
        ax.stairs(counts, edges, fill=True, alpha=0.35, color=style.SCALE_COLOURS[scale])
        ax.stairs(counts, edges, color=style.SCALE_COLOURS[scale])
        middles = (edges[1:] + edges[:-1]) / 2
        rows += [
            ("volume", scale, f"{m:.2f} ml", "count", c)
            for m, c in zip(middles, counts, strict=True)
        ]
    ax.set(xlabel="end-diastolic volume (mL)", ylabel="simulations")
    ax.set_title("Volume")
    return rows


def _strains(ax: Axes, table: pd.DataFrame, direction: str, scales: list[str]) -> list[tuple]:
    """Boxes per segment: median, middle half, whiskers over the middle 95 %."""
    rows = []
    for place, scale in enumerate(scales):
        part = table[table["scale"] == scale]
        boxes = []
        for segment in aha.SEGMENTS:
            name = f"{direction}_{segment.number:02d}"
            if part.empty:
                continue
            stats = {key: part[name].quantile(q) for key, q in QUANTILES.items()}
            rows += [(direction, scale, name, key, value) for key, value in stats.items()]
            boxes.append(
                {
                    "med": stats["median"],
                    "q1": stats["lower50"],
                    "q3": stats["upper50"],
                    "whislo": stats["lower95"],
                    "whishi": stats["upper95"],
                }
            )
        if not boxes:
            continue
        colour = style.SCALE_COLOURS[scale]
        offset = 0.38 * (place - (len(scales) - 1) / 2)
        ax.bxp(
            boxes,
            positions=np.arange(1, 18) + offset,
            widths=0.32,
            showfliers=False,
            patch_artist=True,
            manage_ticks=False,
            boxprops={"facecolor": colour, "alpha": 0.45, "edgecolor": colour},
            medianprops={"color": style.BLACK, "linewidth": 1.4},
            whiskerprops={"color": colour},
            capprops={"color": colour},
        )
    ax.axhline(0, color=style.GREY, linewidth=0.6, zorder=0)
    ax.set_xticks(range(1, 18))
    ax.set(xlim=(0.4, 17.6), ylabel="strain")
    ax.set_title(f"{direction.capitalize()} strain: median, middle 50 % and 95 %")
    return rows


def _excluded(ax: Axes, lost: pd.DataFrame, scales: list[str], converged: int) -> list[tuple]:
    rows = []
    height = {name: -i for i, name in enumerate(aha.PARAMETERS)}
    for name, y in height.items():
        ax.axhline(y, color=style.LIGHT, linewidth=0.8, zorder=0)
        for place, scale in enumerate(scales):
            part = lost[lost["scale"] == scale]
            offset = 0.3 * (place - (len(scales) - 1) / 2)
            ax.plot(
                part[f"place_{name}"],
                np.full(len(part), y - offset),
                "x",
                color=style.SCALE_COLOURS[scale],
                markersize=4,
            )
            rows += [
                ("excluded", scale, name, f"place of sample {sample}", value)
                for sample, value in zip(part["sample"], part[f"place_{name}"], strict=True)
            ]
    ax.set_yticks(list(height.values()), [style.parameter_label(n) for n in height])
    ax.set(xlim=(-0.02, 1.02), xlabel="place in the box, log scale (0 lower bound, 1 upper bound)")
    total = converged + len(lost)
    ax.set_title(f"Not converged: {len(lost)} of {total} ({100 * len(lost) / total:.2f} %)")
    if lost.empty:
        ax.text(
            0.5,
            0.5,
            "every simulation converged",
            transform=ax.transAxes,
            ha="center",
            bbox={"facecolor": "white", "edgecolor": "none"},
        )
    return rows
