"""Logs of scripts, and how far a long loop has got."""

import logging
import sys
import time
from pathlib import Path

from regional_lv.errors import InputError

FORMAT = "%(asctime)s %(levelname)s %(message)s"

STOPPED = "CRITICAL stopped: "
"""In a log: what follows is an error that the user can correct, and how."""


def start_log(path: str | Path) -> None:
    """Send log records, warnings and the error a script ends with to `path`, and to stderr what is
    a warning: there, jobs that run side by side would write into each other's lines, and the error
    is shown by Snakemake (`show-failed-logs`) or its logger.

    A second call in the same process goes on with the new file alone.
    """
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    handlers: list[logging.Handler] = [
        _Log(path, mode="w"),
        logging.StreamHandler(sys.stderr),
    ]
    handlers[1].setLevel(logging.WARNING)
    handlers[1].addFilter(lambda record: record.levelno < logging.CRITICAL)
    for handler in handlers:
        handler.addFilter(_ours_or_important)
    logging.basicConfig(level=logging.INFO, format=FORMAT, handlers=handlers, force=True)
    logging.captureWarnings(True)
    sys.excepthook = _log_error


class _Log(logging.FileHandler):
    """A log whose disk may be full: the error a script ends with goes to stderr then."""

    def handleError(self, record: logging.LogRecord) -> None:
        if record.levelno >= logging.CRITICAL:
            print(self.format(record), file=sys.stderr)


def _ours_or_important(record: logging.LogRecord) -> bool:
    """Other packages' chatter (each compiled form is a dozen lines) would bury the progress."""
    return record.levelno >= logging.WARNING or record.name.startswith("regional_lv")


def _log_error(kind, error, traceback) -> None:
    """Bad input is the user's to correct, and its message says how; of all else, the traceback."""
    log = logging.getLogger(__name__)
    if isinstance(error, InputError):
        log.critical("stopped: %s", error)
    else:
        log.critical("stopped", exc_info=(kind, error, traceback))


class Progress:
    """Logs "name: done d/n, failed f, elapsed, left" as a loop of `total` items goes on.

    At most one line in `interval` seconds, and one at the end; the first one comes early, with the
    first item that is done, so that a long loop shows at once how long it takes.
    """

    def __init__(self, name: str, total: int, interval: float = 10.0):
        self.name, self.total, self.interval = name, total, interval
        self.done = self.failed = 0
        self._start = time.monotonic()
        self._last = -float("inf")
        self._log = logging.getLogger(__name__)

    def step(self, failed: bool = False, count: int = 1) -> None:
        """`count` more items are done; with `failed`, they count as failed as well."""
        self.done += count
        self.failed += count * failed
        now = time.monotonic()
        if self.done >= self.total or now - self._last >= self.interval:
            self._last = now
            self._log.info(self.line(now - self._start))

    def line(self, elapsed: float) -> str:
        """The line after `elapsed` seconds."""
        left = elapsed / self.done * (self.total - self.done) if self.done else float("nan")
        return (
            f"{self.name}: done {self.done}/{self.total}, failed {self.failed}, "
            f"elapsed {duration(elapsed)}, left {duration(left)}"
        )


def duration(seconds: float, decimals: int = 1) -> str:
    """Seconds in words: `7.5 s`, `12 min 05 s`, `3 h 07 min`; `decimals` of less than a minute."""
    if seconds < 60 or seconds != seconds:
        return f"{seconds:.{decimals}f} s"
    if seconds < 3600:
        return f"{int(seconds // 60)} min {int(seconds % 60):02d} s"
    return f"{int(seconds // 3600)} h {int(seconds % 3600 // 60):02d} min"
