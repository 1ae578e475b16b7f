"""Which posteriors passed the convergence check, and what a figure says of those that did not."""

from pathlib import Path

import pandas as pd


def failed_cases(diagnostics: Path) -> set[str]:
    """Cases of a `diagnostics.csv` with a verdict other than "passed"."""
    table = pd.read_csv(diagnostics, dtype={"case": str})
    bad = (table["verdict"] != "passed") | ~table["passed"].astype(bool)
    return set(table.loc[bad, "case"])


def warning_of(failed: int, cases: int, drawn: str = "") -> str:
    """Sentence about posteriors that failed the convergence check; empty if none did.

    drawn: how a figure shows them.
    """
    if not failed:
        return ""
    how = f" ({drawn})" if drawn else ""
    return f"{failed} OF {cases} POSTERIORS FAILED THEIR CONVERGENCE CHECK{how}"


def warning_of_sets(table: pd.DataFrame) -> str:
    """Of a table of `sets_table.read_sets`: the sentence about posteriors that failed."""
    cases = table.groupby(["file", "case"])["failed"].first()
    return warning_of(int(cases.sum()), len(cases))
