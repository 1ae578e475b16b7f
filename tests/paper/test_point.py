"""The maximum: where it must be in closed form, on the bounds, and from a real emulator."""

import numpy as np
import torch

from regional_lv.emulators import create
from regional_lv.inference.noise import Noise
from regional_lv.paper.sampler.likelihood import Likelihood
from regional_lv.paper.sampler.point import find_map
from tests.paper.conftest import PARAMETERS
from tests.paper.test_likelihood import THETA, inferred, linear


def test_is_generalised_least_squares_where_that_lies_inside():
    emulator = linear(0.05)
    y = emulator.predict(THETA).mean + 0.02
    noise = Noise.known(torch.full((len(emulator.outputs),), 0.1, dtype=torch.float64))
    found = find_map(Likelihood(emulator, y, noise), 4, 100, 1)
    precision = torch.linalg.inv(emulator.matrix + 0.01 * torch.eye(y.shape[1]).double())
    a = emulator.slopes
    expected = torch.linalg.solve(a.T @ precision @ a, a.T @ precision @ (y - emulator.base).T).T
    torch.testing.assert_close(found.theta, expected, rtol=1e-5, atol=1e-6)
    assert (found.agreement == 1).all()


def test_stays_on_the_bound_that_the_data_point_beyond():
    emulator = linear(0.05)
    # Orthogonal slopes and equal errors: every parameter is clamped on its own.
    emulator.slopes, _ = torch.linalg.qr(emulator.slopes)
    emulator.matrix = 0.0025 * torch.eye(len(emulator.outputs)).double()
    beyond = torch.full((1, 10), 2.0, dtype=torch.float64)
    beyond[0, 3], beyond[0, 6] = 7.0, -1.0
    y = emulator.base + beyond @ emulator.slopes.T
    likelihood = Likelihood(emulator, y, Noise.none(emulator))
    found = find_map(likelihood, 4, 200, 1)
    theta = found.theta[0]
    assert theta[3] == 5.0 and theta[6] == 0.1
    expected = beyond[0].clamp(emulator.lower, emulator.upper)
    torch.testing.assert_close(theta, expected, rtol=0, atol=1e-5)


def test_finds_the_noise_scale():
    emulator = linear(0.001)
    noise = inferred(emulator, 5.0)
    rng = np.random.default_rng(4)
    sd = noise.variance(torch.log(torch.tensor([0.2, 0.2, 0.2]).double())).sqrt()
    y = emulator.predict(THETA[:1]).mean + sd * torch.as_tensor(rng.normal(size=(1, len(sd))))
    likelihood = Likelihood(emulator, y, noise)
    found = find_map(likelihood, 6, 300, 1)
    position = torch.cat([found.theta.log(), found.log_sigma], dim=1).requires_grad_(True)
    value = likelihood.log_density(position[:, :10].exp(), position[:, 10:])
    (value + noise.log_prior(position[:, 10:])).sum().backward()
    inside = (found.theta > 0.1001) & (found.theta < 4.999)
    free = torch.cat([inside, found.log_sigma > -6.9], dim=1)
    assert position.grad[free].abs().max() < 1e-2


def test_recovers_what_made_the_data():
    def simulate(theta):
        x = np.log(theta)
        return np.concatenate([x, np.tanh(0.5 * x[:, ::-1]) + 0.2 * x**2], axis=1)

    rng = np.random.default_rng(5)
    theta = np.exp(rng.uniform(np.log(0.1), np.log(5.0), size=(200, 10)))
    names = [f"circumferential_{i:02d}" for i in range(1, 11)]
    names += [f"radial_{i:02d}" for i in range(1, 11)]
    emulator = create("exact_gp").fit(theta, simulate(theta), parameters=PARAMETERS, outputs=names)
    truth = rng.uniform(0.5, 4.0, size=(6, 10))
    y = torch.as_tensor(simulate(truth))
    found = find_map(Likelihood(emulator, y, Noise.none(emulator)), 4, 200, 1)
    assert ((found.theta.numpy() - truth) ** 2).mean() < 5e-3
    again = find_map(Likelihood(emulator, y, Noise.none(emulator)), 4, 200, 1)
    assert torch.equal(found.theta, again.theta)
