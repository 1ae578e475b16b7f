"""The hearts of a cohort: their stiffness by zone, what the others say of it, and shared causes."""

from pathlib import Path

import numpy as np
import pandas as pd
import seaborn
from matplotlib.lines import Line2D

from regional_lv.criticism import words
from regional_lv.hearts.prevalence import SOME
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.plots import style

GOLDEN = (5**0.5 - 1) / 2
"""Its multiples, modulo 1, are spread evenly however many there are."""


@style.context
def draw_stiffness(
    hearts: Path, population: Path, parameters: StiffnessInputs, png: Path, csv: Path
) -> None:
    """Draw the stiffness of every heart by zone, a panel for each factor: the mean averaged over
    models; boxes: quartiles of the hearts; black: median of the population and its 95 % interval;
    grey: between which 95 % of hearts lie.

    hearts, population: of `hearts.summary.summarise_cohort`. Hearts whose stiffness cannot be
    trusted are left out. The table: heart, parameter, zone, factor, mean, lower95, upper95, pooled,
    pooled_lower95, pooled_upper95, shrinkage.
    """
    table = _long(pd.read_parquet(hearts), parameters)
    known = pd.read_csv(population)
    zones = [style.zone_label(zone) for zone in parameters.zones]
    colours = dict(zip(zones, parameters.colours.values(), strict=True))
    fig = style.figure(max(6.0, 1.1 * len(zones)), 2.9 * len(parameters.factors))
    axes = fig.subplots(len(parameters.factors), 1, sharex=True, squeeze=False)[:, 0]
    for ax, factor in zip(axes, parameters.factors, strict=True):
        own = table[table["factor"] == factor]
        how = {"x": "zone", "y": "mean", "hue": "zone", "hue_order": zones}
        boxes = style.BOXES | {"boxprops": {"alpha": 0.35}}
        options = {"showfliers": False, "width": 0.55, "legend": False}
        seaborn.boxplot(own, **how, order=zones, palette=colours, ax=ax, **options, **boxes)
        # seaborn's own jitter is another one each time.
        jitter = 0.32 * (own.groupby("zone").cumcount() * GOLDEN % 1 - 0.5)
        points = {"s": 14, "linewidth": 0.4, "edgecolor": style.BLACK, "zorder": 3}
        how["x"] = own["zone"].map(zones.index) + jitter
        seaborn.scatterplot(own, **how, palette=colours, ax=ax, legend=False, **points)
        for x, zone in enumerate(parameters.zones):
            row = known[known["parameter"] == f"{factor}_{zone}"]
            if len(row):
                _mark(ax, x + 0.38, row.iloc[0])
        ax.set(xlabel="", ylabel=style.factor_label(factor), yscale="log")
        style.plain_log(ax.yaxis)
        ax.yaxis.grid(True)
        ax.axhline(1.0, color=style.BLACK, linewidth=0.6, linestyle=":")
    if len(known):
        of_all = Line2D([], [], color=style.BLACK, linewidth=1.6, marker="o", markersize=4)
        of_hearts = Line2D([], [], color=style.GREY, linewidth=0.8)
        handles = {of_all: "population, 95 % interval", of_hearts: "95 % of hearts"}
        fig.legend([*handles], [*handles.values()], loc="outside lower center", ncols=2)
    style.suptitle(fig, f"Stiffness of {table['heart'].nunique()} hearts by zone")
    style.save(fig, table, png, csv)


def _mark(ax, x: float, row: pd.Series) -> None:
    ax.plot([x, x], [row["hearts_lower95"], row["hearts_upper95"]], color=style.GREY, linewidth=0.8)
    ax.plot([x, x], [row["mean_lower95"], row["mean_upper95"]], color=style.BLACK, linewidth=1.6)
    ax.plot([x], [row["mean"]], "o", color=style.BLACK, markersize=4)


