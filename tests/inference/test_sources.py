"""Sources of variance: against what a change of each does to the estimates."""

import numpy as np
import pytest
import torch

from regional_lv.inference.averaging import average
from regional_lv.inference.potential import Potential
from regional_lv.inference.sources import sources_of_variance
from tests.inference.toys import closed_form, linear_problem, toy_inputs


def test_shares_of_a_linear_problem():
    inputs = toy_inputs(3, measured=(0.3, 0.1), half=30.0)
    potential, slopes, covariance = linear_problem(inputs, 10, [0.3, -0.2, 0.1, 0.1, 0.0])
    table = sources_of_variance(average(potential, 0, 0, draws=500))
    np.testing.assert_allclose(table.sum(axis=1), 1.0)
    _, estimate, posterior = closed_form(potential, slopes, covariance)
    variance = posterior.diagonal()[:3]

    def moved(y):
        changed = Potential(potential.emulated, inputs, y, potential.noise)
        return (closed_form(changed, slopes, covariance)[1] - estimate)[:3]

    # Another error in each output by itself.
    gain = torch.stack([moved(potential.y + row) for row in torch.eye(10).double()], 1)
    noise, emulator = (
        0.1**2 * gain.square().sum(1),
        ((gain @ potential.emulated.error) * gain).sum(1),
    )
    np.testing.assert_allclose(table["noise"], noise / variance, atol=1e-3)
    np.testing.assert_allclose(table["emulator"], emulator / variance, atol=1e-3)
    for name, sd, k in (("m0", 0.3, 3), ("m1", 0.1, 4)):
        # A nominal value that is off by an sd acts as the outputs that this makes do, beside the
        # value itself.
        shift = moved(potential.y - sd * slopes[:, k])
        np.testing.assert_allclose(table[name], shift.square() / variance, atol=1e-3)
    assert (table["ranges"] < 1e-3).all() and (table["models"] == 0).all()


def test_models_and_ranges():
    """What the data do not see is known by its range, and causes that are in doubt by models."""
    inputs = toy_inputs(2, suspected=1, half=2.0)
    potential, slopes, _ = linear_problem(inputs, 8, [0.4, 0.2, 0.16], seed=2)
    slopes[:, 1] = 0
    found = average(potential, 1, 0)
    table = sources_of_variance(found)
    assert table.loc["t1", "ranges"] == pytest.approx(1.0, abs=0.02)
    p = found.probability_of(2)
    means = {
        k in found.models[n].members: d.weight @ d.x for n, d in found.drawn.items() for k in [2]
    }
    between = p * (1 - p) * float(means[True][0] - means[False][0]) ** 2
    sd = found.table().loc["t0", "sd"]
    assert table.loc["t0", "models"] == pytest.approx(between / sd**2, rel=0.1) and 0.02 < p < 0.98
