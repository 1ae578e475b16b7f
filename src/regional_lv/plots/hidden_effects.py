"""What the benchmark of hidden effects found: confusions, power, stiffness and probabilities."""

import itertools
from pathlib import Path

import numpy as np
import pandas as pd
import seaborn
from matplotlib.axes import Axes

from regional_lv.hidden_effects.groups import EFFECTS, FAR, MODELS
from regional_lv.hidden_effects.rates import confusions, rate
from regional_lv.plots import style

EDGES = (0, 1, 2, 3, 4, 6, 9, 15, 1000)
"""Of the bins of expected scores."""

OF_GROUPS = {"singles": style.BLUE, "pairs": style.ORANGE, "triples": style.GREEN}
"""Colours of the power curves."""

OF_MODELS = dict(zip(MODELS.values(), (style.BLUE, style.GREY, style.GREEN), strict=True))
"""Colours of the posteriors."""


@style.context
def draw(
    cases_file: Path, stiffness_file: Path, reliability_file: Path, png: Path, csv: Path
) -> None:
    """Left: causes in the answer (columns) to hearts with an effect (rows); what else is present in
    the same heart is left out, so that all off the diagonal is wrong. Right, with exact 95 %
    intervals: the share of effects that the answer contains, by the score that is expected of them;
    the share of 95 % intervals of stiffness that hold the truth, by group of hearts and posterior;
    and the share of causes that are present, by their probability.

    The table has all of it, by `panel`: effect, answer, count of the left; panel, group or model,
    lower, upper, share, low, high, of the right.
    """
    cases = pd.read_csv(cases_file, keep_default_na=False, na_values=[""])
    cases[["answer", "effect"]] = cases[["answer", "effect"]].fillna("none")
    stiffness, reliability = (pd.read_csv(path) for path in (stiffness_file, reliability_file))
    counts, hearts = _confusions(cases)
    fig = style.figure(14.0, max(0.27 * len(counts) + 2.4, 8.5))
    axes = fig.subplot_mosaic(
        [["left", "power"], ["left", "stiffness"], ["left", "probability"]], width_ratios=[3, 2]
    )
    _draw_confusions(axes["left"], counts, hearts)
    power, coverage = _power(cases), _coverage(stiffness)
    _draw_power(axes["power"], power)
    _draw_coverage(axes["stiffness"], coverage)
    _draw_reliability(axes["probability"], reliability)
    table = counts.stack().rename("count").reset_index()
    table.columns = ["effect", "answer", "count"]
    parts = {
        "confusions": table,
        "power": power,
        "stiffness": coverage,
        "probability": reliability,
    }
    every = [part.assign(panel=name) for name, part in parts.items()]
    style.save(fig, pd.concat(every, ignore_index=True), png, csv)


# ------------------------------------------------------------------------------------ confusions


def _confusions(cases: pd.DataFrame) -> tuple[pd.DataFrame, pd.Series]:
    """Counts by effect and answer, and how many hearts have each effect; causes first, then what no
    catalogue lists."""
    causes = sorted(cases.loc[cases["place"].notna() | cases["value"].notna(), "effect"].unique())
    rows = [*causes, *sorted(set(cases["effect"]) - {*causes, "none"}), "none"]
    counts = confusions(_without_others(cases))
    others = sorted(set(counts.columns) - {*causes, "none"})
    counts = counts.reindex(index=rows, columns=[*causes, *others, "none"], fill_value=0)
    return counts, cases["effect"].value_counts().reindex(rows, fill_value=0)


def _without_others(cases: pd.DataFrame) -> pd.DataFrame:
    """The cases with, in each row's answer, no other effect of the same heart."""
    present = cases.groupby("subject")["effect"].agg(set)
    kept = [
        [name for name in answer.split() if name == effect or name not in present[subject]]
        for subject, effect, answer in cases[["subject", "effect", "answer"]].itertuples(
            index=False
        )
    ]
    return cases.assign(answer=[" ".join(names) or "none" for names in kept])


