"""How many principal components the strains need."""

from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.plots import style


@style.context
def draw(explained: Path, png: Path, csv: Path, threshold: float = 0.999) -> None:
    """Draw the variance that each component and the first k together leave unexplained.

    explained: CSV with component (1, 2, ...), explained, cumulative (fractions). The table adds
    `kept`: whether the component is among the fewest that reach `threshold`.
    """
    table = pd.read_csv(explained)
    reached = table["cumulative"] >= threshold
    kept = int(np.argmax(reached)) + 1 if reached.any() else len(table)
    table["kept"] = np.arange(len(table)) < kept

    fig = style.figure(8.0, 3.6)
    left, right = fig.subplots(1, 2)
    colours = np.where(table["kept"], style.BLUE, style.LIGHT)
    left.bar(table["component"], 100 * table["explained"], color=colours)
    left.set(yscale="log", xlabel="principal component", ylabel="explained variance (%)")
    left.set_title("Each component")

    missing = 100 * (1 - table["cumulative"])
    shown = missing > 1e-10  # the last component leaves nothing, which a log axis cannot show
    right.plot(table["component"][shown], missing[shown], "o-", color=style.BLUE, markersize=3)
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
    right.set_title("Together")
    style.suptitle(
        fig, f"{kept} of {len(table)} components explain {100 * threshold:g} % of the strains"
    )
    style.save(fig, table, png, csv)
