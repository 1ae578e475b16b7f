"""Files of posteriors: the tables of a set, and whose they are by their paths."""

import json
from collections.abc import Sequence
from pathlib import Path

TABLES = (
    *("diagnostics", "recovery", "coverage", "map_mse"),
    *("correlations", "zone_correlations"),
)
"""Tables of a set of posteriors, in the order in which `summarise_posteriors` writes them."""


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
