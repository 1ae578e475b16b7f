"""A reference emulator in place of the simulator, where simulations come from tables: a Gaussian
process on all of them.

It learns from the simulations under test as well, which no emulator does: an estimate near the
truth is checked well, one far from any simulation is not.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from regional_lv import emulators
from regional_lv.channels import Channels
from regional_lv.emulators.training import read_simulations
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.estimates.check import first_cases, write_checked
from regional_lv.seeds import derive

CHECKED_BY = "exact GP on training and test simulations"


def fit_reference(
    screened: Sequence[Path],
    parameters: StiffnessInputs,
    channels: Channels,
    seed: int,
    reference: Path,
) -> None:
    """Fit the exact GP on log inputs to screened tables, all together; write it."""
    columns = parameters, channels.names
    parts = [read_simulations(path, *columns)[:2] for path in screened]
    theta, y = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    emulator = emulators.create("exact_gp", {"input_transform": "log", "calibration": "none"})
    emulator.fit(
        theta,
        y,
        parameters=parameters,
        outputs=channels.names,
        seed=derive(seed, "estimates", "reference"),
    )
    emulator.save(reference)


def predict_estimates(reference: Path, estimates: Path, cases: int | None, checked: Path) -> None:
    """The outputs of the reference emulator at the estimates of the first `cases` samples (all if
    None), written as the simulator's are (`check`), `checked_by` it."""
    table = first_cases(pd.read_parquet(estimates), cases)
    emulator = emulators.load(reference)
    with torch.no_grad():
        theta = table[list(emulator.parameters.names)].to_numpy()
        values = emulator.predict_mean(torch.as_tensor(theta))
    write_checked(table, "predicted", CHECKED_BY, values.numpy(), emulator.outputs, checked)
