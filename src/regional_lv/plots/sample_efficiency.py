"""Errors against the number of simulations, by inputs, with and without sensitivities."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from regional_lv.emulators import label_of
from regional_lv.plots import style

COLOURS = {"exact_gp": style.BLUE, "gradient_gp": style.VERMILLION}
LINES = {"log": ("-", "log inputs"), "identity": ("--", "natural inputs")}
PANELS = {
    "predictive_mse": "MSE of the outputs (squared training sd)",
    "param_mse": "MSE of the parameters (weighted estimates)",
}


@style.context
def draw(curves: Sequence[Path], png: Path, csv: Path) -> None:
    """Draw the tables (CSV) of `estimates.efficiency`; the figure's table is all of them."""
    table = pd.concat([pd.read_csv(path) for path in curves], ignore_index=True)
    fig = style.figure(9.0, 4.2)
    axes = fig.subplots(1, 2)
    for ax, (column, label) in zip(axes, PANELS.items(), strict=True):
        for (name, transform), part in table.groupby(["emulator", "input_transform"], sort=False):
            line, words = LINES[transform]
            ax.plot(
                part["simulations"],
                part[column],
                f"o{line}",
                color=COLOURS[name],
                markersize=4,
                label=f"{label_of(name)}, {words}",
            )
        ax.set(xscale="log", yscale="log", xlabel="training simulations", ylabel=label)
        sizes = sorted(table["simulations"].unique())
        ax.set_xticks(sizes, [f"{size}" for size in sizes], rotation=45)
        ax.minorticks_off()
        ax.grid(True, which="major", color=style.LIGHT, linewidth=0.5)
    fig.legend(handles=axes[0].get_lines(), loc="outside lower center", ncols=2)
    style.suptitle(fig, "Errors on the test set against the number of training simulations")
    style.save(fig, table, png, csv)
