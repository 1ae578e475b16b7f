"""How many principal components the strains need."""

from pathlib import Path

import pandas as pd
import seaborn

from regional_lv.plots import style


@style.context
def draw(explained: Path, png: Path, csv: Path, threshold: float = 0.999) -> None:
    """Draw the variance that each component and the first k together leave unexplained.

    explained: CSV with component (1, 2, ...), explained, cumulative (fractions), kept. threshold:
    the share from which on no more are kept.
    """
    table = pd.read_csv(explained)
    kept = int(table["kept"].sum())

    fig = style.figure(8.0, 3.6)
    left, right = fig.subplots(1, 2)
    seaborn.barplot(
        x=table["component"],
        y=100 * table["explained"],
        hue=table["kept"],
        ax=left,
        palette={True: style.BLUE, False: style.LIGHT},
        saturation=1,
        legend=False,
        native_scale=True,
    )
    left.set(yscale="log", xlabel="principal component", ylabel="explained variance (%)")
    left.set_title("Each component")

    missing = 100 * (1 - table["cumulative"])
    shown = missing > 1e-10  # the last component leaves nothing, which a log axis cannot show
    seaborn.lineplot(
        x=table["component"][shown],
        y=missing[shown],
        color=style.BLUE,
        marker="o",
        markersize=4,
        ax=right,
    )
    right.axhline(100 * (1 - threshold), color=style.VERMILLION, linestyle="--")
    right.annotate(
        f"{100 * threshold:g} % explained",
        (1, 100 * (1 - threshold)),
        xycoords=("axes fraction", "data"),
        xytext=(0, 3),
        textcoords="offset points",
        ha="right",
        color=style.VERMILLION,
    )
    right.axvline(kept, color=style.GREY, linestyle=":", linewidth=1)
    right.set(yscale="log", xlabel="components kept", ylabel="variance left out (%)")
    for ax in (left, right):
        ax.xaxis.get_major_locator().set_params(integer=True)
    right.set_title("Together")
    style.suptitle(
        fig, f"{kept} of {len(table)} components explain {100 * threshold:g} % of the strains"
    )
    style.save(fig, table, png, csv)
