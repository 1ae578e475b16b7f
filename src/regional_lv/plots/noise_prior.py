"""What the prior scale of the noise decides in a subject whose noise is inferred."""

from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes

from regional_lv.parameters import Parameterisation
from regional_lv.plots import style
from regional_lv.plots.case_posterior import SOURCES
from regional_lv.plots.verdicts import warning_of

COLOURS = (style.BLUE, style.GREEN, style.ORANGE)


@style.context
def draw(
    noise_prior: Path,
    subject: str,
    source: str,
    parameters: Parameterisation,
    png: Path,
    csv: Path,
) -> None:
    """Draw noise, observations outside the 95 % predictive interval, and widths of every factor.

    noise_prior: `<subject>_noise_prior.csv` (prior_scale, parameter, median, lower95, upper95,
    outside, outputs, verdict); its rows with `width95` are the figure's table.
    """
    table = pd.read_csv(noise_prior)
    table["width95"] = table["upper95"] - table["lower95"]
    fig = style.figure(11.0, 3.9)
    noise, outside, widths = fig.subplots(1, 3)
    names = [n for n in table["parameter"].unique() if n.startswith("sigma_")]
    for name, colour in zip(names, COLOURS, strict=False):
        mine = table[table["parameter"] == name]
        noise.fill_between(mine["prior_scale"], mine["lower95"], mine["upper95"],
                           color=colour, alpha=0.25, linewidth=0)  # fmt: skip
        noise.plot(mine["prior_scale"], mine["median"], "o-", color=colour,
                   label=name.removeprefix("sigma_"))  # fmt: skip
    noise.set(ylabel="noise scale (standardised units)", title="median and 95 % HPD interval")
    noise.legend(title="strain")
    once = table.drop_duplicates("prior_scale")
    outside.plot(once["prior_scale"], once["outside"], "o-", color=style.VERMILLION)
    outside.set(
        ylabel=f"observations outside (of {once['outputs'].max()})",
        title="outside the 95 % predictive interval",
        ylim=(-0.3, once["outside"].max() + 1),
    )
    for factor, colour in style.factor_colours(parameters.factors).items():
        mine = table[table["parameter"].isin([p.name for p in parameters if p.factor == factor])]
        mean = mine.groupby("prior_scale")["width95"].mean()
        widths.plot(mean.index, mean, "o-", color=colour, label=style.factor_label(factor))
    widths.set(ylabel="mean width of the 95 % HPD interval", title="stiffness", ylim=(0, None))
    widths.legend()
    for ax in (noise, outside, widths):
        _log_axis(ax, once["prior_scale"])
    failed = int((once["verdict"] != "passed").sum())
    title = f"Prior scale of the noise: {subject} - {SOURCES[source]}"
    style.suptitle(fig, title, warning_of(failed, len(once)))
    style.save(fig, table, png, csv)


def _log_axis(ax: Axes, scales: pd.Series) -> None:
    ax.set_xscale("log")
    ax.set_xticks(list(scales), [f"{scale:g}" for scale in scales])
    ax.set_xticks([], minor=True)
    ax.set_xlabel("scale of the half-normal prior")