def _draw_confusions(ax: Axes, counts: pd.DataFrame, hearts: pd.Series) -> None:
    names = [
        [name.replace("_", " ") for name in labels] for labels in (counts.columns, hearts.index)
    ]
    seaborn.heatmap(
        counts.to_numpy() / hearts.to_numpy().clip(min=1)[:, None],
        cmap="Blues",
        vmin=0,
        vmax=1,
        annot=counts.replace(0, ""),
        fmt="",
        annot_kws={"fontsize": 8},
        cbar=False,
        yticklabels=[f"{name} ({n})" for name, n in zip(names[1], hearts, strict=True)],
        ax=ax,
    )
    ax.set_xticks(np.arange(len(names[0])) + 0.5, names[0], rotation=45, ha="right")
    ax.set(xlabel="cause in the answer (number of hearts)", ylabel="what is wrong (hearts)")


# ----------------------------------------------------------------------------------------- rates


def _power(cases: pd.DataFrame) -> pd.DataFrame:
    """Shares of effects found, by `group` and bins of expected scores, `lower` to `upper`."""
    rows = []
    for group, (lower, upper) in itertools.product(OF_GROUPS, itertools.pairwise(EDGES)):
        inside = cases[
            (cases["group"] == group) & cases["expected_z"].between(lower, upper, "left")
        ]
        if len(inside):
            found = rate(inside["contains"].astype(str) == "True")
            rows.append({"group": group, "lower": lower, "upper": upper, **found})
    return pd.DataFrame(rows, columns=["group", "lower", "upper", "of", "share", "low", "high"])


def _coverage(stiffness: pd.DataFrame) -> pd.DataFrame:
    """Shares of intervals that hold the truth, by `group` and `model`."""
    rows = []
    for group, (model, name) in itertools.product(EFFECTS, MODELS.items()):
        covers = stiffness.loc[stiffness["group"] == group, f"{model}_covers"].dropna()
        if len(covers):
            rows.append({"group": group, "model": name, **rate(covers.astype(bool))})
    return pd.DataFrame(rows, columns=["group", "model", "of", "share", "low", "high"])


def _draw_power(ax: Axes, power: pd.DataFrame) -> None:
    bins = [*itertools.pairwise(EDGES)]
    names = {a: f"{a}-{b}" if b < EDGES[-1] else f"> {a}" for a, b in bins}
    shown = power.assign(bin=power["lower"].map(names))
    style.intervals(
        ax,
        shown,
        "bin",
        "share",
        ("low", "high"),
        order=names.values(),
        hue="group",
        palette=OF_GROUPS,
        dodge=0.3,
        linestyle="-",
    )
    ax.axvline(EDGES.index(FAR) - 0.5, color=style.GREY, linestyle="--", linewidth=0.8)
    ax.set(xlabel="expected score of the effect (standard errors)", ylim=(-0.03, 1.03))
    ax.set(ylabel="effects in the answer")
    ax.legend(loc="upper left")


def _draw_coverage(ax: Axes, coverage: pd.DataFrame) -> None:
    style.intervals(
        ax,
        coverage,
        "group",
        "share",
        ("low", "high"),
        hue="model",
        palette=OF_MODELS,
        dodge=0.3,
    )
    ax.axhline(0.95, color=style.GREY, linestyle="--", linewidth=0.8)
    ax.set(xlabel="", ylabel="95 % intervals of stiffness\nthat hold the truth", ylim=(None, 1.02))
    ax.legend(loc="lower left")


def _draw_reliability(ax: Axes, reliability: pd.DataFrame) -> None:
    ax.plot([0, 1], [0, 1], color=style.GREY, linestyle="--", linewidth=0.8)
    at, share = reliability["probability"], reliability["share"]
    ends = [share - reliability["low"], reliability["high"] - share]
    ax.errorbar(at, share, ends, fmt="o", color=style.BLUE, markersize=4, linewidth=1.2)
    ax.set(xlabel="probability of a cause", ylabel="causes that are present")
    ax.set(xlim=(-0.03, 1.03), ylim=(-0.03, 1.03))
