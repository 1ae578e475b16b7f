"""What simulations of a set add to its emulated outputs."""

import numpy as np
import pandas as pd
import pytest
import torch

from regional_lv.criticism.confirmation import Correction
from regional_lv.criticism.designs import read_simulated
from regional_lv.errors import InputError

P, K, D = 10, 2, 12


class Emulator:
    """Predicts nothing, whatever the input."""

    def linearise(self, theta, scaled):
        mean = torch.zeros(*theta.shape[:-1], D, dtype=theta.dtype)
        by_log_theta, by_scaled = (mean[..., None].expand(*mean.shape, n) for n in (P, K))
        return mean, by_log_theta, by_scaled


class Simulator:
    """Outputs in closed form: linear about log theta and psi, with curvature `bend` about theta and
    `own` that follows neither (of one pattern, if `alike`)."""

    def __init__(self, seed, slope=0.0, bend=0.0, own=0.0, alike=False):
        rng = np.random.default_rng(seed)
        self.by_log_theta = torch.as_tensor(slope * rng.normal(size=(D, P)))
        self.by_scaled = torch.as_tensor(slope * rng.normal(size=(D, K)))
        self.bend = torch.as_tensor(bend * rng.normal(size=(D, P)))
        self.own, self.alike, self.rng = own, alike, rng

    def draws(self, n: int):
        theta = torch.as_tensor(self.rng.lognormal(sigma=0.2, size=(n, 1, P)))
        return theta, torch.as_tensor(self.rng.normal(size=(n, 1, K)))

    def __call__(self, theta, scaled):
        """Outputs and their derivatives about log theta."""
        log = theta.log()
        outputs = log @ self.by_log_theta.T + log.square() @ self.bend.T + scaled @ self.by_scaled.T
        size = (len(theta), 1, 1 if self.alike else D)
        outputs = outputs + torch.as_tensor(self.own * self.rng.normal(size=size))
        return outputs + 0.5, self.by_log_theta + 2 * self.bend * log[..., None, :]

    def fitted(self, n: int) -> Correction:
        at = self.draws(n)
        return Correction.fit(Emulator(), *at, *self(*at))


def correlations(covariance: torch.Tensor) -> torch.Tensor:
    sd = covariance.diagonal().sqrt()
    return (covariance / sd / sd[:, None])[~torch.eye(D, dtype=torch.bool)]


@pytest.mark.parametrize("n", [5, 40])
def test_a_linear_difference_is_taken_away(n):
    """About the ten factors, too, whose derivatives five simulations bring along."""
    simulator = Simulator(1, slope=1.0)
    found, new = simulator.fitted(n), simulator.draws(5)
    # The ridge's smallest penalty is left of the slopes about psi.
    assert torch.allclose(found.mean(*new), simulator(*new)[0], atol=0.05)
    assert torch.allclose(found.by_log_theta[0], simulator.by_log_theta)
    assert found.covariance[0].diagonal().max() < 0.05**2


def test_how_far_from_the_simulations_an_effect_is():
    simulator = Simulator(1, slope=1.0)
    theta, scaled = simulator.draws(8)
    found = Correction.fit(Emulator(), theta, scaled, *simulator(theta, scaled))
    mean, sd = scaled.mean(0), scaled.std(0)
    expected = torch.tensor([[0.0, -5.0, 9.0][:K]], dtype=torch.float64)
    assert torch.allclose(found.beyond(mean + expected * sd, 10 * sd[0]), expected)
    # Simulations that lie within a thousandth of the range.
    width = 1000 * sd[0]
    assert torch.allclose(found.beyond(mean + 0.04 * expected * width, width), 4 * expected)


@pytest.mark.parametrize("n", [6, 30])
def test_what_is_missed_in_many_channels_alike_is_correlated(n):
    alike, independent = [], []
    for seed in range(10):
        common = Simulator(seed, own=1.0, alike=True).fitted(n).covariance[0]
        alone = Simulator(seed, own=1.0).fitted(n).covariance[0]
        alike.append(float(correlations(common + 0.01 * torch.eye(D)).mean()))
        independent.append(float(correlations(alone).mean()))
        assert float(torch.linalg.eigvalsh(alone)[0]) > 0
    assert np.mean(alike) > (0.6 if n == 6 else 0.9)
    assert abs(np.mean(independent)) < 0.05


@pytest.mark.parametrize(("slope", "bend", "own"), [(0, 0, 1), (1, 0, 0.3), (1, 0.5, 0)])
@pytest.mark.parametrize("n", [6, 12, 30])
def test_the_covariance_has_the_size_of_the_errors_elsewhere(n, slope, bend, own):
    """At new draws, also with fewer simulations than coordinates; rather too large where there are
    few."""
    claimed, true = [], []
    for seed in range(15):
        simulator = Simulator(seed, slope, bend, own)
        found, new = simulator.fitted(n), simulator.draws(200)
        true.append(float((simulator(*new)[0] - found.mean(*new)).square().mean()))
        claimed.append(float(found.covariance[0].diagonal().mean()))
    assert 0.7 < np.mean(claimed) / np.mean(true) < 3.0


def test_an_output_without_any_difference_has_no_variance():
    at = Simulator(4).draws(8)
    outputs, slopes = Simulator(4, own=1.0)(*at)
    outputs[..., 3] = 0.0
    covariance = Correction.fit(Emulator(), *at, outputs, slopes).covariance[0]
    assert covariance[3].abs().max() == 0 and covariance.isfinite().all()


def test_simulations_without_derivatives_are_refused(tmp_path):
    table = pd.DataFrame({"set": ["septal_load"], "volume_ml": [100.0]})
    table.to_parquet(tmp_path / "old.parquet")
    with pytest.raises(InputError, match=r"old\.parquet: no derivatives about theta; .* remove it"):
        read_simulated(tmp_path / "old.parquet")
    table["slope_volume_ml"] = [[1.0, 2.0]]
    table.to_parquet(tmp_path / "new.parquet")
    assert len(read_simulated(tmp_path / "new.parquet")) == 1
    table[:0].drop(columns="slope_volume_ml").to_parquet(tmp_path / "none.parquet")
    assert read_simulated(tmp_path / "none.parquet").empty
