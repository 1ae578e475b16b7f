"""CSV tables that people fill in: read line by line, so that a mistake can be named by its line.

Empty lines and lines that begin with # say nothing; lines are numbered as in the file, from 1.
"""

import csv
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from regional_lv.errors import InputError, closest
from regional_lv.input_files import read_text


class CsvLines(NamedTuple):
    """A table: line of the header, names of the columns, and per row its line and its fields by
    column."""

    header: int
    columns: list[str]
    rows: list[tuple[int, dict[str, str]]]


def error_at(path: str | Path, line: int | None, complaint: str) -> InputError:
    """What is wrong in a file, and where."""
    where = f"{path}, line {line}" if line else f"{path}"
    return InputError(f"{where}: {complaint}")


_ASCII = {
    # Hyphens and dashes that word processors and statistics software set for a minus sign.
    **dict.fromkeys(map(ord, "\u2010\u2011\u2012\u2013\u2212\ufe63\uff0d"), "-"),
    **dict.fromkeys(map(ord, "\ufe62\uff0b"), "+"),
    ord("\uff0e"): ".",
}
_FIXED_SPACE = r"[^\S \t]"
"""Spaces that no keyboard types: non-breaking, thin, of a digit's width, and others."""
_SPACES = re.compile(rf"(?<=[-+])\s+|(?<=\d){_FIXED_SPACE}(?=\d{{3}}(?!\d))")
"""What may stand behind a sign, and between groups of three digits."""


def number_in(text: str) -> float:
    """The number that a field holds; NaN if it holds none, or no finite one.

    Minus signs and spaces of typography are read as what they are (`−1 234.5` is -1234.5 with a
    thin or non-breaking space), and so are digits of full width.
    """
    plain = _SPACES.sub("", text.strip().translate(_ASCII))
    try:
        # Python takes 1_0 for ten.
        value = math.nan if "_" in plain else float(plain)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def number_at(path: str | Path, line: int, column: str, text: str) -> float:
    """The number that a field holds. Raises InputError if it holds none."""
    value = number_in(text)
    if math.isnan(value):
        remedy = "write decimals with a point" if "," in text else "give a number"
        if text.lower().lstrip("+-") in ("", "nan", "inf", "infinity"):
            remedy = "give a number, or remove the row if nothing was measured"
        raise error_at(path, line, f"column `{column}`: `{text}` is not a number; {remedy}")
    return value


def _without_empty_ends(parsed: list[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """Rows without the columns at their end that are empty in all of them: spreadsheets save
    these as commas."""
    filled = max(
        (at for _, fields in parsed for at, field in enumerate(fields, start=1) if field),
        default=0,
    )
    return [(number, fields[:filled]) for number, fields in parsed]


def read_lines(
    path: str | Path,
    required: Sequence[str] = (),
    optional: Sequence[str] = (),
    *,
    others: bool = False,
) -> CsvLines:
    """Read a table; names and fields are without spaces around them.

    Raises InputError for a file that cannot be read, a column of `required` that it lacks, one that
    is neither of these nor `optional` (unless `others` may be there), one that occurs twice, and
    rows that do not have a field for each column.
    """
    text = read_text(path)
    numbered = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip(' "').startswith("#")
    ]
    if not numbered:
        raise error_at(path, None, "holds no table; begin it with a line that names the columns")
    parsed = [(number, _fields(path, number, line)) for number, line in numbered]
    (header, columns), *rows = _without_empty_ends(parsed)
    known = [*required, *optional]
    for name in required:
        if name not in columns:
            remedy = _column_remedy(name, [each for each in columns if each not in known], required)
            raise error_at(path, header, f"no column `{name}`; {remedy}")
    for name in columns:
        if name not in known and not others:
            remedy = f"remove it, or rename it to one of {', '.join(known)}"
            raise error_at(path, header, f"column `{name}` is not known; {remedy}")
        if columns.count(name) > 1:
            raise error_at(path, header, f"column `{name}` occurs twice; remove one of the two")
    for number, fields in rows:
        if len(fields) != len(columns) and any(fields):
            raise error_at(
                path,
                number,
                f"{len(fields)} fields for {len(columns)} columns; separate fields by commas and "
                "write decimals with a point",
            )
    return CsvLines(
        header,
        columns,
        [
            (number, dict(zip(columns, fields, strict=True)))
            for number, fields in rows
            if any(fields)
        ],
    )


def _fields(path: str | Path, number: int, line: str) -> list[str]:
    try:
        return [field.strip() for field in next(csv.reader([line]))]
    except csv.Error as error:
        raise error_at(path, number, f"is no line of a CSV ({error}); correct it") from error


def _column_remedy(name: str, unknown: list[str], required: Sequence[str]) -> str:
    if len(unknown) == 1 and (";" in unknown[0] or "\t" in unknown[0]):
        return "save the file with commas between the fields"
    if close := closest(name, unknown):
        return f"rename `{close}`"
    return f"the first line has to name the columns {', '.join(required)}"
