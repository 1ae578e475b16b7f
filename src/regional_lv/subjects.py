"""Synthetic subjects: the simulator's ventricle with known truth, measured with stated noise."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from regional_lv.criticism.injection import Ventricles, read_effects, unit_noise
from regional_lv.errors import InputError
from regional_lv.measured import synthetic_subject, write_measured, write_truth
from regional_lv.parameters import Parameterisation


def simulate_subject(
    name: str,
    subject: Mapping,
    mesh: str | Path,
    physics: Mapping,
    seed: int,
    measured: str | Path,
    truth: str | Path,
    predictor: str | Path | None = None,
) -> None:
    """Simulate `subject`, the entry `name` of `synthetic_subjects`; write the measured table and,
    apart, the truth.

    mesh: the study's, with its predictor, or a finer one without. The truth (theta, effects, noise,
    seed) is for a file that no inference reads. Raises InputError if the ventricle cannot be
    inflated at its theta with its effects.
    """
    parameters = Parameterisation.from_spec(physics["parameters"])
    theta = np.array([subject["theta"][parameter] for parameter in parameters.names])
    effects = read_effects(subject["effects"])
    ventricles = Ventricles(mesh, physics, predictor)
    try:
        outputs = ventricles.outputs(theta, effects)
    except ArithmeticError as error:
        raise InputError(
            f"synthetic_subjects.{name}: no simulation there ({error}); choose a stiffer "
            "ventricle, or a smaller effect"
        ) from error
    unit = unit_noise(effects, len(outputs), np.random.default_rng(seed))
    table = synthetic_subject(outputs, ventricles.channels, subject["noise"], unit)
    write_measured(table, measured)
    write_truth(truth, **{key: subject[key] for key in ("theta", "effects", "noise")}, seed=seed)
