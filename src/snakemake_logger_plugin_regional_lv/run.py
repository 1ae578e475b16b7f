"""How far a run has got, and how long it will still take."""

import csv
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from regional_lv.study.progress import duration

TABLE = Path(__file__).with_name("stages.csv")
"""rule -> the stage it belongs to, and the seconds that one of its jobs takes on one core: in the
quick study, or in the paper's where that does not have the rule. What has finished tells how fast
this run is, and how long its own jobs of a rule take."""

UNKNOWN_SECONDS = 10.0
"""Of a job of a rule that is not in the table."""

TRUST = 60.0
"""Seconds of work after which the speed of this run counts as much as that of the table."""


class Run:
    """Jobs done, under way and to come.

    Parameters
    ----------
    stats: jobs per rule, and `total`, as Snakemake counts them.
    cores: jobs at a time.
    now: seconds on any clock; all other times are on the same one.
    """

    def __init__(self, stats: Mapping[str, int], cores: int, now: float):
        with TABLE.open(newline="") as file:
            rows = list(csv.DictReader(file))
        self._stage = {row["rule"]: row["stage"] for row in rows}
        self._seconds = {row["rule"]: float(row["seconds"]) for row in rows}
        self._to_come = Counter({rule: n for rule, n in stats.items() if rule != "total"})
        self.done, self.total = 0, stats["total"]
        self._cores, self._begun = max(1, cores), now
        self._started: dict[int, tuple[str, float]] = {}
        self._expected = self._taken = 0.0
        self._finished: dict[str, list[float]] = {}

    @property
    def complete(self) -> bool:
        return self.done >= self.total

    def start(self, job: int, rule: str, now: float) -> None:
        """A job begins."""
        self._started[job] = (rule, now)
        self._to_come[rule] -= 1

    def finish(self, job: int, now: float) -> None:
        """This job has ended well. Jobs that go to a cluster are not always announced; how long
        those took is not known."""
        if job in self._started:
            rule, begun = self._started.pop(job)
            self._expected += self._typical(rule)
            self._taken += now - begun
            self._finished.setdefault(rule, []).append(now - begun)

    def fail(self, job: int) -> None:
        """This job has ended with an error."""
        self._started.pop(job, None)

    def count(self, done: int, total: int) -> None:
        """Snakemake's own count; the total grows where a step decides what comes after it."""
        self.done, self.total = done, total

    def left(self, now: float) -> float:
        """Seconds that the rest will take."""
        running = [
            max(0.0, self._estimate(rule, now) - (now - begun))
            for rule, begun in self._started.values()
        ]
        waiting = {rule: n for rule, n in self._to_come.items() if n > 0}
        to_come = sum(n * self._estimate(rule, now) for rule, n in waiting.items())
        # Rules of jobs that began unannounced are still among them; their number is known.
        known, number = sum(waiting.values()), self.total - self.done - len(self._started)
        to_come *= min(1.0, max(0, number) / known) if known else 1.0
        return max([(to_come + sum(running)) / self._cores, *running])

    def line(self, now: float) -> str:
        """Such as `[2 min 10 s] 31 of 75 steps done, about 4 min left; now: simulations`."""
        head = f"[{_whole(now - self._begun)}] {self.done} of {self.total} steps done"
        if self.complete:
            return head
        stages = dict.fromkeys(
            self._stage.get(rule, rule.replace("_", " ")) for rule, _ in self._started.values()
        )
        left = f"about {_rounded(self.left(now))} left"
        return "; ".join([f"{head}, {left}", *([f"now: {', '.join(stages)}"] if stages else [])])

    def _estimate(self, rule: str, now: float) -> float:
        """Seconds of a job of this rule: the mean of those of this run and, as one more, the
        table's at the speed of this run. Jobs under way count as soon as they are above it."""
        speed = (self._taken + TRUST) / (self._expected + TRUST)
        own = [*self._finished.get(rule, ()), speed * self._typical(rule)]
        under_way = [now - begun for other, begun in self._started.values() if other == rule]
        own += [seconds for seconds in under_way if seconds > sum(own) / len(own)]
        return sum(own) / len(own)

    def _typical(self, rule: str) -> float:
        return self._seconds.get(rule, UNKNOWN_SECONDS)


def _whole(seconds: float) -> str:
    """`2 min 10 s`; the seconds that have passed in full, as on a clock."""
    return duration(int(seconds), decimals=0)


def _rounded(seconds: float) -> str:
    """`4 min`; as exact as an estimate of the time left is."""
    nearest = 10 * round(seconds / 10) if seconds < 100 else 60 * round(seconds / 60)
    return _whole(nearest).removesuffix(" 00 s")
