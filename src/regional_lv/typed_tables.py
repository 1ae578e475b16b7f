"""Tables with declared columns: read, and every mistake named with its file, line and remedy."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from regional_lv.csv_lines import error_at, number_in, read_lines
from regional_lv.errors import InputError


class Column(NamedTuple):
    """A column of finite numbers, of `least` (in `unit`) at least; `whole` ones are below 2^31.

    empty: what an empty cell stands for, and the table may lack the column; None: neither.
    """

    name: str
    unit: str = ""
    least: float = -math.inf
    whole: bool = False
    empty: float | None = None

    def number(self, cell: str) -> float:
        """The number in a cell; NaN if there is none that the column may hold."""
        value = self.empty if self.empty is not None and not cell else number_in(cell)
        whole = abs(value) < 2**31 and value.is_integer()
        return value if value >= self.least and (whole or not self.whole) else math.nan

    @property
    def remedy(self) -> str:
        kind = "whole number" if self.whole else "number"
        least = "" if self.least == -math.inf else f" of {self.least:g} or more {self.unit}"
        return f"give a {kind}{least}" + ("" if self.empty is None else ", or leave it empty")


def read_table(path: str | Path, columns: Sequence[Column | str]) -> pd.DataFrame:
    """A table (CSV) by the lines of its file: numbers in what is declared as `Column`, text in all
    others, of which those named have to be there.

    Raises InputError for a file that cannot be read, a missing column and a cell that is not as
    declared.
    """
    numbers = [column for column in columns if isinstance(column, Column)]
    optional = [column.name for column in numbers if column.empty is not None]
    names = [column.name if isinstance(column, Column) else column for column in columns]
    required = [name for name in names if name not in optional]
    _, found, rows = read_lines(path, required, optional, others=True)
    table = pd.DataFrame([row for _, row in rows], [line for line, _ in rows], found)
    for column in (each for each in numbers if each.name in table):
        values = table[column.name].map(column.number)
        for line, cell in table.loc[values.isna(), column.name].items():
            raise error_at(path, line, f"{column.name} is {cell or 'empty'}; {column.remedy}")
        table[column.name] = values.astype(int if column.whole else float)
    return table


def require_columns(
    path: str | Path, table: pd.DataFrame, names: Sequence[str], remedy: str
) -> None:
    """Raise InputError for columns that a table read from `path` lacks."""
    missing = [name for name in names if name not in table]
    if missing:
        more = f" ({len(missing)} missing)" if len(missing) > 5 else ""
        raise InputError(f"{path}: no column {', '.join(missing[:5])}{more}; {remedy}")
