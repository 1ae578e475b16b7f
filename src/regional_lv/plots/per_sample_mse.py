"""Parameter errors of every emulator, test sample by test sample: the paper's box plots."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from regional_lv.emulators import label_of
from regional_lv.plots import style

COLOURS = {"least_squares": style.SKY, "weighted": style.ORANGE}
WORDS = {
    "least_squares": "least squares on the mean (the paper's)",
    "weighted": "weighted by the predictive covariance",
}
WIDTH = 0.36


@style.context
def draw(
    names: Sequence[str], estimates: Sequence[Path], shortlist: Path, png: Path, csv: Path
) -> None:
    """Draw box plots of the MSE of each test sample's ten parameters, linear and logarithmic.

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
    whiskers = [
        _whisker(group["mse"]) for _, group in table.groupby(["emulator", "estimator"], sort=False)
    ]
    top = 1.1 * max(whiskers)

    fig = style.figure(max(9.0, 1.3 * len(names)), 4.6)
    left, right = fig.subplots(1, 2)
    for ax, title in ((left, "(A) linear scale"), (right, "(B) logarithmic scale")):
        _boxes(ax, table, names, chosen)
        ax.set(title=title, ylabel="MSE of the ten parameters of a sample")
    beyond = int((table["mse"] > top).sum())
    left.set_ylim(0, top)
    if beyond:
        left.annotate(
            f"{beyond} samples above", (0.99, 0.98), xycoords="axes fraction", ha="right", va="top"
        )
    right.set_yscale("log")
    handles = [Patch(color=COLOURS[key], label=WORDS[key]) for key in COLOURS]
    fig.legend(handles=handles, loc="outside lower center", ncols=2)
    cases = table["sample"].nunique()
    style.suptitle(fig, f"Point estimates of {cases} test samples (shortlist in vermillion)")
    columns = ["emulator", "estimator", "sample", "mse", "shortlisted"]
    style.save(fig, table[columns], png, csv)


def _whisker(values: pd.Series) -> float:
    low, high = values.quantile([0.25, 0.75])
    return values[values <= high + 1.5 * (high - low)].max()


def _boxes(ax: Axes, table: pd.DataFrame, names: Sequence[str], chosen: list[str]) -> None:
    for place, (estimator, colour) in enumerate(COLOURS.items()):
        part = table[table["estimator"] == estimator]
        ax.boxplot(
            [part.loc[part["emulator"] == name, "mse"] for name in names],
            positions=np.arange(len(names)) + (place - 0.5) * (WIDTH + 0.04),
            widths=WIDTH,
            patch_artist=True,
            showmeans=True,
            boxprops={"facecolor": colour, "linewidth": 0.7},
            medianprops={"color": style.BLACK},
            whiskerprops={"linewidth": 0.7},
            meanprops={"marker": "D", "markersize": 3.5, "markerfacecolor": style.BLACK}
            | {"markeredgecolor": style.BLACK},
            flierprops={"marker": ".", "markersize": 3, "markeredgecolor": style.GREY},
        )
    labels = [label_of(name) for name in names]
    ax.set_xticks(range(len(names)), labels, rotation=35, ha="right")
    for name, tick in zip(names, ax.get_xticklabels(), strict=True):
        tick.set_color(style.VERMILLION if name in chosen else style.BLACK)
