"""Errors against the number of simulations, by inputs, with and without sensitivities."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import seaborn

from regional_lv.emulators import label_of
from regional_lv.plots import style

COLOURS = {"exact_gp": style.BLUE, "gradient_gp": style.VERMILLION}
INPUTS = {"log": "log inputs", "identity": "natural inputs"}
PANELS = {
    "predictive_mse": "MSE of the outputs (squared training sd)",
    "param_mse": "MSE of the parameters (squared factor)",
}


@style.context
def draw(curves: Sequence[Path], png: Path, csv: Path) -> None:
    """Draw the tables (CSV) of `paper.estimates.efficiency`; the figure's table is all of them.

    Errors have one unit wherever they are drawn: those of the outputs squared training standard
    deviations, those of the parameters, by weighted estimates, squared stiffness factors.
    """
    table = pd.concat([pd.read_csv(path) for path in curves], ignore_index=True)
    shown = table.assign(
        curve=table["emulator"].map(label_of) + ", " + table["input_transform"].map(INPUTS)
    )
    kinds = shown.drop_duplicates("curve").set_index("curve")
    dashes = {"log": "", "identity": (3, 1.5)}
    fig = style.figure(9.0, 4.2)
    axes = fig.subplots(1, 2)
    for ax, (column, label) in zip(axes, PANELS.items(), strict=True):
        seaborn.lineplot(
            shown,
            x="simulations",
            y=column,
            hue="curve",
            style="curve",
            ax=ax,
            palette=kinds["emulator"].map(COLOURS).to_dict(),
            estimator=None,
            dashes=kinds["input_transform"].map(dashes).to_dict(),
            markers=dict.fromkeys(kinds.index, "o"),
            markersize=5,
        )
        ax.set(xscale="log", yscale="log", xlabel="training simulations", ylabel=label)
        sizes = sorted(table["simulations"].unique())
        ax.set_xticks(sizes, [f"{size:,}" for size in sizes], rotation=45)
        ax.minorticks_off()
        ax.grid(True)
    handles, labels = axes[0].get_legend_handles_labels()
    for ax in axes:
        ax.get_legend().remove()
    fig.legend(handles, labels, loc="outside lower center", ncols=2)
    style.suptitle(fig, "Errors on the test set against the number of training simulations")
    style.save(fig, table, png, csv)
