"""How a table is written: CSV and LaTeX."""

import re
from collections.abc import Callable
from functools import wraps
from pathlib import Path

import numpy as np
import pandas as pd

FACTOR = re.compile(r"([A-Z])_([a-z]+)_(?=\w)")
"""How the name of a parameter begins, `C_a_`: mathematics, where names of columns are words."""


def written(make: Callable[..., pd.DataFrame]) -> Callable[..., None]:
    """Decorator of a function that makes a table: it takes `csv` and `tex` also, and writes it."""

    @wraps(make)
    def write(*arguments, csv: Path, tex: Path, **named) -> None:
        save(make(*arguments, **named), csv, tex)

    return write


def save(table: pd.DataFrame, csv: Path, tex: Path) -> None:
    """Write a table as CSV (all digits that matter) and as a LaTeX tabular (four digits)."""
    for path in (csv, tex):
        Path(path).parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(csv, index=False, float_format="%.8g")
    head = " & ".join(_tex(name) for name in table.columns)
    body = [" & ".join(_tex(v) for v in row) for row in table.itertuples(index=False)]
    columns = "".join("r" if pd.api.types.is_numeric_dtype(t) else "l" for t in table.dtypes)
    lines = [rf"\begin{{tabular}}{{@{{}}{columns}@{{}}}}", r"\toprule", rf"{head} \\", r"\midrule"]
    lines += [rf"{row} \\" for row in body] + [r"\bottomrule", r"\end{tabular}"]
    Path(tex).write_text("\n".join(lines) + "\n")


def _escaped(text: str) -> str:
    return text.replace("_", r"\_").replace("%", r"\%")


def _tex(value: object) -> str:
    if isinstance(value, str):
        factor = FACTOR.match(value)
        zone = value[factor.end() :] if factor else value
        return (f"${factor[1]}_{{{factor[2]}}}$ " if factor else "") + _escaped(zone)
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value:.4g}"
    return str(value)
