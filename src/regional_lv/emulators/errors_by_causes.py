"""Errors of an emulator over all inputs, by how many suspected inputs are on."""

import logging
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from regional_lv.emulators import load
from regional_lv.emulators.training import read_simulations
from regional_lv.gaussian import Z95

log = logging.getLogger(__name__)

MANY = 4
"""As many suspected inputs and more are counted together."""


def judge(
    emulator_file: str | Path, test: str | Path, nominal: Mapping[str, float], errors: str | Path
) -> None:
    """Write (CSV) the errors on a screened table of simulations, a row for each quantity and number
    of suspected inputs that are on (`on`: 0, 1, ..., `4+`, `all`).

    nominal: value of the model as it is, by suspected input. Columns: simulations, median_error
    and rms_error (absolute, in the quantity's unit), coverage95 of the stated intervals.
    """
    emulator = load(emulator_file)
    theta, y, _ = read_simulations(test, emulator.parameters, emulator.outputs)
    # One by one: covariances of all take room.
    with torch.no_grad():
        predictions = [emulator.predict(torch.as_tensor(row)) for row in theta]
    error = np.abs(np.stack([each.mean.numpy() for each in predictions]) - y)
    held = error <= Z95 * np.stack([each.sd.numpy() for each in predictions])
    names = list(emulator.coordinates.names)
    on = sum(theta[:, names.index(name)] != value for name, value in nominal.items())
    on = np.zeros(len(theta), dtype=int) if not nominal else on
    groups = {str(n): on == n for n in range(MANY)}
    groups |= {f"{MANY}+": on >= MANY, "all": on >= 0}
    quantities = np.array([channel.quantity for channel in emulator.channels])
    rows = []
    for quantity in dict.fromkeys(quantities):
        for label, mask in groups.items():
            found = error[mask][:, quantities == quantity]
            if found.size:
                rows.append(
                    {
                        "quantity": quantity,
                        "on": label,
                        "simulations": int(mask.sum()),
                        "median_error": np.median(found),
                        "rms_error": np.sqrt(np.square(found).mean()),
                        "coverage95": held[mask][:, quantities == quantity].mean(),
                    }
                )
    pd.DataFrame(rows).to_csv(errors, index=False)
