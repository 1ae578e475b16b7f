"""The checked config, the paths, the dependencies on the library, for all other files here."""

import os
import re
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
from regional_lv.aha import PARAMETERS  # noqa: E402
from regional_lv.design import scenario_size  # noqa: E402
from regional_lv.errors import InputError  # noqa: E402
from regional_lv.geometry.table import read_segments  # noqa: E402
from regional_lv.measured import states_noise  # noqa: E402
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
# The emulator that scenarios, subjects and most figures use; `choose_final` makes it.
EMULATOR = "final"
# Emulators whose posteriors on the test set are compared.
SHORTLIST = config["emulators"]["shortlist"]["names"] or config["emulators"]["names"]
BOUNDS = [config["design"]["lower"], config["design"]["upper"]]
PHYSICS = {
    section: config[section]
    for section in ("material", "fibres", "loading", "observables", "solver")
}

SUBJECT_SOURCES = {
    name: subject["source"]
    for name, subject in config["subjects"].items()
    if subject["source"] != "published_volunteer" or volunteer_available(config)
}
SUBJECTS = list(SUBJECT_SOURCES)
# Subjects whose measured files give no sd of the strains, so that their noise is inferred.
NOISE_INFERRED = [
    name
    for name, source in SUBJECT_SOURCES.items()
    if source == "published_volunteer"
    or (source == "file" and not states_noise(config["subjects"][name]["measured"]))
]
SYNTHETIC = [name for name, source in SUBJECT_SOURCES.items() if source == "synthetic"]

VOLUNTEERS = [name for name in SUBJECTS if SUBJECT_SOURCES[name] == "published_volunteer"]

SCENARIOS = config["scenarios"]["sets"]
NOISY = {f"{name}-noisy": name for name in SCENARIOS}
# Sets with a known truth whose posteriors are sampled, and how many cases each has.
SETS = {
    "test": config["design"]["test"]
    if config["test_posteriors"]["cases"] == "all"
    else config["test_posteriors"]["cases"],
    **{name: scenario_size(scenario) for name, scenario in SCENARIOS.items()},
    **{noisy: scenario_size(SCENARIOS[name]) for noisy, name in NOISY.items()},
}

HEALTHY = {
    "mean": config["scenarios"]["healthy_mean"],
    "sd": config["scenarios"]["healthy_sd"],
}

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


def posterior_batches(name):
    """Names of the batches of posteriors of a set."""
    return batches(SETS[name], config["nuts"]["cases_per_batch"])


def posterior_files(emulator, name):
    """Files of the posteriors of a set."""
    return expand(
        f"{R}/posteriors/{emulator}/{name}/{{batch}}.nc", batch=posterior_batches(name)
    )


def local_scenarios(noisy):
    """Sets in which one zone is stiffened, with or without measurement noise."""
    names = [name for name, scenario in SCENARIOS.items() if scenario["kind"] == "local"]
    return [name for name, plain in NOISY.items() if plain in names] if noisy else names


def any_of(names):
    """Wildcard constraint: one of the names, and nothing else."""
    return "|".join(map(re.escape, names)) or "(?!)"


def subjects_from(source):
    """Wildcard constraint: the subjects of one source (or what no name can be)."""
    return any_of([name for name, where in SUBJECT_SOURCES.items() if where == source])


def subject_seed(name):
    """Seed of a synthetic subject's noise: its own, or derived from the study's."""
    seed = config["synthetic_subjects"][name]["seed"]
    return derive(config["seed"], "subject", name) if seed is None else seed


def of_shortlist(*files):
    """Files of the test set's posteriors, of every shortlisted emulator."""
    return [
        f"{R}/posteriors/{emulator}/test/{file}" for emulator in SHORTLIST for file in files
    ]
