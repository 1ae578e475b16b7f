"""The density that posteriors are explored with, against the exact one."""

import numpy as np
import pytest
import torch

from regional_lv.emulators.base import SeparablePrediction
from regional_lv.inference.noise import Noise
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.sampler.approximation import count_places
from regional_lv.paper.sampler.likelihood import Likelihood
from regional_lv.paper.sampler.surrogate import Surrogate, fit_surrogate
from regional_lv.paper.sampler.target import Target
from tests.paper.test_likelihood import OUTPUTS, LinearEmulator, linear

SEGMENTS = StiffnessInputs({f"segment_{s:02d}": (s,) for s in range(1, 18)})
NONE = torch.zeros(0, dtype=torch.float64)


class Curved(LinearEmulator):
    """Its log variance is a quadratic form of log theta that ties every parameter to others."""

    def _predict(self, theta):
        form = np.random.default_rng(5).normal(size=(len(self.parameters),) * 2)
        x = theta.log()
        logs = 3.0 * torch.einsum("...i,ij,...j->...", x, torch.as_tensor(form), x)
        return SeparablePrediction(self.base + theta @ self.slopes.T, logs.exp(), self.matrix)


@pytest.mark.parametrize("parameters", [SEGMENTS, LinearEmulator.parameters], ids=len)
def test_the_variance_is_met_where_it_was_not_evaluated(parameters):
    emulator = linear(0.3)
    emulator.__class__, emulator.parameters = Curved, parameters
    rng = np.random.default_rng(6)
    emulator.slopes = torch.as_tensor(0.1 * rng.normal(size=(len(OUTPUTS), len(parameters))))
    truth = torch.ones(len(parameters), dtype=torch.float64)
    likelihood = Likelihood(emulator, emulator.predict(truth).mean, Noise.none(emulator))
    target = Target.near(likelihood, truth, NONE)
    centre, size = target.unconstrain(truth, NONE), len(parameters)
    scale = 0.1 * torch.eye(size, dtype=torch.float64)
    draws = centre + torch.as_tensor(rng.normal(size=(count_places(size) + 500, size))) @ scale.mT
    surrogate = fit_surrogate(target, draws[:-500], centre, scale)
    assert isinstance(surrogate, Surrogate)
    with torch.no_grad():
        exact, prediction = target.evaluate(draws[-500:])
        error = surrogate(draws[-500:]) - exact
    # A potential has half the log variance of each output.
    spread = 0.5 * len(OUTPUTS) * prediction.variance.log().std()
    assert spread > 1.5
    assert error.std() < 0.1 * spread
