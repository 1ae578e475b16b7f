"""One test case under every shortlisted emulator: traces, posteriors (the paper's Figures 5, S1).

The case is the one whose mean CRPS under the first emulator is the median of all test cases.
"""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from regional_lv.emulators import label_of
from regional_lv.inference.posteriors import names_along
from regional_lv.paper.case_posterior import StiffnessPosterior, read
from regional_lv.paper.plots.traces import legend, marginal_panel, mark, trace_panel
from regional_lv.paper.posteriors.files import by_emulator
from regional_lv.plots import style


@style.context
def draw(
    errors: Path,
    posteriors: Sequence[Path],
    diagnostics: Sequence[Path],
    shown: Sequence[str],
    png: Path,
    csv: Path,
) -> None:
    """Draw trace and marginal posterior of the parameters `shown`, two columns for each emulator,
    and how wide the 95 % HPD interval is.

    errors: `map_mse.csv` (case, crps) that chooses the case; posteriors: files of test posteriors
    (`posteriors/<emulator>/test/<batch>.nc`), and diagnostics: the `diagnostics.csv` beside them,
    of the emulators in the same order. The table: emulator, case, parameter, item
    (draw, density, median, lower95, upper95, truth), chain, x, y, verdict.
    """
    case = middle_case(errors)
    checks = by_emulator(diagnostics)
    found = {
        emulator: read(_holding(paths, case), checks[emulator][0], case=case)
        for emulator, paths in by_emulator(posteriors).items()
    }
    fig = style.figure(2.0 * len(found) + 0.8, 1.25 * len(shown) + 1.3)
    axes = fig.subplots(len(shown), 2 * len(found), squeeze=False, width_ratios=[2, 1] * len(found))
    tables = []
    for at, (emulator, posterior) in enumerate(found.items()):
        columns = axes[:, 2 * at : 2 * at + 2]
        tables.append(_columns(columns, posterior, shown, named=at == 0))
        tables[-1].insert(0, "emulator", emulator)
        tables[-1]["verdict"] = posterior.verdict
        columns[0, 0].set_title(label_of(emulator), fontweight="bold")
    fig.align_ylabels(axes[:, 0])
    first = next(iter(found.values()))
    legend(fig, axes[0, 0], len(first.draws[shown[0]]), bool(first.truth))
    failed = [label_of(name) for name, posterior in found.items() if posterior.warning]
    warning = "FAILED ITS CONVERGENCE CHECK: " + ", ".join(failed) if failed else ""
    style.suptitle(fig, f"Test case {case} under each emulator", warning)
    table = pd.concat(tables, ignore_index=True)
    table.insert(1, "case", case)
    style.save(fig, table, png, csv)


def middle_case(errors: Path) -> str:
    """The case with the median CRPS (the lower one of the middle two)."""
    table = pd.read_csv(errors, dtype={"case": str}).sort_values(["crps", "case"])
    return table["case"].iloc[(len(table) - 1) // 2]


def _holding(paths: Sequence[Path], case: str) -> Path:
    """The file with that case; the last one if none has it, for `read` to complain about."""
    for path in paths:
        if case in names_along(path, "case"):
            return path
    return paths[-1]


def _columns(
    axes, posterior: StiffnessPosterior, shown: Sequence[str], named: bool
) -> pd.DataFrame:
    summary = posterior.summary()
    rows: list[tuple] = []
    for (trace, marginal), name in zip(axes, shown, strict=True):
        trace_panel(trace, name, posterior.draws[name], rows)
        marginal_panel(marginal, trace, name, posterior.draws[name], rows)
        row = summary.loc[name]
        mark(trace, marginal, row, posterior.truth.get(name))
        marginal.set_title(f"width {row['upper95'] - row['lower95']:.2g}", fontsize=8)
        if not named:
            trace.set_ylabel("")
        rows += [(name, item, None, row[item], None) for item in summary.columns]
        if name in posterior.truth:
            rows.append((name, "truth", None, posterior.truth[name], None))
    for ax in axes[:-1, 0]:
        ax.tick_params(labelbottom=False)
    axes[-1, 0].set_xlabel("draw")
    return pd.DataFrame(rows, columns=["parameter", "item", "chain", "x", "y"])
