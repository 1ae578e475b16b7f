"""The simulator at draws of posteriors of the test set, against the emulator that made them."""

from pathlib import Path

import numpy as np
import pandas as pd
import seaborn
from scipy import stats

from regional_lv.channels import Channels
from regional_lv.emulators.gaussian import Z95
from regional_lv.plots import style


@style.context
def draw(resimulated: Path, png: Path, csv: Path) -> None:
    """Draw how far the simulator lies from the emulator at posterior draws, in emulator sd.

    resimulated: CSV with case, draw, output, mean, sd, simulator, z, outside; its rows with their
    quantity are the figure's table. The curve is the standard normal density that an emulator
    with calibrated errors has.
    """
    table = pd.read_csv(resimulated)
    channels = Channels.parse(table["output"].unique())
    table["quantity"] = table["output"].map({c.name: c.quantity for c in channels})
    colours = style.quantity_colours(channels.quantities)
    fig = style.figure(2.6 * len(colours) + 0.6, 3.6)
    axes = fig.subplots(1, len(colours), sharey=True, squeeze=False)[0]
    limit = max(4.0, float(table["z"].abs().quantile(0.995)))
    bins, at = np.linspace(-limit, limit, 41), np.linspace(-limit, limit, 200)
    for ax, (quantity, colour) in zip(axes, colours.items(), strict=True):
        z = table.loc[table["quantity"] == quantity, "z"]
        seaborn.histplot(
            z.clip(-limit, limit),
            bins=bins,
            stat="density",
            color=colour,
            alpha=0.7,
            linewidth=0,
            ax=ax,
        )
        ax.plot(at, stats.norm.pdf(at), color=style.BLACK, linewidth=1)
        inside = 100 * (z.abs() <= Z95).mean()
        ax.set(title=quantity, xlabel="(simulator - emulator) / sd")
        ax.text(
            0.03,
            0.97,
            f"rms {np.sqrt((z**2).mean()):.2f}\n95 % bars\ncover {inside:.0f} %",
            va="top",
            transform=ax.transAxes,
            fontsize=8,
        )
    axes[0].set_ylabel("density")
    draws = len(table.drop_duplicates(["case", "draw"]))
    far = int(table.drop_duplicates(["case", "draw"])["outside"].sum())
    title = f"Simulator at {draws} posterior draws of {table['case'].nunique()} cases"
    style.suptitle(fig, title + (f"; {far} draws far from the design" if far else ""))
    style.save(fig, table, png, csv)
