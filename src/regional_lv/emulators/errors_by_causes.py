"""Errors of an emulator over all inputs, by how many suspected inputs are on."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from regional_lv.emulators import load
from regional_lv.emulators.base import Emulator
from regional_lv.emulators.gaussian import Z95
from regional_lv.emulators.training import predict_each, read_simulations

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
    on = count_on(emulator, theta, nominal)
    groups = {str(n): on == n for n in range(MANY)}
    groups |= {f"{MANY}+": on >= MANY, "all": on >= 0}
    errors_by(emulator, theta, y, groups, "on").to_csv(errors, index=False)


def count_on(emulator: Emulator, theta: np.ndarray, nominal: Mapping[str, float]) -> np.ndarray:
    """How many suspected inputs are on (n,) at theta (n, P); nominal: as of `judge`."""
    places = [emulator.coordinates.names.index(name) for name in nominal]
    return (theta[:, places] != list(nominal.values())).sum(axis=1)


def errors_by(
    emulator: Emulator,
    theta: np.ndarray,
    y: np.ndarray,
    groups: Mapping[str, np.ndarray],
    of: str,
) -> pd.DataFrame:
    """Errors at theta (n, P) with outputs y (n, D), a row for each quantity and group, a mask (n,),
    whose name is in the column `of`. The other columns: as of `judge`."""
    mean, sd = predict_each(emulator, torch.as_tensor(theta), torch.as_tensor(y))
    error = np.abs(mean.numpy() - y)
    held = error <= Z95 * sd.numpy()
    quantities = np.array([channel.quantity for channel in emulator.channels])
    rows = []
    for quantity in dict.fromkeys(quantities):
        for label, mask in groups.items():
            found = error[mask][:, quantities == quantity]
            if found.size:
                rows.append(
                    {
                        "quantity": quantity,
                        of: label,
                        "simulations": int(mask.sum()),
                        "median_error": np.median(found),
                        "rms_error": np.sqrt(np.square(found).mean()),
                        "coverage95": held[mask][:, quantities == quantity].mean(),
                    }
                )
    return pd.DataFrame(rows)
