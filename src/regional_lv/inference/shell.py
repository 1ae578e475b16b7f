"""Coordinates in which the thin shell that an exact output makes of a posterior is flat."""

import math
from dataclasses import dataclass
from functools import cached_property

import torch

from regional_lv.emulators.base import Emulator
from regional_lv.inference.likelihood import Likelihood
from regional_lv.inference.point import CHUNK
from regional_lv.inference.transform import ThetaTransform

PLACES, SPREAD = 2000, 1.3
"""Places on the shell that first guesses of its height are fitted to, and how far across."""

STEP = 3e-3
"""Of central differences along the axis, in posterior sd: round-off makes 1e-6 of the slope."""

FAR, TOLERANCE = 24.0, 3e-8
"""Where the shell is looked for, in posterior sd, and how well it is found, in training sd."""

ITERATIONS, CLOSED = 60, 1e-9
"""Of the search, and between which heights it ends without having found any."""

STEEPNESS = 1e-12
"""Smallest slope: where an emulator falls along the axis, heights are not unique."""


@dataclass(frozen=True)
class Shell:
    """w = (y, u): P - 1 coordinates y across the shell, and how far the output is from what was
    observed.

    A volume known to a tenth of a mL beside strains with inferred noise leaves a curved shell, a
    hundred times as wide as thick. About w it is the slab u = 0: v, the coordinates of `transform`,
    is origin + frame (y, a), and the height a the one at which the emulator's mean of the output is
    `value` + u. Along the axis of a every theta changes towards a larger output, so that there is
    no more than one such height.

    value: observed. origin (P,), frame (P, P): of v, the axis is the last column.
    guess (F,): coefficients of a quadratic polynomial of y, where a is looked for first.
    """

    transform: "ThetaTransform | Shell"
    emulator: Emulator
    output: int
    value: torch.Tensor
    origin: torch.Tensor
    frame: torch.Tensor
    guess: torch.Tensor

    def open(self, w: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Theta (..., P), within the bounds, and log |d theta / dw| (...), at w (..., P).

        The latter is -inf where no height within the bounds has such an output, or the output does
        not rise there: these w are no coordinates of any theta.
        """
        y, u = w[..., :-1], w[..., -1]
        height, slope = self._find(y.detach(), u.detach())
        # One further step has the derivatives of the height (implicit function theorem).
        missing = u - self._excess(y, height)
        height = height + missing / slope
        ends = torch.stack([height - STEP, height + STEP])
        below, above = self._excess(y.expand(2, *y.shape), ends)
        slope = ((above - below) / (2 * STEP)).clamp(min=STEEPNESS)
        v = self._v(y, height)
        theta, log_jacobian = self.transform.open(v)
        log_jacobian = log_jacobian - slope.log() + self._log_volume
        lost = (missing.abs() > self._tolerance) | (slope <= STEEPNESS)
        return theta, torch.where(lost, -math.inf, log_jacobian)

    def theta(self, w: torch.Tensor) -> torch.Tensor:
        """Theta (..., P), within the bounds."""
        return self.open(w)[0]

    def position(self, theta: torch.Tensor) -> torch.Tensor:
        """w (..., P) of `theta`."""
        away = self.transform.position(theta) - self.origin
        across = torch.linalg.solve(self.frame, away[..., None])
        y, height = across[..., :-1, 0], across[..., -1, 0]
        return torch.cat([y, self._excess(y, height)[..., None]], dim=-1)

    @cached_property
    def _log_volume(self) -> torch.Tensor:
        return torch.linalg.slogdet(self.frame).logabsdet

    @property
    def _tolerance(self) -> torch.Tensor:
        return TOLERANCE * self.emulator.output_sd[self.output]

    def _v(self, y: torch.Tensor, height: torch.Tensor) -> torch.Tensor:
        return self.origin + torch.cat([y, height[..., None]], dim=-1) @ self.frame.T

    def _excess(self, y: torch.Tensor, height: torch.Tensor) -> torch.Tensor:
        """The emulator's mean of the output, less the observed value, (...)."""
        theta = self.transform.theta(self._v(y, height))
        parts = theta.reshape(-1, theta.shape[-1]).split(CHUNK)
        mean = torch.cat([self.emulator.predict_mean(part)[:, self.output] for part in parts])
        return mean.reshape(height.shape) - self.value

    @torch.no_grad()
    def _find(self, y: torch.Tensor, u: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Height (...) at which the output's excess is u (...), and its slope there.

        Newton's method, which is led back by bisection.
        """
        shape = u.shape
        y, u = y.reshape(-1, y.shape[-1]), u.reshape(-1)
        height = (products(y) @ self.guess).clamp(-FAR / 2, FAR / 2)
        low, high = torch.full_like(height, -FAR), torch.full_like(height, FAR)
        slope, left = torch.ones_like(height), torch.arange(len(height))
        for _ in range(ITERATIONS):
            here = height[left]
            ahead = torch.stack([here, here + STEP])
            excess, next_excess = self._excess(y[left].expand(2, -1, -1), ahead)
            gap = u[left] - excess
            slope[left] = (next_excess - excess) / STEP
            low[left] = torch.where(gap > 0, here, low[left])
            high[left] = torch.where(gap < 0, here, high[left])
            moved = here + gap / slope[left]
            inside = (moved > low[left]) & (moved < high[left])
            height[left] = torch.where(inside, moved, 0.5 * (low[left] + high[left]))
            found = gap.abs() < self._tolerance
            left = left[~found & (high[left] - low[left] > CLOSED)]
            if not len(left):
                break
        return height.reshape(shape), slope.clamp(min=STEEPNESS).reshape(shape)


def flatten(
    likelihood: Likelihood,
    output: int,
    transform: "ThetaTransform | Shell",
    centre: torch.Tensor,
    scale: torch.Tensor,
    generator: torch.Generator,
) -> tuple[Shell, torch.Tensor]:
    """The shell of an output of `likelihood`, and how thick it is, one sd.

    centre (P + G,), scale (P + G, P + G): where the posterior is and how wide, about (v, log
    sigma), of a likelihood with that output `blurred`.
    """
    emulator = likelihood.emulator
    covariance = scale @ scale.T
    p = likelihood.inputs
    origin, spread = centre[:p], torch.linalg.cholesky(covariance[:p, :p])
    v = origin.clone().requires_grad_()
    (slope,) = torch.autograd.grad(emulator.predict_mean(transform.theta(v))[output], v)
    axis = torch.linalg.solve(spread, covariance.diagonal()[:p] * slope)
    basis = torch.linalg.svd((axis / axis.norm())[None])[2].clone()
    basis[0] *= torch.sign(basis[0] @ axis)
    frame = spread @ basis.roll(-1, 0).T
    value = likelihood.y[output]
    guess = torch.zeros(len(products(origin[1:])), dtype=origin.dtype)
    rough = Shell(transform, emulator.rough, output, value, origin, frame, guess)
    y = SPREAD * torch.randn(PLACES, p - 1, generator=generator, dtype=origin.dtype)
    height, _ = rough._find(y, torch.zeros(PLACES, dtype=origin.dtype))
    # What lies far off the posterior matters less.
    weight = torch.exp(-0.125 * height.square())[:, None]
    fit = torch.linalg.lstsq(weight * products(y), weight * height[:, None])
    shell = Shell(transform, emulator, output, value, origin, frame, fit.solution[:, 0])

    with torch.no_grad():
        error = emulator.predict(transform.theta(origin)).covariance[output, output]
    return shell, (error + likelihood.noise.sd[output].square()).sqrt()


def products(y: torch.Tensor) -> torch.Tensor:
    """1, y and all products of two (..., F)."""
    first, second = torch.triu_indices(y.shape[-1], y.shape[-1])
    return torch.cat([torch.ones_like(y[..., :1]), y, y[..., first] * y[..., second]], dim=-1)
