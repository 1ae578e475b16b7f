"""Many hearts criticised blind; `score` compares what is found with the truth."""

import json
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.channels import Channels
from regional_lv.criticism.confirmation import Simulate
from regional_lv.criticism.contract import Findings
from regional_lv.criticism.study import Critic, Settings, criticise
from regional_lv.emulators.joint_gp import JointGP
from regional_lv.measured import synthetic_subject
from regional_lv.study.progress import Progress

OF_HEART = (
    "named",
    "groups",
    "explained",
    "trusted",
    "base_probability",
    "unlisted_probability",
    "stiffness",
)
OF_CAUSE = (
    "name",
    "component",
    "probability",
    "estimate",
    "interval95",
    "at_bound",
    "identifiable",
)
OF_CONFIRMATION = ("simulations", "largest_error_sd", "agrees")
"""What is kept of `contract.Findings`, `Cause` and `Confirmation`."""


def criticise_batch(
    subjects: str | Path,
    emulator_file: str | Path,
    mesh: str | Path,
    predictor: str | Path,
    physics: Mapping,
    settings: Mapping,
    seed: int,
    batch: str,
    findings: str | Path,
) -> None:
    """Criticise the hearts of a batch (as of `injection.inject_batch`), each without the inputs
    that are left out of its search; write what counts of their findings (`reduced`, JSON, by
    subject), with the CPU `seconds` of each, those of its simulations apart (`simulation_seconds`).

    emulator_file: over all inputs. mesh, predictor: for confirming simulations. physics: what
    `inputs.space.sections_of` gives. settings: as of `study.Settings.from_config`. seed: the
    study's.
    """
    emulator, table = JointGP.load(emulator_file), pd.read_parquet(subjects)
    simulate, given = Simulate(mesh, physics, predictor), Settings.from_config(settings)
    progress, found = Progress(f"hidden effects batch {batch}", len(table)), {}
    for _, row in table.iterrows():
        name, started, before = row["subject"], time.process_time(), simulate.seconds
        tables, left_out = {name: measured_of(row)}, row["left_out"].split()
        critic = Critic(name, tables, emulator, physics, given, seed, left_out=left_out)
        content = criticise(critic, simulate).findings
        simulated = simulate.seconds - before
        times = {"seconds": time.process_time() - started - simulated}
        found[name] = reduced(content) | times | {"simulation_seconds": simulated}
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
    remaining = findings["remaining"]
    return {
        **_chosen(findings, OF_HEART),
        "detected": findings["misfit"]["detected"],
        "misfit_p_value": findings["misfit"]["p_value"],
        "remaining_p_value": remaining["p_value"] if remaining else None,
        "causes": [_chosen(cause, OF_CAUSE) for cause in findings["hypotheses"]],
        "confirmation": _chosen(findings["confirmation"], OF_CONFIRMATION),
    }


def _chosen(content: Mapping, keys: tuple[str, ...]) -> dict:
    return {key: content[key] for key in keys}
