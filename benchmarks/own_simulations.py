"""Simulations of a heart itself, with the emulator of any heart below them and without it.

    python benchmarks/other_hearts.py cohort FOLDER
    python benchmarks/own_simulations.py FOLDER NAME ...

NAME: of hearts in FOLDER/hearts. Each is simulated on the emulator's mesh (`OWN` simulations and
`TEST` others), by the workflow, in FOLDER/own; what is there is not made again. The shipped
emulator is conditioned on the first few, another is trained on them alone.

`errors.csv`: heart, emulator, simulations, quantity; median and rms of the absolute errors of the
others (of volumes as shares of them), and what the stated 95 % intervals cover.
`posteriors.csv`: of the heart's measurement, which was made on a finer mesh with noise: how many of
the ten factors its 95 % intervals hold, the median ratio of their ends, and the CPU seconds of the
posterior averaged over models, without what is simulated to confirm it.
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import torch
import yaml
from other_hearts import summary

from regional_lv import config as study_config
from regional_lv.channels import Channels
from regional_lv.criticism.settings import settings_of
from regional_lv.criticism.study import critic_of
from regional_lv.emulators import OF_INPUTS, create
from regional_lv.emulators.joint_gp import JointGP
from regional_lv.hearts import ONE_HEART
from regional_lv.hearts.fast import import_subject
from regional_lv.hearts.file import shipped
from regional_lv.hearts.full import emulator_of
from regional_lv.hearts.reach import within
from regional_lv.inputs.space import Inputs, sections_of

PROJECT = Path(__file__).parents[1]
CORES = os.environ.get("CORES", "2")
OWN, TEST = 300, 40
SIMULATED = {"simulations": OWN, "test": TEST, "anchors": 32, "finer": 12, "emulator": "own"}
JOINED, ALONE = (0, 10, 20, 30, 60), (30, 60, 150, 300)
WITH_POSTERIOR = (0, 30)
"""Numbers of simulations beside the shipped emulator; without it there have to be all."""


def simulate(folder: Path, name: str) -> tuple[dict, dict[str, Path]]:
    """The configuration of a heart, and its files: train, test, and the emulator `finer` that is
    trained on all simulations and corrected for the mesh."""
    path, place = folder / "hearts" / name / "config.yaml", folder / "own"
    place.mkdir(exist_ok=True)
    given = study_config.merged(study_config.read(ONE_HEART), study_config.read(path))
    config, any_heart = study_config.load(given, path, [str(path.parent)]), shipped()
    config, _ = within(config, any_heart.emulator, any_heart.known)
    extra = place / f"{name}.yaml"
    cut = {"parameters": config["parameters"], "inputs": config["inputs"]}
    extra.write_text(yaml.safe_dump(cut | {"all_inputs": SIMULATED}))
    made = Path("results", config["study"], "all_inputs")
    ends = {"train": "train.parquet", "test": "test.parquet", "finer": "finer/emulator.pt"}
    targets = [made / end for end in ends.values()]
    files = {key: place / target for key, target in zip(ends, targets, strict=True)}
    if all(file.exists() for file in files.values()):
        return config, files
    snakefile, configured = PROJECT / "Snakefile", [ONE_HEART, path.resolve(), extra.resolve()]
    run = ["snakemake", "--cores", CORES, "--snakefile", snakefile, "--directory", place]
    subprocess.run([*run, "--configfile", *configured, "--", *targets], check=True)
    return config, files


def emulators(config: dict, files: dict) -> Iterator[tuple]:
    """Kind, number of simulations, and emulator."""
    physics, channels = sections_of(config), Channels.from_config(config)
    inputs = Inputs.from_config(physics).simulated
    train, alone = pd.read_parquet(files["train"]), shipped().of_heart(physics, channels)
    for count in JOINED:
        own = shipped(), physics, channels, train[:count], config["seed"]
        yield "shipped", count, emulator_of(*own) if count else alone
    for count in ALONE:
        own = train[:count]
        if count >= len(train):
            yield "own", len(own), JointGP.load(files["finer"])
            continue
        slopes = np.stack([np.asarray(row, dtype=float) for row in own["sensitivity"]])
        theta, y = (own[list(names)].to_numpy(float) for names in (inputs.names, channels.names))
        emulator = create(OF_INPUTS, config["emulators"][OF_INPUTS])
        emulator.fit(
            theta,
            y,
            slopes.reshape(*y.shape, -1),
            parameters=inputs.coordinates,
            outputs=channels.names,
            seed=config["seed"],
        )
        yield "own", count, emulator


def errors_of(emulator, test: pd.DataFrame, channels: Channels) -> pd.DataFrame:
    """A row for each output of each simulation."""
    x = torch.as_tensor(test[list(emulator.coordinates.names)].to_numpy(float))
    found = emulator.of_study_mesh.predict(x)
    parts = [
        pd.DataFrame(
            {
                "quantity": channel.quantity,
                "simulated": test[channel.name],
                "mean": found.mean[:, d].numpy(),
                "sd": found.sd[:, d].numpy(),
            }
        )
        for d, channel in enumerate(channels)
    ]
    return pd.concat(parts)


def posterior_of(emulator, config: dict, measured: Path, truth: pd.Series) -> dict:
    """What the averaged posterior makes of what was measured."""
    (subject,) = config["subjects"]
    import_subject(config, subject, measured)
    started = time.process_time()
    critic = critic_of(
        emulator,
        subject,
        [subject],
        [measured],
        sections_of(config),
        settings_of(config),
        config["seed"],
    )
    found = critic.conclude([], has_simulator=False).findings
    ends = np.array([factor["averaged"]["interval95"] for factor in found["stiffness"]])
    true = truth[[factor["name"] for factor in found["stiffness"]]].to_numpy(float)
    return {
        "held": int(((ends[:, 0] <= true) & (true <= ends[:, 1])).sum()),
        "of": len(true),
        "ratio_of_ends": float(np.median(ends[:, 1] / ends[:, 0])),
        "effective_draws": found["ess"],
        "cpu_s": time.process_time() - started,
    }


def main(folder: str, *names: str) -> None:
    place = Path(folder)
    truth = pd.read_csv(place / "truth.csv", dtype={"heart": str}).set_index("heart")
    errors, posteriors = [], []
    for name in names:
        config, files = simulate(place, name)
        test, channels = pd.read_parquet(files["test"]), Channels.from_config(config)
        for kind, count, emulator in emulators(config, files):
            case = {"heart": name, "emulator": kind, "simulations": count}
            errors.append(
                summary(errors_of(emulator, test, channels).assign(heart=name, group=name))
                .query("group == 'all'")
                .drop(columns=["group", "hearts", "lowest_coverage_of_a_heart"])
                .assign(**case)
            )
            print(errors[-1].to_string(index=False, header=False), flush=True)
            if count in WITH_POSTERIOR if kind == "shipped" else count > ALONE[-2]:
                measured = place / "own" / f"{name}.parquet"
                found = posterior_of(emulator, config, measured, truth.loc[name])
                posteriors.append(case | found)
                print(posteriors[-1], flush=True)
        tables = {"errors": pd.concat(errors), "posteriors": pd.DataFrame(posteriors)}
        for file, table in tables.items():
            table.to_csv(place / "own" / f"{file}.csv", index=False, float_format="%.3g")
    every = pd.concat(errors)
    print(every.groupby(["quantity", "emulator", "simulations"])["median_error"].median())


if __name__ == "__main__":
    main(*sys.argv[1:])