@style.context
def draw_pooling(hearts: Path, parameters: StiffnessInputs, png: Path, csv: Path) -> None:
    """Draw each heart's stiffness given all others against that by itself, a panel for each factor;
    the larger a point, the more of its variance is the population's (shrinkage). The table is as of
    `draw_stiffness`."""
    table = _long(pd.read_parquet(hearts), parameters)
    zones = [style.zone_label(zone) for zone in parameters.zones]
    colours = dict(zip(zones, parameters.colours.values(), strict=True))
    count = len(parameters.factors)
    fig = style.figure(4.2 * count, 4.2)
    axes = fig.subplots(1, count, squeeze=False)[0]
    for ax, factor in zip(axes, parameters.factors, strict=True):
        own = table[table["factor"] == factor].dropna(subset=["pooled"])
        if own.empty:
            ax.text(0.5, 0.5, "too few hearts", ha="center", transform=ax.transAxes)
            continue
        seaborn.scatterplot(
            own,
            x="mean",
            y="pooled",
            hue="zone",
            size="shrinkage",
            hue_order=zones,
            palette=colours,
            size_norm=(0, 1),
            sizes=(8, 90),
            edgecolor=style.BLACK,
            linewidth=0.3,
            alpha=0.8,
            ax=ax,
            legend="brief" if ax is axes[-1] else False,
        )
        ax.axline((1, 1), (2, 2), color=style.GREY, linewidth=0.8)
        name = style.factor_label(factor)
        ax.set(xscale="log", yscale="log", xlabel=f"{name}, by itself")
        ax.set_ylabel(f"{name}, given all other hearts")
        for axis in (ax.xaxis, ax.yaxis):
            style.plain_log(axis)
    if axes[-1].get_legend():
        seaborn.move_legend(axes[-1], "upper left", bbox_to_anchor=(1.02, 1))
    style.save(fig, table, png, csv)


@style.context
def draw_causes(causes: Path, png: Path, csv: Path) -> None:
    """Draw the share of hearts that have each cause, median and 95 % interval, with the log Bayes
    factor against no heart having it; the table is `causes` itself (`hearts.summary`)."""
    table = pd.read_csv(causes)
    fig = style.figure(6.5, 1.2 + 0.26 * max(len(table), 1))
    ax = fig.subplots()
    y = np.arange(len(table))
    found = table["probability_any"] >= SOME
    for at, colour in ((found, style.VERMILLION), (~found, style.GREY)):
        rows = table[at]
        ends = np.abs(
            rows[["share_lower95", "share_upper95"]].to_numpy().T - rows["share"].to_numpy()
        )
        ax.errorbar(rows["share"], y[at], xerr=ends, fmt="o", color=colour, markersize=4)
    for height, value in zip(y, table["log_bayes_factor"], strict=True):
        ax.text(1.03, height, f"{value:+.1f}", va="center", transform=ax.get_yaxis_transform())
    ax.set_yticks(y, [words.cause(name) for name in table["cause"]])
    ax.set(xlim=(0, 1), ylim=(len(table) - 0.5, -0.5), xlabel="share of hearts that have it")
    ax.xaxis.grid(True)
    ax.text(1.03, 1.0, "log Bayes\nfactor", va="bottom", transform=ax.transAxes)
    style.save(fig, table, png, csv)


def _long(hearts: pd.DataFrame, parameters: StiffnessInputs) -> pd.DataFrame:
    """A row for each trusted heart and factor."""
    trusted = hearts[hearts["trusted"].eq(True)]
    parts = []
    for p in parameters:
        own = {"mean": p.name, "lower95": f"{p.name}_lower95", "upper95": f"{p.name}_upper95"}
        own |= {c: f"{p.name}_{c}" for c in ("pooled", "pooled_lower95", "pooled_upper95")}
        own |= {"shrinkage": f"{p.name}_shrinkage"}
        part = pd.DataFrame({c: trusted.get(column, np.nan) for c, column in own.items()})
        part.insert(0, "heart", trusted["heart"])
        part.insert(1, "parameter", p.name)
        part.insert(2, "zone", style.zone_label(p.zone))
        part.insert(3, "factor", p.factor)
        parts.append(part)
    return pd.concat(parts, ignore_index=True)
