"""A heart that is simulated as well: its simulations join the emulator of any heart, whose errors
about this heart become those of a local one."""

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from regional_lv.channels import Channels
from regional_lv.criticism.confirmation import values_of
from regional_lv.criticism.study import Critic, critic_of, write_criticism
from regional_lv.errors import InputError
from regional_lv.hearts.emulator import HeartEmulator
from regional_lv.hearts.file import AnyHeart, read
from regional_lv.hearts.reach import by_table, within_by_table
from regional_lv.seeds import derive
from regional_lv.simulation.design import draw_table, write_rows
from regional_lv.study.jobs import passes_on


def write_inputs_design(
    emulator_file: str | Path,
    physics: Mapping,
    set: str,
    size: int,
    seed: int,
    design: str | Path,
) -> None:
    """`simulation.design.write_inputs_design` for a heart that the emulator of any heart knows.

    Raises InputError for another one (`hearts.reach.OutOfReach`), and for ranges beyond what it
    knows, before anything is simulated.
    """
    with tempfile.TemporaryDirectory() as folder:
        _, cut = within_by_table(physics, read(emulator_file), Path(folder, "segments.csv"))
    if cut:
        raise InputError(
            f"all_inputs.emulator: shipped, and {'; '.join(cut)}; give these ranges "
            "(parameters.bounds, inputs.<name>.range), as regional-lv run does"
        )
    write_rows(physics, set, size, seed, draw_table, design)


def emulator_of(
    any_heart: AnyHeart, physics: Mapping, channels: Channels, own: pd.DataFrame, seed: int
) -> HeartEmulator:
    """The emulator of any heart given simulations of this one (`simulation.batches.tabulate`), of
    surfaces and meshes by their segment table: simulations tell what that leaves open."""
    described = physics["geometry"]["source"] != "segments"
    with tempfile.TemporaryDirectory() as folder:
        table = by_table(physics, Path(folder, "segments.csv"))
        heart = any_heart.of_heart(table, channels, described)
    return heart.condition(*values_of(heart, own), derive(seed, "own simulations"))


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
    emulator = emulator_of(read(emulator_file), physics, channels, pd.read_parquet(own), seed)
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
