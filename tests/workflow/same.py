"""Whether two runs of a study made the same tables: `python -m tests.workflow.same A B`."""

import json
import sys
from pathlib import Path

import pandas as pd

TIMES = {"cpu_s", "seconds", "cpu_s_mean", "cpu_s_median", "cpu_s_p95"}
TIMES |= {"training_seconds", "seconds_per_case", "seconds_per_case_least_squares"}
TIMES |= {"seconds_per_case_weighted", "ms_localise", "ms_prediction", "ms_gradient"}
TIMES |= {"ms_gradient_batched", "peak_memory_mb", "file_mb", "simulation_cpu_s", "training_s"}
"""Columns and keys that say what something took: they alone may differ between two runs."""

LEFT_OUT = {"benchmarks", "logs"}


def tables(results: Path) -> set[Path]:
    """Paths of the CSV, Parquet and JSON files below a folder of results."""
    found = {
        p.relative_to(results) for e in ("csv", "parquet", "json") for p in results.rglob(f"*.{e}")
    }
    return {p for p in found if p.parts[0] not in LEFT_OUT and p.name != "manifest.json"}


def read_table(path: Path) -> pd.DataFrame:
    """A table without what may differ."""
    table = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path)
    if path.stem == "paper_comparison":
        table = table[table["quantity"] != "simulation_minutes"]
    return table.drop(columns=[c for c in table.columns if c in TIMES])


def assert_same(one: Path, other: Path) -> None:
    """Raise AssertionError if two files of `tables` differ in more than times."""
    if one.suffix == ".json":
        contents = (json.loads(path.read_text(), object_hook=_timeless) for path in (one, other))
        assert next(contents) == next(contents), f"{one} and {other} differ"
    else:
        pd.testing.assert_frame_equal(
            read_table(one), read_table(other), check_exact=True, obj=str(one)
        )


def _timeless(pairs: dict) -> dict:
    return {key: value for key, value in pairs.items() if key not in TIMES}


def main(one: Path, other: Path) -> None:
    """Compare all tables, and the checksums that the manifests say do not hold times."""
    names = tables(one)
    assert names, f"{one} has no tables"
    assert names == tables(other), f"not in both folders: {sorted(names ^ tables(other))}"
    for name in sorted(names):
        assert_same(one / name, other / name)
    print(f"{len(names)} tables of {one} and {other} are the same.")
    manifests = [folder / "manifest.json" for folder in (one, other)]
    if all(map(Path.is_file, manifests)):
        files, again = (json.loads(path.read_text())["files"] for path in manifests)
        different = [name for name in files | again if files.get(name) != again.get(name)]
        assert not different, f"other checksums: {different}"
        print(f"{len(files)} files without times are the same bit by bit.")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
