"""The cardiac mechanics benchmark: our results on every mesh beside the participants'."""

from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from regional_lv.plots import style

PANELS = {
    "tip_z_mm": ("Problem 1, beam", "z of the tip (mm)"),
    "endo_apex_z_mm": ("Problem 2, endocardium", "z of the apex (mm)"),
    "epi_apex_z_mm": ("Problem 2, epicardium", "z of the apex (mm)"),
    "cavity_mm3": ("Problem 2, cavity", "volume (mm$^3$)"),
}
PUBLISHED_COLOURS = dict(
    zip(
        ("KCL", "Simula", "IBM", "Johns Hopkins", "Glasgow"),
        (style.ORANGE, style.GREEN, style.VERMILLION, style.PINK, style.GREY),
        strict=True,
    )
)


FAR = "Glasgow"
"""The code, of an immersed boundary, whose values would leave no room between the others."""


@style.context
def draw(results: Path, published: Path, png: Path, csv: Path) -> None:
    """Draw `verification.land.run`'s table (CSV) over the published values (CSV).

    Axes hold our values and those of all participants but FAR, whose value is written where it lies
    outside. The table is long: quantity, by (study | code), name (mesh or code), unknowns, value.
    """
    ours, theirs = pd.read_csv(results), pd.read_csv(published)
    fig = style.figure(9.0, 6.0)
    rows = []
    for ax, (quantity, (title, label)) in zip(
        fig.subplots(2, 2).ravel(), PANELS.items(), strict=True
    ):
        rows += _panel(ax, quantity, ours, theirs)
        ax.set(xscale="log", xlabel="unknowns", ylabel=label)
        style.plain_log(ax.xaxis)
        ax.set_title(title)
    handles = [
        Line2D([], [], color=style.BLUE, marker="o", markersize=4, label="this simulator"),
        *(Line2D([], [], color=c, label=code) for code, c in PUBLISHED_COLOURS.items()),
        Patch(color=style.LIGHT, label="range of the participants"),
    ]
    fig.legend(handles=handles, loc="outside lower center", ncols=4)
    style.suptitle(fig, "Cardiac mechanics benchmark (Land et al. 2015)")
    columns = ["quantity", "by", "name", "unknowns", "value"]
    style.save(fig, pd.DataFrame(rows, columns=columns), png, csv)


def _panel(ax: Axes, quantity: str, ours: pd.DataFrame, theirs: pd.DataFrame) -> list[tuple]:
    mine, known = ours.dropna(subset=quantity), theirs.dropna(subset=quantity)
    ax.axhspan(known[quantity].min(), known[quantity].max(), color=style.LIGHT, zorder=0)
    for code, value in zip(known["code"], known[quantity], strict=True):
        ax.axhline(value, color=PUBLISHED_COLOURS[code])
    ax.plot(mine["unknowns"], mine[quantity], "o-", color=style.BLUE, markersize=4, zorder=3)
    shown = pd.concat([mine[quantity], known.loc[known["code"] != FAR, quantity]])
    low, high = shown.min(), shown.max()
    ax.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    for value in known.loc[known["code"] == FAR, quantity]:
        if not low <= value <= high:
            ax.text(0.97, 0.04, f"{FAR}: {value:g}", transform=ax.transAxes, ha="right", fontsize=8)
    return [
        (quantity, "study", *row)
        for row in mine[["mesh", "unknowns", quantity]].itertuples(index=False)
    ] + [
        (quantity, "code", code, "", value)
        for code, value in zip(known["code"], known[quantity], strict=True)
    ]
