"""The cardiac mechanics benchmark: our results on every mesh beside the participants'."""

from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from regional_lv.plots import style

PANELS = {
    "tip_z_mm": ("Problem 1, beam", "z of the tip (mm)"),
    "endo_apex_z_mm": ("Problem 2, endocardium", "z of the apex (mm)"),
    "epi_apex_z_mm": ("Problem 2, epicardium", "z of the apex (mm)"),
    "cavity_mm3": ("Problem 2, cavity", "volume (mm$^3$)"),
}
PUBLISHED_LOOKS: dict[str, dict] = {
    "KCL": {"color": style.ORANGE, "linestyle": "--"},
    "Simula": {"color": style.GREEN, "linestyle": "-"},
    "IBM": {"color": style.VERMILLION, "linestyle": ":"},
    "Johns Hopkins": {"color": style.PINK, "linestyle": "-."},
    "Glasgow": {"color": style.GREY, "linestyle": (0, (6, 1, 1, 1, 1, 1))},
}

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
        *(Line2D([], [], label=code, **look) for code, look in PUBLISHED_LOOKS.items()),
    ]
    fig.legend(handles=handles, loc="outside lower center", ncols=6, handlelength=3)
    style.suptitle(
        fig, "Benchmark of Land et al. 2015: this simulator, and each code's finest mesh"
    )
    columns = ["quantity", "by", "name", "unknowns", "value"]
    style.save(fig, pd.DataFrame(rows, columns=columns), png, csv)


def _panel(ax: Axes, quantity: str, ours: pd.DataFrame, theirs: pd.DataFrame) -> list[tuple]:
    mine, known = ours.dropna(subset=quantity), theirs.dropna(subset=quantity)
    for code, value in zip(known["code"], known[quantity], strict=True):
        ax.axhline(value, linewidth=1.6, **PUBLISHED_LOOKS[code])
    ax.plot(mine["unknowns"], mine[quantity], "o-", color=style.BLUE, markersize=5, zorder=3)
    shown = pd.concat([mine[quantity], known.loc[known["code"] != FAR, quantity]])
    low, high = shown.min(), shown.max()
    ax.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    for value in known.loc[known["code"] == FAR, quantity]:
        if not low <= value <= high:
            ax.text(0.97, 0.04, f"{FAR}: {value:g}", transform=ax.transAxes, ha="right")
    return [
        (quantity, "study", *row)
        for row in mine[["mesh", "unknowns", quantity]].itertuples(index=False)
    ] + [
        (quantity, "code", code, "", value)
        for code, value in zip(known["code"], known[quantity], strict=True)
    ]
