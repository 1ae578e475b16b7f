"""The hearts of the benchmark of hidden effects that are made, each with its truth."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from regional_lv import config as study_config
from regional_lv.criticism.settings import settings_of
from regional_lv.criticism.study import Critic, Settings
from regional_lv.emulators.joint_gp import JointGP
from regional_lv.hidden_effects.blind import measured_of
from regional_lv.inputs.space import sections_of


class Heart(NamedTuple):
    """`critic`, as the benchmark has it; the row of its truth, and true values by input."""

    critic: Critic
    truth: pd.Series
    values: dict[str, float]


def results_of(path: str) -> tuple[dict, Path]:
    """Configuration, and its folder of results in this one."""
    config = study_config.load(study_config.read(path), path, [str(Path(path).parent)])
    return config, Path("results") / config["study"]


def hearts_of(path: str) -> Iterator[Heart]:
    """In the order of the batches, of a configuration."""
    config, results = results_of(path)
    physics, settings = sections_of(config), settings_of(config)
    settings |= {"bootstrap": config["criticism"]["benchmark"]["bootstrap"]}
    given = Settings.from_config(settings)
    emulator = JointGP.load(results / "all_inputs" / "finer" / "emulator.pt")
    for file in sorted((results / "truth" / "hidden_effects").glob("*.parquet")):
        truth = pd.read_parquet(file).set_index("subject", drop=False)
        subjects = pd.read_parquet(results / "hidden_effects" / "subjects" / file.name)
        for _, row in subjects.iterrows():
            name, measured = row["subject"], {row["subject"]: measured_of(row)}
            left_out = row["left_out"].split()
            critic = Critic(
                name, measured, emulator, physics, given, config["seed"], left_out=left_out
            )
            yield Heart(critic, truth.loc[name], json.loads(truth.loc[name, "values"]))
