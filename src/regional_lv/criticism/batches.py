"""Batches of a table."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd


def gather(batches: Sequence[str | Path], table: str | Path) -> None:
    """Put batches of one table together (Parquet)."""
    parts = [pd.read_parquet(batch) for batch in batches]
    pd.concat(parts, ignore_index=True).to_parquet(table, index=False)
