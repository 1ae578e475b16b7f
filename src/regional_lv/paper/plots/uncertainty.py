"""Are the posteriors of the shortlisted emulators calibrated, and sharp? (the paper's Figure 4)"""

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

import pandas as pd
import seaborn

from regional_lv.emulators import label_of
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.posteriors.files import by_emulator
from regional_lv.paper.posteriors.verdicts import warning_of
from regional_lv.plots import style

COLOURS = (style.BLUE, style.ORANGE, style.VERMILLION, style.GREEN, style.PINK, style.SKY)
NOMINAL = 95
COVERAGE = [f"coverage{NOMINAL}{end}" for end in ("", "_lower", "_upper")]


@style.context
def draw(
    coverages: Sequence[Path],
    errors: Sequence[Path],
    parameters: StiffnessInputs,
    png: Path,
    csv: Path,
) -> None:
    """Draw the coverage of 95 % intervals per parameter, and the mean CRPS of every test case.

    coverages: `coverage.csv`, errors: `map_mse.csv` (case, mse, crps, verdict) of the emulators,
    both `posteriors/<emulator>/test/...` in the same order. Bars on the coverage are 95 % intervals
    (all: cases as clusters); boxes are quartiles with whiskers at 5 and 95 %. The table: panel,
    emulator, item (parameter or case), value, lower, upper.
    """
    emulators = list(by_emulator(coverages))
    wide = 0.55 * (len(parameters) - 10) if len(parameters) > 10 else 0.0
    fig = style.figure(11.5 + wide, 4.6)
    left, right = fig.subplots(1, 2, width_ratios=[2.6 + wide / 3.2, 1])
    tables, scores = [], []
    for coverage, error, emulator in zip(coverages, errors, emulators, strict=True):
        table = pd.read_csv(coverage).set_index("parameter").loc[[*parameters.names, "all"]]
        tables.append(table.reset_index().assign(emulator=emulator))
        scores.append(pd.read_csv(error, dtype={"case": str}).assign(emulator=emulator))
    covered, scored = pd.concat(tables), pd.concat(scores)
    renamed = dict(zip(COVERAGE, ("value", "lower", "upper"), strict=True))
    covered = covered.rename(columns=renamed | {"parameter": "item"}).assign(panel="coverage")
    scored = scored.rename(columns={"crps": "value", "case": "item"}).assign(panel="crps")
    columns = ["panel", "emulator", "item", "value", "lower", "upper"]
    table = pd.concat([covered, scored], ignore_index=True)[columns]
    failed = int((scored["verdict"] != "passed").sum())

    palette = dict(zip(emulators, cycle(COLOURS), strict=False))
    percent = covered.assign(**{c: 100 * covered[c] for c in ("value", "lower", "upper")})
    style.intervals(
        left,
        percent,
        "item",
        "value",
        ("lower", "upper"),
        hue="emulator",
        palette=palette,
        dodge=0.5,
    )
    left.axhline(NOMINAL, color=style.BLACK, linestyle="--", linewidth=1)
    names = [style.in_lines(style.label(n)) for n in (*parameters.names, "all")]
    left.set_xticks(range(len(names)), names)
    left.set(xlabel="", ylabel="95 % intervals that cover (%)", title="Coverage")
    left.set_ylim(None, 101)
    handles = left.get_legend_handles_labels()[0]
    left.get_legend().remove()
    fig.legend(handles, map(label_of, emulators), loc="outside lower center", ncols=len(emulators))
    seaborn.boxplot(
        scored,
        x="emulator",
        y="value",
        hue="emulator",
        ax=right,
        width=0.5,
        whis=(5, 95),
        palette=palette,
        legend=False,
        **style.BOXES,
    )
    right.set_yscale("log")
    right.set_xticks(range(len(emulators)), [*map(label_of, emulators)], rotation=20)
    right.set(xlabel="", ylabel="mean CRPS of a case", title="Probability score")
    style.suptitle(
        fig,
        "Uncertainty of the shortlisted emulators on the test set",
        warning_of(failed, len(scored)),
    )
    style.save(fig, table, png, csv)
