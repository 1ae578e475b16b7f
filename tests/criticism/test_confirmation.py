"""What simulations of a set add to its emulated outputs."""

import numpy as np
import pytest
import torch

from regional_lv.criticism.confirmation import Correction

P, K, D = 10, 2, 12


class Emulator:
    def mean(self, theta, scaled):
        return torch.zeros(*theta.shape[:-1], D, dtype=theta.dtype)


def simulations(seed: int, n: int, error: np.ndarray):
    """n draws of one heart, and outputs that differ from the emulator's by `error` (n, D)."""
    rng = np.random.default_rng(seed)
    theta = torch.as_tensor(rng.lognormal(sigma=0.2, size=(n, 1, P)))
    scaled = torch.as_tensor(rng.normal(size=(n, 1, K)))
    return theta, scaled, torch.as_tensor(error[:, None, :])


def correlations(covariance: torch.Tensor) -> torch.Tensor:
    sd = covariance.diagonal().sqrt()
    return (covariance / sd / sd[:, None])[~torch.eye(D, dtype=torch.bool)]


def test_a_linear_difference_is_taken_away():
    rng = np.random.default_rng(1)
    theta, scaled, _ = simulations(2, 40, np.zeros((40, D)))
    slopes = torch.as_tensor(rng.normal(size=(D, P + K)))
    at = torch.cat([theta.log(), scaled], dim=-1)
    found = Correction.fit(Emulator(), theta, scaled, at @ slopes.T + 0.5)
    new_theta, new_scaled, _ = simulations(3, 5, np.zeros((5, D)))
    expected = torch.cat([new_theta.log(), new_scaled], dim=-1) @ slopes.T + 0.5
    assert torch.allclose(found.mean(new_theta, new_scaled), expected, atol=0.02)
    assert found.covariance[0].diagonal().max() < 1e-3


@pytest.mark.parametrize("n", [6, 30])
def test_what_is_missed_in_many_channels_alike_is_correlated(n):
    """One pattern with a random size, beside little of each channel's own."""
    alike, own = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        little = 0.1 * rng.normal(size=(n, D))
        common = Correction.fit(Emulator(), *simulations(seed, n, rng.normal(size=(n, 1)) + little))
        alone = Correction.fit(Emulator(), *simulations(seed, n, rng.normal(size=(n, D))))
        alike.append(float(correlations(common.covariance[0]).mean()))
        own.append(float(correlations(alone.covariance[0]).mean()))
        assert float(torch.linalg.eigvalsh(alone.covariance[0])[0]) > 0
    assert np.mean(alike) > (0.6 if n == 6 else 0.9)
    assert abs(np.mean(own)) < 0.05


@pytest.mark.parametrize("slope", [0.0, 0.05])
@pytest.mark.parametrize("n", [4, 6, 12, 30])
def test_the_covariance_has_the_size_of_the_errors_elsewhere(n, slope):
    """At new draws, also with fewer simulations than coordinates, where a line goes through all."""
    claimed, true = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        slopes = slope * torch.as_tensor(rng.normal(size=(D, P + K)))

        def errors(theta, scaled, slopes=slopes, rng=rng):
            at = torch.cat([theta.log() / 0.2, scaled], dim=-1)
            return at @ slopes.T + torch.as_tensor(0.02 * rng.normal(size=(len(at), 1, D)))

        theta, scaled, _ = simulations(seed, n, np.zeros((n, D)))
        found = Correction.fit(Emulator(), theta, scaled, errors(theta, scaled))
        new = simulations(seed + 1000, 200, np.zeros((200, D)))[:2]
        true.append(float((errors(*new) - found.mean(*new)).square().mean()))
        claimed.append(float(found.covariance[0].diagonal().mean()))
    assert 0.8 < np.mean(claimed) / np.mean(true) < 1.6


def test_an_output_without_any_difference_has_no_variance():
    rng = np.random.default_rng(4)
    error = rng.normal(size=(8, D))
    error[:, 3] = 0.0
    covariance = Correction.fit(Emulator(), *simulations(4, 8, error)).covariance[0]
    assert covariance[3].abs().max() == 0 and covariance.isfinite().all()
