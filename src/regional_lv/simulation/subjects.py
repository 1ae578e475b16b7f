"""Synthetic subjects: the simulator's ventricle with known truth, measured with stated noise."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from regional_lv.errors import InputError
from regional_lv.inputs.closed_forms import ClosedForm, HeavyTails
from regional_lv.inputs.model import model_of
from regional_lv.inputs.space import Inputs, catalogue
from regional_lv.inputs.stiffness import Stiffness
from regional_lv.measured import synthetic_subject, write_measured
from regional_lv.measured.synthetic import unit_noise
from regional_lv.simulation.ventricles import Ventricles


def simulate_subject(
    name: str,
    subject: Mapping,
    mesh: str | Path,
    physics: Mapping,
    seed: int,
    measured: str | Path,
    truth: str | Path,
) -> None:
    """Simulate `subject`, the entry `name` of `synthetic_subjects`; write the measured table and,
    apart, the truth.

    mesh: the study's, or a finer one. physics: of `inputs.space.model_sections_of`. The truth
    (theta, effects, noise, seed) is for a file that no inference reads. Raises InputError if the
    ventricle cannot be inflated at its theta with its effects.
    """
    values = {**subject["theta"], **subject["effects"]}
    inputs = inputs_of(values, physics)
    ventricles = Ventricles(mesh, inputs)
    try:
        outputs = ventricles.outputs(np.array([values.get(i.name, i.middle) for i in inputs]))
    except ArithmeticError as error:
        raise InputError(
            f"synthetic_subjects.{name}: no simulation there ({error}); choose a stiffer "
            "ventricle, or a smaller effect"
        ) from error
    rng, tails = np.random.default_rng(seed), values.get(HeavyTails.name, 0.0)
    unit = unit_noise(tails, len(outputs), rng)
    table = synthetic_subject(outputs, ventricles.channels, subject["noise"], unit)
    write_measured(table, measured)
    made_from = {key: subject[key] for key in ("theta", "effects", "noise")} | {"seed": seed}
    Path(truth).write_text(json.dumps(made_from, indent=2) + "\n")


def inputs_of(values: Mapping[str, float], physics: Mapping) -> Inputs:
    """The stiffness, the inputs with `values`, and what exact transforms among these scale."""
    model = model_of(physics)
    every = catalogue(model)
    forms = [each for each in every if each.name in values and isinstance(each, ClosedForm)]
    scaled = {e.name for e in every if e.middle != 0 and any(form.power(e) for form in forms)}
    return Inputs(
        model,
        [e for e in every if isinstance(e, Stiffness) or e.name in values or e.name in scaled],
    )
