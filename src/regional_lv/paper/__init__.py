"""What only the paper needs: its numbers, and how a study's compare with them.

`numbers.csv`: facts read off the paper. `differences.csv`: why this project's differ. Nothing
outside this room uses it.
"""

from pathlib import Path

KEYS = ("quantity", "emulator", "set", "parameter", "statistic")
"""Columns of `numbers.csv` that say which number it is."""


def path(name: str) -> Path:
    """Where a table of this room lies."""
    return Path(__file__).parent / name
