"""A heart that is simulated as well: its simulations join the emulator of any heart, whose errors
about this heart become those of a local one."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from regional_lv.channels import Channels
from regional_lv.criticism.confirmation import condition_on
from regional_lv.criticism.study import Critic, critic_of, write_criticism
from regional_lv.hearts.file import read
from regional_lv.study.jobs import passes_on


def read_critic(
    subject: str,
    emulator_file: str | Path,
    own: str | Path,
    channels: Channels,
    subjects: Sequence[str],
    measured: Sequence[str | Path],
    physics: Mapping,
    settings: Mapping,
    seed: int,
    known_theta: Sequence[str | Path] = (),
) -> Critic:
    """As `criticism.study.read_critic`.

    emulator_file: of any heart. own: screened simulations of this one (Parquet), on the mesh of
    those. channels: what the study observes.
    """
    emulator = condition_on(read(emulator_file).of_heart(physics, channels), pd.read_parquet(own))
    return critic_of(emulator, subject, subjects, measured, physics, settings, seed, known_theta)


@passes_on(read_critic)
def criticise_subject(
    mesh: str | Path,
    predictor: str | Path,
    simulations: str | Path,
    findings: str | Path,
    posterior: str | Path,
    **inputs,
) -> None:
    """`criticism.study.write_criticism` of `read_critic`."""
    made = simulations, findings, posterior
    write_criticism(read_critic(**inputs), mesh, predictor, inputs["physics"], *made)
