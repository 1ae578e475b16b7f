"""What the benchmark of hidden effects found: confusions, and power against the size of effects."""

import itertools
from pathlib import Path

import numpy as np
import pandas as pd
import seaborn
from matplotlib.ticker import FixedLocator, NullLocator

from regional_lv.criticism.rates import confusions, rate
from regional_lv.plots import style

EDGES = (0, 1, 2, 3, 4, 6, 9, 15, 1000)
"""Of the bins of expected scores."""

FOUND = {True: "in the answer", False: "missed"}


@style.context
def draw(cases_file: Path, png: Path, csv: Path) -> None:
    """Left: causes in the answer (columns) to hearts with an effect (rows); what else was injected
    into the same heart is left out, so that all off the diagonal is wrong. Middle: every effect by
    the score expected of it, in the same rows. Right: the share of effects that
    the answer contains, by bins of that score, with 95 % intervals.

    The table: effect, answer, count of the left; lower, upper, found, of, share, low, high of the
    right. What the middle shows is the table of cases itself.
    """
    cases = pd.read_csv(cases_file)
    cases["answer"] = cases["answer"].fillna("none")
    cases["effect"] = cases["effect"].fillna("none")
    rows = [*sorted(set(cases["effect"]) - {"none"}), "none"]
    counts = confusions(_without_others(cases))
    hearts = cases["effect"].value_counts().reindex(rows)
    columns = [*rows[:-1], *sorted(set(counts.columns) - set(rows)), "none"]
    counts = counts.reindex(index=rows, columns=columns, fill_value=0)

    fig = style.figure(14.0, 0.3 * len(rows) + 2.6)
    left, middle, right = fig.subplots(1, 3, width_ratios=[3, 2, 2])
    share = counts.to_numpy() / hearts.to_numpy()[:, None]
    names = [[name.replace("_", " ") for name in labels] for labels in (columns, rows)]
    names[1] = [f"{name} ({n})" for name, n in zip(names[1], hearts, strict=True)]
    seaborn.heatmap(
        share,
        cmap="Blues",
        vmin=0,
        vmax=1,
        annot=counts.replace(0, ""),
        fmt="",
        annot_kws={"fontsize": 8},
        cbar=False,
        yticklabels=names[1],
        ax=left,
    )
    left.set_xticks(np.arange(len(columns)) + 0.5, names[0], rotation=45, ha="right")
    left.set(xlabel="cause in the answer (number of hearts)", ylabel="injected effect (hearts)")

    visible = cases[(cases["effect"] != "none") & cases["expected_z"].notna()]
    visible = visible[visible["identifiable"].astype(str) == "True"]
    _draw_each(middle, visible, rows)
    power = _power(visible)
    labels = [
        f"{a:g}-{b:g}" if b < EDGES[-1] else f"> {a:g}"
        for a, b in zip(power["lower"], power["upper"], strict=True)
    ]
    at = [f"{x}\n{n}" for x, n in zip(labels, power["of"], strict=True)]
    style.intervals(right, power.assign(bin=at), "bin", "share", ("low", "high"), color=style.BLUE)
    right.set(ylim=(-0.03, 1.03), ylabel="answers that contain the effect")
    right.set_xlabel(
        "score expected of the effect\ngiven the others (se of psi)\nbelow: number of effects"
    )
    right.axhline(0.9, color=style.GREY, linestyle="--", linewidth=0.8)

    table = counts.stack().rename("count").reset_index()
    table.columns = ["effect", "answer", "count"]
    style.save(fig, pd.concat([table, power], ignore_index=True), png, csv)


def _without_others(cases: pd.DataFrame) -> pd.DataFrame:
    """The cases with, in each row's answer, no other effect of the same heart."""
    injected = cases.groupby("subject")["effect"].agg(set)
    kept = [
        [name for name in answer.split() if name == effect or name not in injected[subject]]
        for subject, effect, answer in cases[["subject", "effect", "answer"]].itertuples(
            index=False
        )
    ]
    return cases.assign(answer=[" ".join(names) or "none" for names in kept])


def _draw_each(ax, visible: pd.DataFrame, rows: list[str]) -> None:
    """Every injected effect by the score expected of it, filled where the answer contains it.

    rows: effects from top to bottom, those of the heat map beside it."""
    found = (visible["contains"].astype(str) == "True").map(FOUND)
    shown = visible.assign(expected_z=visible["expected_z"].clip(lower=0.1))
    seaborn.stripplot(
        shown,
        x="expected_z",
        y="effect",
        order=rows,
        hue=found,
        ax=ax,
        hue_order=FOUND.values(),
        palette=[style.BLUE, "white"],
        jitter=False,
        edgecolor=style.BLUE,
        linewidth=1,
        size=5,
    )
    ax.axvline(3, color=style.GREY, linestyle="--", linewidth=0.8)
    ax.set_xscale("log")
    ax.xaxis.set_major_locator(FixedLocator([1, 2, 3, 5, 10, 20, 50]))
    ax.xaxis.set_major_formatter("{x:g}")
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set(xlabel="score expected of the effect\ngiven the others (se of psi)", ylabel="")
    ax.set(ylim=(len(rows) - 0.5, -0.5), yticks=range(len(rows)), yticklabels=[])
    ax.yaxis.grid(True)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, 1.1), ncols=2)


def _power(visible: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for lower, upper in itertools.pairwise(EDGES):
        inside = visible[(visible["expected_z"] >= lower) & (visible["expected_z"] < upper)]
        if len(inside):
            found = rate(inside["contains"].astype(str) == "True")
            rows.append({"lower": lower, "upper": upper, "found": found["hits"], **found})
    return pd.DataFrame(rows, columns=["lower", "upper", "found", "of", "share", "low", "high"])
