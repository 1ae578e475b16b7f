"""Regional stiffness of one subject on the five-zone bullseye (the paper's Figure 11)."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from regional_lv import aha
from regional_lv.figures import bullseye, style
from regional_lv.figures.posterior import Posterior, density, read

# Where each zone's densities and text go, in the disk's own coordinates: middle of the zero line
# and half its length, half the height for densities, and the first line of text.
PLACES = {
    "anterior": ((0.0, 0.815), 0.30, 0.120, (0.0, 0.665)),
    "septal": ((-0.735, 0.08), 0.20, 0.180, (-0.735, -0.140)),
    "inferior": ((0.0, -0.660), 0.30, 0.120, (0.0, -0.810)),
    "lateral": ((0.735, 0.08), 0.20, 0.180, (0.735, -0.140)),
    "apical": ((0.0, 0.12), 0.36, 0.210, (0.0, -0.130)),
}


@style.context
def draw(
    nc: Path, diagnostics: Path, source: str, png: Path, csv: Path, truth: Path | None = None
) -> None:
    """Draw C_a (blue, up) and C_b (vermillion, down) of each zone about a zero line.

    nc: posterior of one subject; diagnostics: its verdict; source: `subjects.<name>.source` of the
    config; truth: JSON of a synthetic subject. Densities share one axis of values and are scaled
    to equal height. The table is long: zone, parameter, item (median, lower95, upper95, truth,
    density), value, density.
    """
    posterior = read(nc, diagnostics, truth=truth)
    summary = posterior.summary()
    upper = max(np.quantile(posterior.draws[name], 0.999) for name in aha.PARAMETERS)
    upper = max([upper, *posterior.truth.values()])
    ticks = _ticks(upper)

    fig = style.figure(9.0, 9.6)
    ax = fig.subplots()
    rows = []
    for zone, cell in bullseye.ZONE_CELLS.items():
        face = Polygon(cell.outline(), facecolor=aha.ZONE_COLOURS[zone], alpha=0.10)
        ax.add_patch(face)
    bullseye.outline_zones(ax)
    for zone in aha.ZONES:
        rows += _zone(ax, zone, posterior, summary, ticks)
    bullseye.frame(ax)
    ax.legend(handles=_legend(posterior), loc="lower left", bbox_to_anchor=(-0.02, -0.04))
    if posterior.noise:
        lines = ["noise scales (standardised)"]
        for name in posterior.noise:
            row = summary.loc[name]
            lines.append(f"{style.parameter_label(name)}  {_interval(row)}")
            rows += [("", name, item, row[item], np.nan) for item in summary.columns]
        ax.text(1.04, -1.05, "\n".join(lines), ha="right", va="bottom", fontsize=8)
    style.suptitle(fig, posterior.title("Regional stiffness factors", source), posterior.warning)
    table = pd.DataFrame(rows, columns=["zone", "parameter", "item", "value", "density"])
    table.insert(0, "subject", posterior.case)
    table["verdict"] = posterior.verdict
    style.save(fig, table, png, csv)


def _interval(row: pd.Series) -> str:
    return f"{row['median']:.2f} [{row['lower95']:.2f}, {row['upper95']:.2f}]"


def _ticks(upper: float) -> np.ndarray:
    """Round numbers from 0 to at least `upper`: the ends of the common axis are ticks."""
    step = next(s for s in (0.5, 1, 2, 5, 10, 20, 50, np.inf) if upper <= 5 * s)
    step = upper / 2 if np.isinf(step) else step
    return np.arange(0, np.ceil(upper / step) + 1) * step


def _zone(ax, zone: str, posterior: Posterior, summary: pd.DataFrame, ticks: np.ndarray):
    (x0, y0), half, height, (tx, ty) = PLACES[zone]

    def place(value):
        return x0 - half + 2 * half * np.asarray(value) / ticks[-1]

    rows = []
    ax.plot([x0 - half, x0 + half], [y0, y0], ":", color=style.GREY, linewidth=1)
    for sign, kind in ((1, "C_a"), (-1, "C_b")):
        name, colour = f"{kind}_{zone}", style.STIFFNESS_COLOURS[kind]
        values, heights = density(posterior.draws[name])
        curve = y0 + sign * height * heights / heights.max()
        ax.fill_between(place(values), y0, curve, color=colour, alpha=0.45, linewidth=0)
        ax.plot(place(values), curve, color=colour, linewidth=1)
        row = summary.loc[name]
        ax.plot(
            [place(row["median"])] * 2, [y0, y0 + sign * 0.55 * height], color=colour, linewidth=2.2
        )
        rows += [(zone, name, item, row[item], np.nan) for item in summary.columns]
        if name in posterior.truth:
            value = posterior.truth[name]
            ax.plot(
                [place(value)] * 2,
                [y0, y0 + sign * 1.08 * height],
                "--",
                color=style.BLACK,
                linewidth=1,
                marker="v" if sign > 0 else "^",
                markersize=5,
                markevery=[1],
            )
            rows.append((zone, name, "truth", value, np.nan))
        rows += [(zone, name, "density", v, h) for v, h in zip(values, heights, strict=True)]
        line = 0.045 * (0 if sign > 0 else 1)
        ax.text(
            tx,
            ty - 0.055 - line,
            f"${kind}$ {_interval(row)}",
            ha="center",
            va="top",
            color=colour,
            fontsize=8.5,
        )
    for tick in ticks:
        ax.plot([place(tick)] * 2, [y0 - 0.008, y0 + 0.008], color=style.GREY, linewidth=0.8)
    for tick in ticks[[0, -1]]:
        ax.text(
            place(tick),
            y0 - 0.016,
            f"{tick:g}",
            ha="center",
            va="top",
            fontsize=7,
            color=style.GREY,
        )
    ax.text(tx, ty, zone, ha="center", va="top", fontweight="bold", fontsize=9)
    return rows


def _legend(posterior: Posterior) -> list:
    handles = [
        Patch(color=style.BLUE, alpha=0.45, label="$C_a$ (above the line)"),
        Patch(color=style.VERMILLION, alpha=0.45, label="$C_b$ (below the line)"),
        Line2D([], [], color=style.GREY, linewidth=2.2, label="posterior median"),
    ]
    if posterior.truth:
        handles.append(Line2D([], [], color=style.BLACK, marker="v", linestyle="--", label="truth"))
    return handles
