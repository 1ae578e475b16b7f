"""The emulator against the simulator on the test set."""

from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.emulators import label_of
from regional_lv.figures import style
from regional_lv.figures.verdicts import chosen

Z95 = 1.959963984540054
UNITS = {"volume": "mL", **dict.fromkeys(aha.DIRECTIONS, "strain")}


@style.context
def draw(predictions: Path, choice: Path, png: Path, csv: Path) -> None:
    """Draw predictive means with 95 % bars against the simulator's values, four panels.

    predictions: Parquet with case, output, truth, mean, sd; choice: JSON with the emulator's name
    (`final`). The table adds the bars' ends, whether
    each covers the truth, and each panel's RMSE and coverage as printed.
    """
    table = pd.read_parquet(predictions, columns=["case", "output", "truth", "mean", "sd"])
    table["quantity"] = table["output"].map(style.quantity_of)
    table["lower95"] = table["mean"] - Z95 * table["sd"]
    table["upper95"] = table["mean"] + Z95 * table["sd"]
    table["covered"] = table["truth"].between(table["lower95"], table["upper95"])
    squared = (table["mean"] - table["truth"]) ** 2
    table["rmse"] = np.sqrt(squared.groupby(table["quantity"]).transform("mean"))
    table["coverage95"] = table.groupby("quantity")["covered"].transform("mean")

    fig = style.figure(9.0, 9.6)
    grid = fig.add_gridspec(2, 2)
    for place, quantity in zip(grid, UNITS, strict=True):
        part = table[table["quantity"] == quantity]
        _panel(fig, place, part, quantity, with_legend=quantity == aha.DIRECTIONS[0])
    cases = table["case"].nunique()
    style.suptitle(fig, f"Emulator {label_of(chosen(choice))} on {cases} simulated test cases")
    style.save(fig, table, png, csv)


def _panel(fig, place, part: pd.DataFrame, quantity: str, with_legend: bool) -> None:
    """Parity above, error with its bars below."""
    unit = UNITS[quantity]
    upper, lower = place.subgridspec(2, 1, height_ratios=[3, 1]).subplots(sharex=True)
    colours = _colours(part)
    for ax, base in ((upper, 0.0), (lower, part["truth"])):
        # Rows are ordered by case, so that no zone hides the others.
        ax.vlines(
            part["truth"],
            part["lower95"] - base,
            part["upper95"] - base,
            colors=colours,
            linewidth=0.7,
            alpha=0.3,
        )
        ax.scatter(part["truth"], part["mean"] - base, c=colours, s=5, linewidths=0)
    ends = [part["truth"].min(), part["truth"].max()]
    upper.plot(ends, ends, color=style.BLACK, linewidth=0.7)
    lower.axhline(0, color=style.BLACK, linewidth=0.7)
    upper.set_ylabel(f"emulator ({unit})")
    lower.set(xlabel=f"simulator ({unit})", ylabel="error")
    upper.set_title(quantity.capitalize() + ("" if quantity == "volume" else " strain"))
    rmse = f"RMSE {part['rmse'].iloc[0]:.3g}{' mL' if unit == 'mL' else ''}"
    covered = f"95 % bars cover {100 * part['coverage95'].iloc[0]:.1f} %"
    upper.text(0.04, 0.96, f"{rmse}\n{covered}", transform=upper.transAxes, va="top")
    if with_legend:
        for zone, colour in aha.ZONE_COLOURS.items():
            upper.scatter([], [], c=colour, s=20, label=zone)
        upper.legend(loc="lower right", title="zone of the segment")


def _colours(part: pd.DataFrame) -> list[str]:
    """Colour of each row's zone, grey for the volume."""
    segments = [style.segment_of(output) for output in part["output"]]
    zones = [None if n is None else aha.SEGMENTS[n - 1].zone for n in segments]
    return [aha.ZONE_COLOURS.get(zone, style.GREY) for zone in zones]
