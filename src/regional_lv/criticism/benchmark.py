"""Hidden effects: many hearts criticised blind. `benchmark_score` compares them with their truth."""

import json
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import emulators
from regional_lv.channels import Channels
from regional_lv.criticism.contract import Findings
from regional_lv.criticism.study import Critic
from regional_lv.measured import synthetic_subject
from regional_lv.progress import Progress
from regional_lv.simulations import make_runner, run_all, tabulate

OF_HEART = (
    *("named", "groups", "acts_like", "explained", "trusted", "best", "base_probability"),
    *("unlisted_probability", "stiffness", "ess"),
)
OF_CAUSE = (
    *("name", "component", "probability", "component_probability", "estimate", "interval95"),
    *("at_bound", "identifiable", "z", "p_value"),
)
OF_CONFIRMATION = (
    *("simulations", "simulations_of_best", "failed", "emulator_error_sd", "largest_error_sd"),
    *("agrees", "probability_not_simulated"),
)
"""What is kept of `contract.Findings`, `Cause` and `Confirmation`."""


class Simulate:
    """Simulates for a confirmation, and counts the CPU seconds that it takes.

    Parameters
    ----------
    mesh, predictor, physics: as for `simulations.make_runner`; read when the first one is asked
        for.
    """

    def __init__(self, mesh: str | Path, predictor: str | Path, physics: Mapping):
        self._given, self._runner = (mesh, physics, predictor), None
        self.seconds = 0.0

    def __call__(self, values: np.ndarray) -> pd.DataFrame:
        """A row for each of the values (n, k) of the simulated inputs, which are its first columns;
        the others as of `simulations.tabulate`."""
        started = time.process_time()
        self._runner = self._runner or make_runner(*self._given)
        design = pd.DataFrame(values, columns=list(self._runner.coordinates.names))
        results = run_all(self._runner, values, "confirmation")
        self.seconds += time.process_time() - started
        return tabulate(design, results, self._runner.channels)


def criticise_batch(
    subjects: str | Path,
    emulator: str | Path,
    mesh: str | Path,
    predictor: str | Path,
    physics: Mapping,
    settings: Mapping,
    seed: int,
    findings: str | Path,
) -> None:
    """Criticise the hearts of a batch (as of `injection.inject_batch`), each without what it is left
    out of its search; write what counts of their findings (JSON, by subject: `reduced`), with the
    CPU `seconds` of each, those of its simulations apart (`simulation_seconds`).

    emulator: over all inputs. mesh, predictor: for confirming simulations. physics: what
    `inputs.space.sections_of` gives. settings: section `criticism`. seed: the study's.
    """
    trained, table = emulators.load(emulator), pd.read_parquet(subjects)
    simulate, found = Simulate(mesh, predictor, physics), {}
    progress = Progress("hidden effects", len(table))
    for _, row in table.iterrows():
        started, before = time.process_time(), simulate.seconds
        critic = Critic(trained, physics, settings, seed, left_out=tuple(row["left_out"].split()))
        content = critic.criticise(measured_of(row), row["subject"], simulate)
        spent, simulated = time.process_time() - started, simulate.seconds - before
        times = {"seconds": spent - simulated, "simulation_seconds": simulated}
        found[row["subject"]] = reduced(content) | times
        progress.step()
    Path(findings).write_text(json.dumps(found) + "\n")


def measured_of(row: pd.Series) -> pd.DataFrame:
    """A measured table, as `read_measured` returns it, of one row of a batch of subjects."""
    channels = Channels.parse(name for name in row.index if f"sd_{name}" in row.index)
    noise = {channel.kind.noise: float(row[f"sd_{channel.name}"]) for channel in channels}
    values = row[list(channels.names)].to_numpy(float)
    return synthetic_subject(values, channels, noise, np.zeros(len(channels)))


def reduced(findings: Findings) -> dict:
    """What the score needs of one heart's findings: plain values."""
    content: Mapping = findings
    remaining = findings["remaining"]
    return {
        **{key: content[key] for key in OF_HEART},
        "detected": findings["misfit"]["detected"],
        "misfit_p_value": findings["misfit"]["p_value"],
        "remaining_p_value": remaining["p_value"] if remaining else None,
        "causes": [_chosen(cause, OF_CAUSE) for cause in findings["hypotheses"]],
        "confirmation": _chosen(findings["confirmation"], OF_CONFIRMATION),
    }


def _chosen(content: Mapping, keys: tuple[str, ...]) -> dict:
    return {key: content[key] for key in keys}
