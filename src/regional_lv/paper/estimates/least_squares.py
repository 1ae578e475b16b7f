"""Least squares on the predictive mean, for many observations at once.

The paper's estimate: Sobol starts, basin hopping, Adam. Here Adam moves all starts of all
observations together, Levenberg-Marquardt steps with exact Jacobians (`sampler.point`) take each
to its minimum, and the best is perturbed and taken down again, `hops` times.
"""

from typing import cast

import torch

from regional_lv.emulators.base import Emulator, SeparablePrediction
from regional_lv.inference.noise import Noise
from regional_lv.paper.sampler.likelihood import Likelihood
from regional_lv.paper.sampler.point import (
    CHUNK,
    SCREENED_PER_START,
    climb,
    log_bounds,
    starting_points,
)
from regional_lv.seeds import derive

HOP = 0.3
"""Standard deviation of a perturbation, in log theta."""

ADAM_RATE = 0.05
"""Adam's steps, in log theta."""


class MeanOnly:
    """An emulator whose errors are one and the same everywhere: the training sd of each output.

    With it, a log density is minus half the squared distance between observation and mean, in
    training sd, and a constant.
    """

    def __init__(self, emulator: Emulator):
        self.emulator = emulator
        self.lower, self.upper, self.output_sd = emulator.lower, emulator.upper, emulator.output_sd

    def predict(self, theta: torch.Tensor) -> SeparablePrediction:
        mean = self.emulator.predict_mean(theta)
        return SeparablePrediction(
            mean, torch.ones_like(mean[..., 0]), self.output_sd.square().diag()
        )

    def jacobian(self, theta: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return self.emulator.linearise(theta)[1], torch.zeros_like(theta)


def find_least_squares(
    emulator: Emulator,
    y: torch.Tensor,
    starts: int,
    iterations: int,
    adam_steps: int,
    hops: int,
    seed: int,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Theta (C, P) within the bounds with the least sum of squared differences (C,), in training
    sd, between the predictive mean and each row of `y` (C, D).

    starts: Sobol points kept per row; iterations: Levenberg-Marquardt steps at most, each time.
    """
    flat = cast(Emulator, MeanOnly(emulator))  # it has all that is asked for here
    likelihood = Likelihood(flat, y, Noise.none(flat))
    first = _nearest_points(emulator, y, starts, seed).log()
    low, high = log_bounds(emulator)
    owner = torch.arange(len(y)).repeat_interleave(first.shape[1])
    position = _adam(likelihood, y[owner], first.flatten(0, 1), low, high, adam_steps)
    position, value = climb(likelihood, y[owner], position, low, high, iterations)
    row = torch.arange(len(y))
    position, value = position.reshape(first.shape), value.reshape(first.shape[:2])
    best = value.argmax(dim=1)
    position, value = position[row, best], value[row, best]
    generator = torch.Generator().manual_seed(derive(seed, "hops"))
    for _ in range(hops):
        # One perturbation for all rows: a row does not depend on those beside it.
        step = HOP * torch.randn(len(low), generator=generator, dtype=y.dtype)
        trial = torch.minimum(torch.maximum(position + step, low), high)
        trial, reached = climb(likelihood, y, trial, low, high, iterations)
        better = reached > value
        position = torch.where(better[:, None], trial, position)
        value = torch.where(better, reached, value)
    theta = position.exp().clamp(emulator.lower, emulator.upper)
    with torch.no_grad():
        residual = torch.cat([emulator.predict_mean(part) for part in theta.split(CHUNK)]) - y
    return theta, (residual / emulator.output_sd).square().sum(1)


def _nearest_points(emulator: Emulator, y: torch.Tensor, starts: int, seed: int) -> torch.Tensor:
    """Theta (C, starts, P): the Sobol points (half natural, half log scale) whose predictive means
    are nearest to each row of `y` (C, D)."""
    points = starting_points(emulator, max(1, SCREENED_PER_START * starts // 2), seed)
    with torch.no_grad():
        means = torch.cat([emulator.predict_mean(part) for part in points.split(CHUNK)])
    distance = torch.cdist(y / emulator.output_sd, means / emulator.output_sd)
    return points[distance.topk(min(starts, len(points)), dim=1, largest=False).indices]


def _adam(likelihood, y, position, low, high, steps: int) -> torch.Tensor:
    """`position` (M, P) after `steps` of Adam, kept within the bounds."""
    position = position.clone().requires_grad_(True)
    optimiser = torch.optim.Adam([position], lr=ADAM_RATE)
    for _ in range(steps):
        optimiser.zero_grad()
        for rows in torch.arange(len(position)).split(CHUNK):
            (-likelihood.at(y[rows]).log_density(position[rows].exp()).sum()).backward()
        optimiser.step()
        with torch.no_grad():
            position.copy_(torch.minimum(torch.maximum(position, low), high))
    return position.detach()
