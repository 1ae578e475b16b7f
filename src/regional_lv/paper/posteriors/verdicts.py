"""What is known of posteriors without their draws: whose they are, which emulator was chosen, which
passed the convergence check, and what a figure says of those that did not."""

import json
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import pandas as pd

from regional_lv.inputs.stiffness import StiffnessInputs

NOISE = ("without measurement noise", "with measurement noise")


def failed_cases(diagnostics: Path) -> set[str]:
    """Cases of a `diagnostics.csv` with a verdict other than "passed"."""
    table = pd.read_csv(diagnostics, dtype={"case": str})
    bad = (table["verdict"] != "passed") | ~table["passed"].astype(bool)
    return set(table.loc[bad, "case"])


def chosen(choice: Path) -> str:
    """Name of the emulator that a study chose, of its `posteriors/final.json`."""
    return json.loads(Path(choice).read_text())["final"]


def by_emulator(paths: Sequence[Path]) -> dict[str, list[Path]]:
    """Files `posteriors/<emulator>/<set>/...` by the emulator in their path, in their order."""
    groups: dict[str, list[Path]] = {}
    for path in paths:
        groups.setdefault(Path(path).parent.parent.name, []).append(path)
    return groups


def by_set(paths: Sequence[Path]) -> dict[str, Path]:
    """Files `posteriors/<emulator>/<set>/...` by their set."""
    return {Path(path).parent.name: path for path in paths}


def by_posteriors(paths: Sequence[Path]) -> dict[str, Path]:
    """Files `posteriors/<emulator>/<set>/...` by "<set>, <emulator>"."""
    return {f"{Path(p).parent.name}, {Path(p).parent.parent.name}": p for p in paths}


def warning_of(failed: int, cases: int, drawn: str = "") -> str:
    """Sentence about posteriors that failed the convergence check; empty if none did.

    drawn: how a figure shows them.
    """
    if not failed:
        return ""
    how = f" ({drawn})" if drawn else ""
    return f"{failed} OF {cases} POSTERIORS FAILED THEIR CONVERGENCE CHECK{how}"


def read_sets(
    recoveries: Sequence[Path], labels: Sequence[str], parameters: StiffnessInputs
) -> pd.DataFrame:
    """The rows of several `recovery.csv` (cases x parameters) with what scenarios add to them.

    recoveries: of the sets `labels`, and then, if there are more, of their noisy twins.

    Added columns: noise (one of NOISE), set (its label), quantity (the factor), of (zone of the
    parameter), stiffened (whether that zone is the stiffened one; of global stiffening every zone
    is), failed.
    """
    factor, zone = ({p.name: getattr(p, what) for p in parameters} for what in ("factor", "zone"))
    tables = []
    of_sets = product(NOISE[: len(recoveries) // len(labels)], labels)
    for path, (noise, label) in zip(recoveries, of_sets, strict=True):
        table = pd.read_csv(path, dtype={"case": str})
        table.insert(0, "set", label)
        table.insert(0, "noise", noise)
        table.insert(0, "file", str(path))
        table["quantity"] = table["parameter"].map(factor)
        table["of"] = table["parameter"].map(zone)
        table["stiffened"] = (table["zone"] == table["of"]) | (table["zone"] == "all")
        table["failed"] = table["verdict"] != "passed"
        tables.append(table)
    return pd.concat(tables, ignore_index=True)


def warning_of_sets(table: pd.DataFrame) -> str:
    """Of a table of `read_sets`: the sentence about posteriors that failed, or nothing."""
    cases = table.groupby(["file", "case"])["failed"].first()
    return warning_of(int(cases.sum()), len(cases))
