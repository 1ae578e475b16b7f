"""The checked config, the paths, the dependencies on the library, for all other files here."""

import os
import sys
from functools import cache
from pathlib import Path

from snakemake.exceptions import WorkflowError

SOURCE = Path(workflow.basedir) / "src"
# For this process and for the scripts that it starts, in whatever environment.
sys.path.insert(0, str(SOURCE))
os.environ["PYTHONPATH"] = str(SOURCE)
# UFL orders the terms of a form by Python's hashes, which differ from process to process unless
# seeded: compiled forms would not be found again, and sums would differ in their last digit.
os.environ["PYTHONHASHSEED"] = "0"


envvars:
    "PYTHONPATH",
    "PYTHONHASHSEED",



from regional_lv import config as study_config  # noqa: E402
from regional_lv import dependencies  # noqa: E402
from regional_lv.criticism.hypotheses import SimulatorHypothesis, asked  # noqa: E402
from regional_lv.errors import InputError  # noqa: E402
from regional_lv.geometry.table import read_segments  # noqa: E402
from regional_lv.resources import (  # noqa: E402
    FILES,
    HEART_MESH,
    HEART_SEGMENTS,
    PUBLISHED_HEART,
    TRAINING_INPUTS,
    TRAINING_OUTPUTS,
    VOLUNTEER,
    fetched_path,
    volunteer_available,
)
from regional_lv.seeds import derive  # noqa: E402

try:
    config.update(study_config.load(config))
    if config["geometry"]["source"] == "segments":
        read_segments(config["geometry"]["segments"])
except InputError as error:
    raise WorkflowError(str(error))

R = f"results/{config['study']}"
LOGS = f"{R}/logs"
EMULATOR = config["emulators"]["final"]
BOUNDS = [config["design"]["lower"], config["design"]["upper"]]
PHYSICS = {
    section: config[section]
    for section in ("material", "fibres", "loading", "observables", "solver")
} | {"geometry": {"wall_thickness_scale": config["geometry"]["wall_thickness_scale"]}}

SUBJECT_SOURCES = {
    name: subject["source"]
    for name, subject in config["subjects"].items()
    if subject["source"] != "published_volunteer" or volunteer_available(config)
}
SUBJECTS = list(SUBJECT_SOURCES)
SYNTHETIC = [name for name, source in SUBJECT_SOURCES.items() if source == "synthetic"]

IMPORTED = config["geometry"]["imported"]


def imported_files():
    """The mesh to import and, if there is one, the file of its segments; by name."""
    if IMPORTED["file"] == PUBLISHED_HEART:
        return {
            "mesh": fetched_path(config["study"], HEART_MESH),
            "segments": fetched_path(config["study"], HEART_SEGMENTS),
        }
    files = {"mesh": IMPORTED["file"], "segments": IMPORTED["segments"]}
    return {name: path for name, path in files.items() if path is not None}


# Modules that decide how things are reported, never what comes out.
WITHOUT_EFFECT = {"progress", "errors"}


@cache
def library(*modules):
    """Files of the library modules that a script imports, followed through their imports.

    Named as input, they make what depends on code run again when that code changes.
    """
    return dependencies.files(SOURCE, modules, without=WITHOUT_EFFECT)


def batches(size, per_batch):
    """Names of the batches that `size` items make: batch-0000, batch-0001, ..."""
    return [f"batch-{i:04d}" for i in range(-(-size // per_batch))]


def extension_batches(hypothesis):
    """Files of the simulations of a hypothesis; closed forms and noise have none."""
    if not isinstance(hypothesis, SimulatorHypothesis):
        return []
    return expand(f"{R}/criticism/simulations/{hypothesis.name}/{{batch}}.parquet", batch=ANCHOR_BATCHES)


def anchors_per_batch(hypothesis):
    """How many anchors of a batch the hypothesis is simulated at, None for all."""
    limits = [n for n in (config["criticism"]["anchors"], hypothesis.anchors) if n is not None]
    return -(-min(limits) // len(ANCHOR_BATCHES)) if limits else None


def subjects_from(source):
    """Wildcard constraint: the subjects of one source (or what no name can be)."""
    names = [name for name, where in SUBJECT_SOURCES.items() if where == source]
    return "|".join(names) or "(?!)"


def subject_seed(name):
    """Seed of a synthetic subject's noise: its own, or derived from the study's."""
    seed = config["synthetic_subjects"][name]["seed"]
    return derive(config["seed"], "subject", name) if seed is None else seed


def criticised(name):
    """Subjects that a criticism is of: those of a joint one, or the one of that name."""
    joint = config["criticism"]["joint"]
    return joint[name]["subjects"] if name in joint else [name]


def known_theta(name):
    """The table of known thetas of a joint criticism, if it has one."""
    path = config["criticism"]["joint"].get(name, {}).get("theta")
    return [] if path is None else [path]
