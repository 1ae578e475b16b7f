"""Parameter errors of every emulator, test sample by test sample: the paper's box plots."""

import json
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import seaborn
from matplotlib.artist import Artist
from matplotlib.cbook import boxplot_stats
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from regional_lv.emulators import label_of
from regional_lv.plots import style

COLOURS = {"least_squares": style.SKY, "weighted": style.ORANGE}
WORDS = {
    "least_squares": "least squares on the mean (the paper's)",
    "weighted": "weighted by the predictive covariance",
}
MEANS: dict = {
    "marker": "D",
    "markersize": 3.5,
    "markerfacecolor": "white",
    "markeredgecolor": "black",
}


@style.context
def draw(
    names: Sequence[str], estimates: Sequence[Path], shortlist: Path, png: Path, csv: Path
) -> None:
    """Draw box plots of the MSE of each test sample's factors, linear and logarithmic.

    names: emulators; estimates: their tables of point estimates (Parquet), in the same order.
    shortlist: JSON; its emulators are named in vermillion. Boxes are quartiles, whiskers reach to
    the last sample within 1.5 interquartile ranges, diamonds are means. The table is long:
    emulator, estimator, sample, mse, shortlisted.
    """
    chosen = json.loads(Path(shortlist).read_text())["shortlist"]
    table = pd.concat(
        [
            pd.read_parquet(path, columns=["sample", "estimator", "mse"]).assign(emulator=name)
            for name, path in zip(names, estimates, strict=True)
        ],
        ignore_index=True,
    )
    table["shortlisted"] = table["emulator"].isin(chosen)
    # A linear scale that shows the worst sample of the worst emulator shows nothing else.
    groups = [group for _, group in table.groupby(["emulator", "estimator"])["mse"]]
    top = 1.1 * max(stats["whishi"] for stats in boxplot_stats(groups))
    beyond = int((table["mse"] > top).sum())

    fig = style.figure(max(9.0, 1.3 * len(names)), 4.8)
    axes = fig.subplots(1, 2)
    for ax in axes:
        seaborn.boxplot(
            table,
            x="emulator",
            y="mse",
            hue="estimator",
            order=names,
            ax=ax,
            gap=0.1,
            hue_order=COLOURS,
            palette=COLOURS,
            legend=False,
            showmeans=True,
            meanprops=MEANS,
            **style.BOXES,
        )
        labels = [label_of(name) for name in names]
        ax.set_xticks(range(len(names)), labels, rotation=35, ha="right")
        for name, tick in zip(names, ax.get_xticklabels(), strict=True):
            tick.set_color(style.VERMILLION if name in chosen else style.BLACK)
        ax.set(xlabel="", ylabel="MSE of the factors of a sample")
    cut = f", {beyond} points above" if beyond else ""
    axes[0].set(title=f"(A) linear scale{cut}", ylim=(0, top))
    # Scaled after the boxes are drawn: quartiles and means are those of the MSE, not of its log.
    axes[1].set(title="(B) logarithmic scale", yscale="log")
    handles: list[Artist] = [
        Patch(color=COLOURS[key], alpha=0.6, label=WORDS[key]) for key in COLOURS
    ]
    handles.append(Line2D([], [], linestyle="", label="mean", **MEANS))
    handles.append(
        Line2D([], [], linestyle="", label="beyond the whiskers", **style.BOXES["flierprops"])
    )
    fig.legend(handles=handles, loc="outside lower center", ncols=4)
    cases = table["sample"].nunique()
    style.suptitle(fig, f"Point estimates of {cases} test samples (shortlist in vermillion)")
    columns = ["emulator", "estimator", "sample", "mse", "shortlisted"]
    style.save(fig, table[columns], png, csv)
