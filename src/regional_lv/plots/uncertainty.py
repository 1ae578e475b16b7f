"""Are the posteriors of the shortlisted emulators honest, and sharp? (the paper's Figure 4)"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.emulators import label_of
from regional_lv.parameters import Parameterisation
from regional_lv.plots import style
from regional_lv.plots.verdicts import by_emulator, warning_of

COLOURS = (style.BLUE, style.ORANGE, style.VERMILLION, style.GREEN, style.PINK, style.SKY)
NOMINAL = 95


@style.context
def draw(
    coverages: Sequence[Path],
    errors: Sequence[Path],
    parameters: Parameterisation,
    png: Path,
    csv: Path,
) -> None:
    """Draw the coverage of 95 % intervals per parameter, and the mean CRPS of every test case.

    coverages: `coverage.csv`, errors: `map_mse.csv` (case, mse, crps, verdict) of the emulators,
    both `posteriors/<emulator>/test/...` in the same order. Bars on the coverage are binomial 95 %
    intervals; boxes are quartiles with whiskers at 5 and 95 %. The table: panel, emulator, item
    (parameter or case), value, lower, upper.
    """
    emulators = list(by_emulator(coverages))
    wide = 0.55 * (len(parameters) - 10) if len(parameters) > 10 else 0.0
    fig = style.figure(11.5 + wide, 4.6)
    left, right = fig.subplots(1, 2, width_ratios=[2.6 + wide / 3.2, 1])
    rows, failed, cases = [], 0, 0
    for at, (coverage, error, emulator) in enumerate(
        zip(coverages, errors, emulators, strict=True)
    ):
        colour, label = COLOURS[at % len(COLOURS)], label_of(emulator)
        table = pd.read_csv(coverage).set_index("parameter").loc[[*parameters.names, "all"]]
        per_case = pd.read_csv(error, dtype={"case": str})
        failed += int((per_case["verdict"] != "passed").sum())
        cases += len(per_case)
        _coverage(left, table, (at + 0.5) / len(emulators) - 0.5, colour, label)
        _scores(right, per_case["crps"], at, colour)
        columns = [f"coverage{NOMINAL}{end}" for end in ("", "_lower", "_upper")]
        rows += [("coverage", emulator, *row) for row in table[columns].itertuples()]
        scores = per_case.set_index("case")["crps"]
        rows += [("crps", emulator, case, value, None, None) for case, value in scores.items()]
    left.axhline(NOMINAL, color=style.BLACK, linestyle="--", linewidth=1)
    names = [style.in_lines(style.label(n)) for n in (*parameters.names, "all")]
    left.set_xticks(np.arange(len(names)), names)
    left.set(ylabel="95 % intervals that cover (%)", ylim=(None, 101), title="Coverage")
    fig.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=len(emulators))
    right.set_yscale("log")
    right.set_xticks(range(len(emulators)), [*map(label_of, emulators)], rotation=20)
    right.set(ylabel="mean CRPS of a case", title="Probability score")
    style.suptitle(
        fig, "Uncertainty of the shortlisted emulators on the test set", warning_of(failed, cases)
    )
    columns = ["panel", "emulator", "item", "value", "lower", "upper"]
    style.save(fig, pd.DataFrame(rows, columns=columns), png, csv)


def _coverage(ax, table: pd.DataFrame, shift: float, colour: str, label: str) -> None:
    at = np.arange(len(table)) + 0.6 * shift
    ends = 100 * table[[f"coverage{NOMINAL}_lower", f"coverage{NOMINAL}_upper"]].to_numpy()
    ax.vlines(at, *ends.T, colors=colour)
    ax.plot(at, 100 * table[f"coverage{NOMINAL}"], "o", color=colour, markersize=5, label=label)


def _scores(ax, crps: pd.Series, at: int, colour: str) -> None:
    ax.boxplot(
        crps,
        positions=[at],
        widths=0.5,
        whis=(5, 95),
        patch_artist=True,
        manage_ticks=False,
        boxprops={"facecolor": colour, "alpha": 0.6, "linewidth": 0.8},
        medianprops={"color": style.BLACK},
        flierprops={"marker": ".", "markersize": 4, "markeredgecolor": style.GREY},
    )
