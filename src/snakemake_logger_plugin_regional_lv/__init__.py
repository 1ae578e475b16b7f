"""A progress line for the whole run, as a logger plugin of Snakemake (`--logger regional-lv`).

It takes the place of Snakemake's own messages on the terminal: which stages are under way, how many
of all jobs are done, about how much time is left. Errors and warnings are shown as Snakemake shows
them, and its complete log is in `.snakemake/log` as ever. A dry run is left to Snakemake.
"""

import logging
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

from snakemake.logging import DefaultFilter, DefaultFormatter
from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent
from snakemake_interface_logger_plugins.settings import LogHandlerSettingsBase

from regional_lv.study import running, surroundings
from regional_lv.study.progress import STOPPED
from snakemake_logger_plugin_regional_lv.run import Run

# Snakemake imports its plugins before it makes caches of its own.
surroundings.settle()

INTERVAL = 20.0
"""Seconds without a line, after which one is printed although nothing has finished."""

SHORTEST = 2.0
"""Seconds between two lines, at least, unless a run begins or ends."""

UNINTERESTING = (
    "Assuming unrestricted",
    "host:",
    "Building DAG",
    "Using shell",
    "Select jobs",
    "Execute ",
    "Conda environments",
    "Group jobs",
    "Singularity containers",
    "Workflow runtime",
)
"""How messages begin that are for those who debug Snakemake."""

BEFORE_JOB_ERROR = "RuleException:\nCalledProcessError"
"""How a message begins that says no more than that a script failed; the job's error follows."""

LOCKED = "Directory cannot be locked"
"""In what Snakemake says of another run; it asks for `--unlock` even while that one is alive."""

KILLED = "died with <Signals.SIGKILL"
OUT_OF_MEMORY = (
    "Error: a job was killed from outside, most often because the memory of the machine does not "
    "suffice; run fewer jobs at a time (`--cores 1`). What is finished is kept."
)


def reason_of(logs: Sequence[str]) -> str:
    """What a job's log says that the user can correct; "" if it ends with a defect, whose traceback
    counts."""
    for log in logs:
        try:
            lines = Path(log).read_text().splitlines()
        except (OSError, UnicodeDecodeError):
            continue
        for at, line in enumerate(lines):
            if STOPPED in line:
                return "\n".join([line.partition(STOPPED)[2], *lines[at + 1 :]])
    return ""


class LogHandlerSettings(LogHandlerSettingsBase):
    """There are none."""


class LogHandler(LogHandlerBase):
    writes_to_stream = True
    writes_to_file = False
    has_filter = True
    has_formatter = True
    needs_rulegraph = False

    def __post_init__(self):
        own = self.common_settings
        self.addFilter(
            DefaultFilter(own.quiet, own.debug_dag, own.verbose, own.dryrun, own.printshellcmds)
        )
        self.setFormatter(DefaultFormatter(own.quiet, own.show_failed_logs))
        self._run: Run | None = None
        self._cores = 1
        self._printed = 0.0
        self._ended = threading.Event()

    def emit(self, record: logging.LogRecord) -> None:
        said, now = vars(record), time.monotonic()
        event = said.get("event")
        if event == LogEvent.JOB_ERROR and self._run is not None:
            self._run.fail(said["jobid"])
            reason = reason_of(said["log"] or ())
            self._print(
                f"Error: {reason}\n    log: {said['log'][0]}" if reason else self.format(record)
            )
        elif self.common_settings.dryrun or record.levelno >= logging.WARNING:
            text = self.format(record)
            if KILLED in text:
                self._print(OUT_OF_MEMORY)
            elif LOCKED in text:
                self._print(f"Error: {running.others()}")
            elif not text.startswith(BEFORE_JOB_ERROR):
                self._print(text)
        elif event is None:
            text = self.format(record)
            if text and not text.startswith(UNINTERESTING):
                self._print(text)
        elif event == LogEvent.RESOURCES_INFO:
            self._cores = said.get("cores", self._cores)
        elif event == LogEvent.RUN_INFO:
            self._run = Run(said["stats"], self._cores, now)
            threading.Thread(target=self._keep_alive, daemon=True).start()
        elif self._run is None:
            return
        elif event == LogEvent.JOB_INFO:
            self._run.start(said["jobid"], said["rule_name"], now)
            self._line(now)
        elif event == LogEvent.JOB_FINISHED:
            self._run.finish(said["job_id"], now)
        elif event == LogEvent.PROGRESS:
            self._run.count(said["done"], said["total"])
            self._line(now)

    def close(self) -> None:
        self._ended.set()
        super().close()

    def _keep_alive(self) -> None:
        while not self._ended.wait(1.0):
            now = time.monotonic()
            assert self._run is not None  # there is one before the thread starts
            if now - self._printed > INTERVAL and not self._run.complete:
                self._line(now)

    def _line(self, now: float) -> None:
        assert self._run is not None
        if self._run.complete or now - self._printed > SHORTEST:
            self._printed = now
            self._print(self._run.line(now))

    def _print(self, text: str) -> None:
        """To the stream that Snakemake would use: of a dry run it is the standard output."""
        print(text, file=sys.stdout if self.common_settings.stdout else sys.stderr, flush=True)
