"""What the prior scale of the noise decides in a subject whose noise is inferred."""

from pathlib import Path

import pandas as pd
import seaborn
from matplotlib.axes import Axes

from regional_lv.criticism.case_posterior import SOURCES
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.posteriors.verdicts import warning_of
from regional_lv.plots import style


@style.context
def draw(
    noise_prior: Path,
    subject: str,
    source: str,
    parameters: StiffnessInputs,
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
    scales = [n for n in table["parameter"].unique() if n.startswith("sigma_")]
    for quantity, colour in style.quantity_colours(
        n.removeprefix("sigma_") for n in scales
    ).items():
        mine = table[table["parameter"] == f"sigma_{quantity}"]
        noise.fill_between(
            mine["prior_scale"],
            mine["lower95"],
            mine["upper95"],
            color=colour,
            alpha=0.25,
            linewidth=0,
        )
        seaborn.lineplot(
            mine,
            x="prior_scale",
            y="median",
            color=colour,
            marker="o",
            ax=noise,
            estimator=None,
            label=quantity,
        )
    noise.set(ylabel="noise scale (standardised units)", title="median and 95 % HPD interval")
    noise.legend(title="quantity")
    once = table.drop_duplicates("prior_scale")
    seaborn.lineplot(
        once,
        x="prior_scale",
        y="outside",
        color=style.VERMILLION,
        marker="o",
        estimator=None,
        ax=outside,
    )
    outside.set(
        ylabel=f"observations outside (of {once['outputs'].max()})",
        title="outside the 95 % predictive interval",
        ylim=(-0.3, once["outside"].max() + 1),
    )
    factors = {p.name: style.factor_label(p.factor) for p in parameters}
    mine = table[table["parameter"].isin(factors)]
    colours = style.factor_colours(parameters.factors)
    seaborn.lineplot(
        mine,
        x="prior_scale",
        y="width95",
        hue=mine["parameter"].map(factors),
        palette={style.factor_label(f): c for f, c in colours.items()},
        marker="o",
        errorbar=None,
        ax=widths,
    )
    widths.set(ylabel="mean width of the 95 % HPD interval", title="stiffness")
    widths.set_ylim(0, 1.05 * widths.get_ylim()[1])
    widths.legend(title="factor")
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
