"""What the figures of stiffening scenarios share: one table of all sets, their colours, panels."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from regional_lv.figures import style
from regional_lv.figures.verdicts import warning_of

COLOURS = (style.SKY, style.BLUE, style.BLACK, style.ORANGE, style.GREEN, style.PINK)
MARKERS = ("o", "s", "^", "D", "v", "P")
NOISE = ("without measurement noise", "with measurement noise")


def read_sets(recoveries: Sequence[Path], labels: Sequence[str]) -> pd.DataFrame:
    """The rows of several `recovery.csv` (cases x parameters) with what scenarios add to them.

    Added columns: set (its label), quantity (C_a or C_b), of (zone of the parameter), stiffened
    (whether that zone is the stiffened one; of global stiffening every zone is), failed.
    """
    tables = []
    for path, label in zip(recoveries, labels, strict=True):
        table = pd.read_csv(path, dtype={"case": str})
        table.insert(0, "set", label)
        table.insert(0, "file", str(path))
        table["quantity"] = table["parameter"].str[:3]
        table["of"] = table["parameter"].str[4:]
        table["stiffened"] = (table["zone"] == table["of"]) | (table["zone"] == "all")
        table["failed"] = table["verdict"] != "passed"
        tables.append(table)
    return pd.concat(tables, ignore_index=True)


def warning(table: pd.DataFrame) -> str:
    """Of a table of `read_sets`: the sentence about posteriors that failed, or nothing."""
    cases = table.groupby(["file", "case"])["failed"].first()
    return warning_of(int(cases.sum()), len(cases))


def panels(fig: Figure, rows: int, columns: int, **options) -> np.ndarray:
    """Axes (rows, columns), always two-dimensional."""
    return fig.subplots(rows, columns, squeeze=False, **options)
