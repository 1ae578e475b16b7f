"""What only the comparison with the paper needs; nothing outside this room imports it.

`emulators`: the paper's eight. `estimates`: their point estimates, ranked. `sampler`: posteriors of
the stiffness alone, by any emulator. `posteriors`: those of test cases and scenarios, and whether
they can be trusted. `plots`, `tables`: of these. `measured`,
`published_rows`, `imported_mesh`, `reference_material`: its published data and mesh. `comparison`:
its numbers (`numbers.csv`, read off the paper) beside a study's, and why they differ
(`differences.csv`).
"""

from pathlib import Path

KEYS = ("quantity", "emulator", "set", "parameter", "statistic")
"""Columns of `numbers.csv` that say which number it is."""


def path(name: str) -> Path:
    """Where a table of this room lies."""
    return Path(__file__).parent / name
