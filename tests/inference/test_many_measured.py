"""Weighted draws of a model with many measured inputs, whose effects depend on inferred ones."""

import numpy as np
import pytest
import torch

from regional_lv.inference.drawing import Standardised, fit_to_the_end, sample
from regional_lv.inference.potential import Potential
from regional_lv.inference.sets import fit_base
from tests.inference.toys import Emulator, known_noise, toy_inputs

MEASURED, D, NOISE, HALF = 30, 40, 0.5, 4.0


def problem(seed):
    """The posterior, and exactly: log evidence, means (2,) and sds (2,) of both inferred inputs.
    Given these the outputs are linear in the measured ones, which are integrated in closed form,
    and the inferred ones on a grid."""
    rng = np.random.default_rng(seed)
    base = torch.as_tensor(rng.normal(size=(2, D)))
    at_zero, *changes = torch.as_tensor(rng.normal(size=(4, D, MEASURED)) / MEASURED**0.5)

    def parts(t):
        first, second = t[:, 0, None, None], t[:, 1, None, None]
        slopes = at_zero + 0.35 * (first * changes[0] + second * changes[1])
        bent = 0.15 * (t @ base) + 0.05 * (t.square() @ base.flip(0))
        return bent, slopes + 0.05 * first * second * changes[2]

    def outputs(x):
        bent, slopes = parts(x[:, :2])
        return bent + (slopes @ x[:, 2:, None])[..., 0]

    truth = torch.as_tensor(np.append([[0.8, -0.6]], rng.normal(size=(1, MEASURED)), axis=1))
    y = (outputs(truth)[0] + NOISE * torch.as_tensor(rng.normal(size=D))).double()
    inputs = toy_inputs(inferred=2, measured=[1.0] * MEASURED, half=HALF)
    error = 1e-4 * torch.eye(D, dtype=torch.float64)
    potential = Potential(Emulator(outputs, error), inputs, y, known_noise(D, NOISE))
    edge = torch.linspace(-HALF, HALF, 161, dtype=torch.float64)
    grid = torch.cartesian_prod(edge, edge)
    logs = []
    for part in grid.split(2000):
        bent, slopes = parts(part)
        covariance = slopes @ slopes.mT + error + NOISE**2 * torch.eye(D)
        normal = torch.distributions.MultivariateNormal(bent, covariance)
        logs.append(normal.log_prob(y))
    logs = torch.cat(logs)
    weight = torch.softmax(logs, 0)
    mean = weight @ grid
    sd = (weight @ (grid - mean).square()).sqrt()
    evidence = torch.logsumexp(logs, 0) + 2 * (edge[1] - edge[0]).log() - 2 * np.log(2 * HALF)
    return potential, float(evidence), mean, sd


@pytest.mark.parametrize("seed", range(4))
def test_measured_inputs_whose_effects_depend_on_others(seed):
    potential, evidence, mean, sd = problem(seed)
    drawn = sample(potential, fit_to_the_end(potential, fit_base(potential, 0)), 2000, seed)
    assert drawn.reliable and drawn.ess > 0.15 * len(drawn.x)
    assert drawn.log_evidence == pytest.approx(evidence, abs=4 * drawn.evidence_error)
    t = drawn.x[:, :2]
    found = drawn.weight @ t
    spread = (drawn.weight @ (t - found).square()).sqrt()
    assert ((found - mean).abs() < 0.2 * sd).all()
    assert spread.numpy() == pytest.approx(sd.numpy(), rel=0.15)


def test_slopes_at_the_fit_are_not_enough(monkeypatch):
    """What the test above catches: measured inputs proposed as they are likely at the fit."""
    interpolate = Standardised._interpolate_slopes

    def at_the_fit(self, generator):
        interpolate(self, generator)
        self._slopes_by_others[1:] = 0.0

    wanted = []
    for patched in (False, True):
        if patched:
            monkeypatch.setattr(Standardised, "_interpolate_slopes", at_the_fit)
        potential, *_ = problem(0)
        drawn = sample(potential, fit_to_the_end(potential, fit_base(potential, 0)), 2000, 0)
        wanted.append(drawn.ess / len(drawn.x))
    assert wanted[1] < 0.7 * wanted[0]
