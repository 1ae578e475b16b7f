"""Synthetic subjects: the simulator's ventricle with known truth, measured with stated noise."""

import logging
from pathlib import Path

import pandas as pd

from regional_lv import aha
from regional_lv.errors import InputError
from regional_lv.measured import synthetic_subject
from regional_lv.simulations import make_runner

log = logging.getLogger(__name__)


def simulate_subject(
    name: str, subject: dict, mesh: Path, physics: dict, predictor: Path, seed: int
) -> tuple[pd.DataFrame, dict]:
    """Simulate a `synthetic_subjects` entry; return the measured table and the truth.

    The truth (theta, effects, noise, seed) is for a file that no inference reads. Raises
    InputError if the ventricle cannot be inflated at its theta.
    """
    theta = pd.Series(subject["theta"])[list(aha.PARAMETERS)]
    result = make_runner(mesh, physics, predictor).run(theta.to_numpy())
    if result.status != "converged":
        raise InputError(
            f"synthetic_subjects.{name}.theta: no simulation there ({result.reason}); "
            "choose a stiffer ventricle"
        )
    truth = {key: subject[key] for key in ("theta", "effects", "noise")} | {"seed": seed}
    return synthetic_subject(result.observables, subject["noise"], seed), truth
