"""What the figures of stiffening scenarios share: one table of all sets, their colours, panels."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from regional_lv.parameters import Parameterisation
from regional_lv.plots import style
from regional_lv.plots.verdicts import warning_of

COLOURS = (style.SKY, style.BLUE, style.BLACK, style.ORANGE, style.GREEN, style.PINK)
MARKERS = ("o", "s", "^", "D", "v", "P")
NOISE = ("without measurement noise", "with measurement noise")


def look(at: int) -> tuple[str, str]:
    """Colour and marker of the set number `at`."""
    return COLOURS[at % len(COLOURS)], MARKERS[at % len(MARKERS)]


def read_sets(
    recoveries: Sequence[Path], labels: Sequence[str], parameters: Parameterisation
) -> pd.DataFrame:
    """The rows of several `recovery.csv` (cases x parameters) with what scenarios add to them.

    Added columns: set (its label), quantity (the factor), of (zone of the parameter), stiffened
    (whether that zone is the stiffened one; of global stiffening every zone is), failed.
    """
    factor, zone = ({p.name: getattr(p, what) for p in parameters} for what in ("factor", "zone"))
    tables = []
    for path, label in zip(recoveries, labels, strict=True):
        table = pd.read_csv(path, dtype={"case": str})
        table.insert(0, "set", label)
        table.insert(0, "file", str(path))
        table["quantity"] = table["parameter"].map(factor)
        table["of"] = table["parameter"].map(zone)
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
