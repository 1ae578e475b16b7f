"""Synthetic subjects: the simulator's ventricle with known truth, measured with stated noise."""

from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.criticism.planted import Ventricles, read_effects, unit_noise
from regional_lv.errors import InputError
from regional_lv.measured import synthetic_subject


def simulate_subject(
    name: str, subject: dict, mesh: Path, physics: dict, predictor: Path, seed: int
) -> tuple[pd.DataFrame, dict]:
    """Simulate a `synthetic_subjects` entry; return the measured table and the truth.

    The truth (theta, effects, noise, seed) is for a file that no inference reads. Raises
    InputError if the ventricle cannot be inflated at its theta with its effects.
    """
    theta = np.array([subject["theta"][parameter] for parameter in aha.PARAMETERS])
    effects = read_effects(subject["effects"])
    try:
        outputs = Ventricles(mesh, physics, predictor).outputs(theta, effects)
    except ArithmeticError as error:
        raise InputError(
            f"synthetic_subjects.{name}: no simulation there ({error}); choose a stiffer "
            "ventricle, or a smaller effect"
        ) from error
    truth = {key: subject[key] for key in ("theta", "effects", "noise")} | {"seed": seed}
    rng = np.random.default_rng(seed)
    unit = unit_noise(effects, len(outputs), rng)
    return synthetic_subject(outputs, subject["noise"], unit), truth
