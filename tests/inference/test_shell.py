"""Coordinates about the shell of an exact output."""

from dataclasses import replace

import pytest
import torch

from regional_lv.emulators.base import SeparablePrediction
from regional_lv.inference.likelihood import Likelihood, Noise
from regional_lv.inference.shell import Shell, flatten
from regional_lv.inference.target import Target
from tests.inference.test_likelihood import LinearEmulator, linear


class Bent(LinearEmulator):
    """A linear emulator of log theta, whose mean bends in the root of theta."""

    def _predict(self, theta):
        mean = self.base + theta.log() @ self.slopes.T
        return SeparablePrediction(mean, super()._predict(theta).variance, self.matrix)


@pytest.fixture(scope="module")
def posterior() -> tuple[Shell, torch.Tensor]:
    """Shell of the first output, and its thickness."""
    emulator = linear(0.003)
    emulator.__class__ = Bent
    truth = torch.linspace(0.3, 3.5, 10, dtype=torch.float64)
    y = emulator.predict(truth).mean
    likelihood = Likelihood(emulator, y, Noise.inferred(emulator, 1.0))
    log_sigma = torch.full((len(likelihood.noise.groups),), -1.0, dtype=torch.float64)
    target = Target.near(likelihood, truth, log_sigma)
    assert target.thin(truth) == [0]
    place = target.blurred([0]).gaussian(truth, log_sigma)
    return flatten(likelihood, 0, target.transform, *place, torch.Generator().manual_seed(1))


def places(posterior, size: int, spread: float = 1.0) -> torch.Tensor:
    _, thickness = posterior
    generator = torch.Generator().manual_seed(5)
    deviates = torch.randn(size, 10, generator=generator, dtype=torch.float64)
    deviates[:, -1] *= thickness
    return spread * deviates


@pytest.mark.parametrize(("spread", "reached"), [(1.0, 0.97), (2.0, 0.8)])
def test_the_output_is_one_of_the_coordinates(posterior, spread, reached):
    shell, *_ = posterior
    w = places(posterior, 300, spread)
    theta, log_jacobian = shell.open(w)
    assert theta.min() >= 0.1 and theta.max() <= 5.0
    output = shell.emulator.predict_mean(theta)[:, 0] - shell.value
    there = (output - w[:, -1]).abs() < 1e-7
    assert there.double().mean() > reached
    # What the bounds keep from such an output is no place of any theta.
    assert (torch.isfinite(log_jacobian) == there).all()


def test_what_is_flat_in_its_coordinates_was_bent(posterior):
    """On the plane that is nearest to the shell the output is off by far more than on the shell."""
    shell, *_ = posterior
    w = places(posterior, 300)
    height, _ = shell._find(w[:, :-1], w[:, -1])
    rows = torch.cat([torch.ones(len(w), 1), w[:, :-1]], dim=1)
    plane = rows @ torch.linalg.lstsq(rows, height[:, None]).solution
    assert shell._excess(w[:, :-1], plane[:, 0]).std() > 10 * w[:, -1].std()


def test_and_back_again(posterior):
    shell, *_ = posterior
    w = places(posterior, 100, 0.5)
    torch.testing.assert_close(shell.position(shell.theta(w)), w, atol=1e-6, rtol=1e-6)


def test_jacobian_and_derivatives(posterior):
    shell, *_ = posterior
    for w in places(posterior, 4):
        jacobian = torch.autograd.functional.jacobian(shell.theta, w)
        assert shell.open(w)[1].item() == pytest.approx(
            torch.linalg.slogdet(jacobian).logabsdet.item(), abs=1e-5
        )
        here = w.clone().requires_grad_()
        (gradient,) = torch.autograd.grad(shell.open(here)[1], here)
        steps = 1e-3 * torch.eye(10, dtype=torch.float64)
        ahead, back = shell.open(w + steps)[1], shell.open(w - steps)[1]
        torch.testing.assert_close((ahead - back) / 2e-3, gradient, atol=1e-3, rtol=1e-3)


def test_heights_are_found_from_any_guess(posterior):
    shell, *_ = posterior
    w = places(posterior, 50)
    blind = replace(shell, guess=torch.zeros_like(shell.guess))
    torch.testing.assert_close(blind.theta(w), shell.theta(w), atol=1e-6, rtol=1e-6)
