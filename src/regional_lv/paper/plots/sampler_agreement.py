"""Posteriors by importance sampling against those of NUTS."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import seaborn
from matplotlib.lines import Line2D

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.posteriors.agreement import MEANS, SDS
from regional_lv.plots import style

COLOURS = {True: style.BLUE, False: style.VERMILLION}


@style.context
def draw(agreement: Sequence[Path], parameters: StiffnessInputs, png: Path, csv: Path) -> None:
    """Draw posteriors by importance sampling against NUTS: means and standard deviations.

    agreement: tables (CSV) with set, case, parameter, mean_fast, mean_nuts, sd_fast, sd_nuts,
    mean_difference_in_sd, sd_ratio, agrees; together they are the figure's table. Between the
    dashed lines the two agree. Without any case sampled by importance, the figure is empty and says
    so.
    """
    tables = [pd.read_csv(path) for path in agreement]
    table = pd.concat([each for each in tables if len(each)] or tables[:1], ignore_index=True)
    fig = style.figure(max(12.0, 1.0 * len(parameters)), 4.0)
    left, right = fig.subplots(1, 2, sharex=True)
    # Cases of a parameter side by side, in their order.
    cases = table.groupby("parameter")["case"]
    within = (cases.cumcount() + 0.5) / cases.transform("size") - 0.5
    place = table["parameter"].map({n: at for at, n in enumerate(parameters.names)}) + 0.6 * within
    for ax, column in ((left, "mean_difference_in_sd"), (right, "sd_ratio")):
        seaborn.scatterplot(
            x=place,
            y=table[column],
            hue=table["agrees"],
            palette=COLOURS if len(table) else None,
            s=9,
            linewidth=0,
            legend=False,
            ax=ax,
        )
        ax.set_xlabel("")
    for limit in (-MEANS, MEANS):
        left.axhline(limit, color=style.GREY, linestyle="--", linewidth=0.8)
    for limit in (1 - SDS, 1 + SDS):
        right.axhline(limit, color=style.GREY, linestyle="--", linewidth=0.8)
    left.set(title="Difference of posterior means", ylabel="in posterior sd")
    right.set(title="Ratio of posterior standard deviations", ylabel="importance sampling / NUTS")
    names = [style.in_lines(style.label(name)) for name in parameters.names]
    left.set_xticks(range(len(names)), names)
    left.set_xlim(-0.6, len(names) - 0.4)
    marks = {"agree": style.BLUE, "differ": style.VERMILLION}
    handles = [Line2D([], [], marker="o", ls="", ms=3, color=c, label=n) for n, c in marks.items()]
    handles.append(Line2D([], [], color=style.GREY, linestyle="--", label="limit of agreement"))
    fig.legend(handles=handles, loc="outside lower center", ncols=3)
    for ax in (left, right):
        ax.tick_params(axis="x", labelsize=7)
    cases = len(table[["set", "case"]].drop_duplicates())
    outcome = (
        f"{100 * table['agrees'].mean():.0f} % agree"
        if cases
        else "none passed the convergence check"
    )
    style.suptitle(fig, f"Importance sampling against NUTS, {cases} posteriors: {outcome}")
    style.save(fig, table, png, csv)
