"""What every rule file uses: the checked config, the paths, the library dependencies."""

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

from regional_lv import config as study_config  # noqa: E402
from regional_lv import dependencies  # noqa: E402
from regional_lv.errors import InputError  # noqa: E402
from regional_lv.geometry.table import read_segments  # noqa: E402

try:
    config.update(study_config.load(config))
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
}

# Modules that decide how things are reported, never what comes out.
WITHOUT_EFFECT = {"progress", "errors"}


@cache
def library(*modules):
    """Files of the library modules that a script imports, followed through their imports.

    Named as input, they make a rule run again when the code that it depends on changes.
    """
    return dependencies.files(SOURCE, modules, without=WITHOUT_EFFECT)


def batches(size, per_batch):
    """Names of the batches that `size` items make: batch-0000, batch-0001, ..."""
    return [f"batch-{i:04d}" for i in range(-(-size // per_batch))]
