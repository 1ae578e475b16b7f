"""The emulator against the simulator on the test set."""

from pathlib import Path

import numpy as np
import pandas as pd
import seaborn

from regional_lv.channels import Channel, Channels
from regional_lv.emulators import label_of
from regional_lv.emulators.gaussian import Z95
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.posteriors.files import chosen
from regional_lv.plots import bullseye, style
from regional_lv.units import after_number


@style.context
def draw(
    predictions: Path, choice: Path, parameters: StiffnessInputs, png: Path, csv: Path
) -> None:
    """Draw predictive means with 95 % bars against the simulator's values.

    Each quantity has a panel, and another one for each load below the full one.

    predictions: Parquet with case, output, truth, mean, sd; choice: JSON with the emulator's name
    (`final`). The table adds the quantity, the bars' ends, whether each covers the truth, and each
    panel's RMSE and coverage as printed.
    """
    table = pd.read_parquet(predictions, columns=["case", "output", "truth", "mean", "sd"])
    channels = Channels.parse(table["output"].unique())
    table["quantity"] = table["output"].map({c.name: c.quantity for c in channels})
    titles = {c.name: f"{c.quantity}{style.load_label(c.load_fraction)}" for c in channels}
    panel = table["output"].map(titles)
    table["lower95"] = table["mean"] - Z95 * table["sd"]
    table["upper95"] = table["mean"] + Z95 * table["sd"]
    table["covered"] = table["truth"].between(table["lower95"], table["upper95"])
    squared = (table["mean"] - table["truth"]) ** 2
    table["rmse"] = np.sqrt(squared.groupby(panel).transform("mean"))
    table["coverage95"] = table["covered"].groupby(panel).transform("mean")

    shown = {titles[channel.name]: channel for channel in channels}
    lines = -(-len(shown) // 2)
    fig = style.figure(9.0, 4.8 * lines)
    grid = fig.add_gridspec(lines, 2)
    legend_at = next((title for title, channel in shown.items() if channel.segment), None)
    for at, (title, channel) in enumerate(shown.items()):
        _panel(fig, grid[at], table[panel == title], channel, parameters, title == legend_at)
    cases = table["case"].nunique()
    style.suptitle(fig, f"Emulator {label_of(chosen(choice))} on {cases} simulated test cases")
    style.save(fig, table, png, csv)


def _panel(
    fig, place, part: pd.DataFrame, channel: Channel, parameters: StiffnessInputs, legend: bool
) -> None:
    """Parity above, error with its bars below. channel: one of those in the panel."""
    unit = after_number(channel.unit)
    read_as = unit.strip() or ("strain" if channel.kind.is_strain else channel.quantity)
    upper, lower = place.subgridspec(2, 1, height_ratios=[3, 1]).subplots(sharex=True)
    zones, palette = _zones(part, parameters), {**parameters.colours, "": style.GREY}
    named = legend and len(parameters.zones) <= bullseye.FEW_ZONES
    points = part.assign(error=part["mean"] - part["truth"])
    for ax, shown, base in ((upper, "mean", 0.0), (lower, "error", part["truth"])):
        # Rows are ordered by case, so that no zone hides the others.
        ax.vlines(
            part["truth"],
            part["lower95"] - base,
            part["upper95"] - base,
            colors=zones.map(palette),
            linewidth=0.7,
            alpha=0.3,
        )
        seaborn.scatterplot(
            points,
            x="truth",
            y=shown,
            hue=zones.map(style.zone_label),
            s=6,
            palette={style.zone_label(z): c for z, c in palette.items()},
            linewidth=0,
            legend=named and ax is upper,
            ax=ax,
        )
    ends = [part["truth"].min(), part["truth"].max()]
    upper.plot(ends, ends, color=style.BLACK, linewidth=0.7)
    lower.axhline(0, color=style.BLACK, linewidth=0.7)
    upper.set_ylabel(f"emulator ({read_as})")
    lower.set(xlabel=f"simulator ({read_as})", ylabel="error")
    title = channel.quantity.capitalize() + (" strain" if channel.kind.is_strain else "")
    upper.set_title(title + style.load_label(channel.load_fraction))
    rmse = f"RMSE {part['rmse'].iloc[0]:.3g}{unit}"
    covered = f"95 % bars cover {100 * part['coverage95'].iloc[0]:.1f} %"
    upper.text(0.04, 0.96, f"{rmse}\n{covered}", transform=upper.transAxes, va="top")
    if named:
        upper.legend(loc="lower right", title=zones.name, markerscale=2)


def _zones(part: pd.DataFrame, parameters: StiffnessInputs) -> pd.Series:
    """Zone of each row's segment; what belongs to no segment has none."""
    zone = {
        channel.name: parameters.zone_of(channel.segment) if channel.segment else ""
        for channel in Channels.parse(part["output"].unique())
    }
    return part["output"].map(zone).rename("zone of the segment")
