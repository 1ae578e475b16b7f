"""Derivatives with respect to the inputs against differences of whole solutions."""

from collections.abc import Iterable

import numpy as np
import pandas as pd

from regional_lv.inputs.space import stencil
from regional_lv.mechanics.continuation import Effort, Solver
from regional_lv.mechanics.problem import Problem
from regional_lv.mechanics.simulator import State

STEPS = 10
"""Times an input's own step: the step between solutions. In a longer one a quadrature point may
pass the switch at which fibres and sheets take up load, where derivatives jump."""

LEAST = 1e-6
"""Over an input's range, of its size: a smaller change of an output is none."""

TIGHT = {"increment_tolerance_mm": 1e-9, "tangent_tolerance_mm": 1e-4}
"""Solver settings at which differences of solutions are worth comparing."""

EVERYTHING_ON = {
    "basal_motion": 3.0,
    "basal_axial": 2.0,
    "basal_twist": 0.5,
    "epicardial_support": 0.03,
    "compressibility": 0.01,
    "septal_load": 2.0,
    "helix_endo": 5.0,
    "anisotropy": 0.8,
    "endocardial_sampling": 0.2,
    "strain_measure": 1.0,
    "line_strain": 0.5,
    "unloaded_directions": 0.3,
    "wall_thickness": 1.05,
    "length": 77.0,
    "segment_rotation": 4.0,
}
"""Values of inputs by name: a state in which springs, loads, compressibility and another
observation act at once."""


def check_derivatives(
    solver: Solver[Problem], start: State, names: Iterable[str] | None = None
) -> pd.DataFrame:
    """One row per input, `input` and its `error`, at a solution near the state `start`.

    The error is the largest over the outputs at end diastole of one kind (strains, and each other
    quantity) relative to the largest derivative among them. names: of the inputs to check, all by
    default. solver: its settings should be `TIGHT`.
    """
    problem = solver.simulator
    inputs, pressure = problem.inputs, problem.full_pressure
    state = solver.newton(start.w, start.theta, pressure, Effort())
    found = problem.linearised(state)
    values, exact = problem.observed(found)
    kinds = np.array(["strain" if c.kind.is_strain else c.quantity for c in problem.channels])
    groups = [kinds == kind for kind in dict.fromkeys(kinds)]
    rows = []
    for k, each in enumerate(inputs):
        if names is not None and each.name not in names:
            continue
        here, low, high = (each.scale(float(v)) for v in (state.theta[k], each.low, each.high))
        step, numeric = STEPS * each.step * (high - low), np.zeros(exact.shape[1])
        for offset, weight in stencil(here, step, low, high):
            x = state.theta.copy()
            x[k] = each.scale.inverse(here + offset)
            guess = state.w + offset * found.fields[k]
            beside = solver.newton(guess, x, pressure, Effort(), tangent=False)
            numeric += weight * problem.observables(beside.w)[0]
        errors = [
            relative_error(
                numeric[group], exact[k][group], LEAST * np.abs(values[group]).max() / (high - low)
            )
            for group in groups
        ]
        rows.append({"input": each.name, "error": max(errors)})
    problem.set(state.theta, pressure)
    return pd.DataFrame(rows)


def relative_error(numeric: np.ndarray, exact: np.ndarray, least: float) -> float:
    """Largest difference of derivatives (n,) relative to the largest among them; 0 where all are
    below `least`."""
    size = max(np.abs(numeric).max(), np.abs(exact).max())
    return float(np.abs(numeric - exact).max() / size) if size > least else 0.0
