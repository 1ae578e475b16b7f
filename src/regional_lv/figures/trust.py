"""Checks of the chain from outside: posterior draws through the simulator, and a second sampler."""

from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

from regional_lv import aha
from regional_lv.figures import style

QUANTITIES = {"volume": style.PINK, "circumferential": style.SKY, "radial": style.GREEN,
              "longitudinal": style.ORANGE}  # fmt: skip
Z95 = stats.norm.ppf(0.975)
MEAN_LIMIT, SD_LIMIT = 0.1, 0.1
"""What counts as agreement: means within 0.1 posterior sd, sds within 10 %."""


@style.context
def draw_resimulation(resimulated: Path, png: Path, csv: Path) -> None:
    """Draw how far the simulator lies from the emulator at posterior draws, in emulator sd.

    resimulated: CSV with case, draw, output, mean, sd, simulator, z, outside; its rows with their
    quantity are the figure's table. The curve is the standard normal density that an emulator
    with honest errors has.
    """
    table = pd.read_csv(resimulated)
    table["quantity"] = table["output"].map(style.quantity_of)
    fig = style.figure(11.0, 3.6)
    axes = fig.subplots(1, 4, sharey=True)
    limit = max(4.0, float(table["z"].abs().quantile(0.995)))
    bins, at = np.linspace(-limit, limit, 41), np.linspace(-limit, limit, 200)
    for ax, (quantity, colour) in zip(axes, QUANTITIES.items(), strict=True):
        z = table.loc[table["quantity"] == quantity, "z"]
        ax.hist(z.clip(-limit, limit), bins, density=True, color=colour, alpha=0.7)
        ax.plot(at, stats.norm.pdf(at), color=style.BLACK, linewidth=1)
        inside = 100 * (z.abs() <= Z95).mean()
        ax.set(title=quantity, xlabel="(simulator - emulator) / sd")
        ax.text(0.03, 0.97, f"sd {z.std():.2f}\n95 % bars\ncover {inside:.0f} %", va="top",
                transform=ax.transAxes, fontsize=8)  # fmt: skip
    axes[0].set_ylabel("density")
    draws = len(table.drop_duplicates(["case", "draw"]))
    far = int(table.drop_duplicates(["case", "draw"])["outside"].sum())
    title = f"Simulator at {draws} posterior draws of {table['case'].nunique()} cases"
    style.suptitle(fig, title + (f"; {far} draws far from the design" if far else ""))
    style.save(fig, table, png, csv)


@style.context
def draw_agreement(agreement: Path, png: Path, csv: Path) -> None:
    """Draw the fast sampler's posteriors against NUTS: means and standard deviations.

    agreement: CSV with case, parameter, mean_fast, mean_nuts, sd_fast, sd_nuts,
    mean_difference_in_sd, sd_ratio, agrees; the figure's table. Between the dashed lines the two
    agree. Without any case that the fast sampler finished, the figure is empty and says so.
    """
    table = pd.read_csv(agreement)
    fig = style.figure(12.0, 4.0)
    left, right = fig.subplots(1, 2, sharex=True)
    for at, name in enumerate(aha.PARAMETERS):
        part = table[table["parameter"] == name]
        place = at + np.linspace(-0.3, 0.3, len(part))
        colour = np.where(part["agrees"].astype(bool), style.BLUE, style.VERMILLION)
        left.scatter(place, part["mean_difference_in_sd"], c=colour, s=9, linewidths=0)
        right.scatter(place, part["sd_ratio"], c=colour, s=9, linewidths=0)
    for limit in (-MEAN_LIMIT, MEAN_LIMIT):
        left.axhline(limit, color=style.GREY, linestyle="--", linewidth=0.8)
    for limit in (1 - SD_LIMIT, 1 + SD_LIMIT):
        right.axhline(limit, color=style.GREY, linestyle="--", linewidth=0.8)
    left.set(title="Difference of posterior means", ylabel="in posterior sd")
    right.set(title="Ratio of posterior standard deviations", ylabel="fast sampler / NUTS")
    names = [style.parameter_label(name).replace(" ", "\n") for name in aha.PARAMETERS]
    left.set_xticks(range(len(names)), names)
    for ax in (left, right):
        ax.tick_params(axis="x", labelsize=7)
    cases = table["case"].nunique()
    outcome = f"{100 * table['agrees'].mean():.0f} % agree" if cases else "none passed its gate"
    style.suptitle(fig, f"Fast sampler against NUTS, {cases} cases: {outcome}")
    style.save(fig, table, png, csv)
