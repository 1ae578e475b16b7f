"""How long each file of tests takes, recorded, so that workers get the longest first.

`durations.csv` has a row for each file: seconds of its tests, with what `make test` leaves out and
without. Workers take file after file in that order (`--dist loadfile`), so that none begins a long
one when the others are about to end. A run that ends well updates the rows that have changed.
"""

import csv
from collections import defaultdict
from pathlib import Path

import pytest

RECORD = Path(__file__).with_name("durations.csv")

NEW = 10.0
"""Seconds that a file counts with which has no row yet."""

CHANGED, LEAST = 1.5, 3.0
"""A row is written anew where it is off by this factor and by so many seconds; less is noise."""

DEEP = "test_all"
"""Marker of tests that only `make test-all` runs; its argument says why."""


def read(path: Path = RECORD) -> dict[str, dict[str, float]]:
    """Seconds by file, of the columns `test` and `test_all`."""
    if not path.exists():
        return {}
    with path.open(newline="") as lines:
        return {
            row.pop("file"): {column: float(s) for column, s in row.items()}
            for row in csv.DictReader(lines)
        }


def write(record: dict[str, dict[str, float]], path: Path = RECORD) -> None:
    """The record, the longest file first."""
    rows = sorted(record.items(), key=lambda row: (-row[1]["test_all"], row[0]))
    with path.open("w", newline="") as lines:
        out = csv.writer(lines, lineterminator="\n")
        out.writerow(["file", "test", "test_all"])
        out.writerows([f, *(f"{s[c]:.0f}" for c in ("test", "test_all"))] for f, s in rows)


def updated(record: dict, measured: dict[str, float], column: str) -> dict:
    """The record with what one run of all files measured in one of its columns.

    Machines differ: the run counts in units of the record's own seconds, by the median ratio of the
    files that both have. Files that are gone leave.
    """
    old = {file: row[column] for file, row in record.items()}
    ratios = sorted(old[f] / s for f, s in measured.items() if s > LEAST and old.get(f, 0) > LEAST)
    speed = ratios[len(ratios) // 2] if ratios else 1.0
    new = {}
    for file, seconds in measured.items():
        row = dict(record.get(file, {"test": 0.0, "test_all": 0.0}))
        now, before = seconds * speed, row[column]
        off = max(now, before) > CHANGED * min(now, before) and abs(now - before) > LEAST
        if off or file not in record:
            row[column] = round(now)
        new[file] = row | {"test_all": max(row.values())}
    return new


class Durations:
    """Orders what was collected by the record, and updates the record."""

    def __init__(self, config: pytest.Config):
        self.config = config
        self.seconds: dict[str, float] = defaultdict(float)

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        record, column = read(), self._column()
        items.sort(key=lambda item: -record.get(file_of(item.nodeid), {column: NEW})[column])

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[file_of(report.nodeid)] += report.duration

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, exitstatus: int) -> None:
        option = self.config.option
        last_failed = getattr(option, "lf", False)  # not there without pytest's cache
        some = option.keyword or last_failed or option.file_or_dir or option.deselect
        if some or exitstatus or hasattr(self.config, "workerinput"):
            return  # not all tests, or a worker of xdist, which knows its own alone
        record = read()
        new = updated(record, self.seconds, self._column())
        if new != record:
            write(new)

    def _column(self) -> str:
        return "test" if DEEP in self.config.option.markexpr else "test_all"


def file_of(nodeid: str) -> str:
    return nodeid.partition("::")[0]
