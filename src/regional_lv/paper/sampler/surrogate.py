"""A cheap density to explore a posterior with, which the exact one corrects.

The variance of a Gaussian process costs far more than its mean, and varies little where a posterior
is: a quadratic polynomial of the position stands for its logarithm.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch

from regional_lv.emulators.base import join
from regional_lv.inference.potential import CHUNK
from regional_lv.paper.sampler.target import Target

Potential = Callable[[torch.Tensor], torch.Tensor]
"""-log density (N,) of positions (N, S)."""

SCALE = 10.0
"""Excess potential at which an evaluation weighs a quarter of one at the maximum."""

RIDGE = 1e-6
"""Relative penalty that keeps a fit to nearly dependent columns regular."""


@dataclass(frozen=True)
class Surrogate:
    """The potential of `target` with a log variance that is a polynomial of z = (position - centre)
    inverse', kept between the `lowest` and the `highest` value that it was fitted to.

    centre (S,), inverse (S, S), coefficients (F,).
    """

    target: Target
    centre: torch.Tensor
    inverse: torch.Tensor
    coefficients: torch.Tensor
    lowest: torch.Tensor
    highest: torch.Tensor

    def __call__(self, position: torch.Tensor) -> torch.Tensor:
        logs = products((position - self.centre) @ self.inverse.mT) @ self.coefficients
        return self.target.potential(position, logs.clamp(self.lowest, self.highest).exp())


def fit_surrogate(
    target: Target, places: torch.Tensor, centre: torch.Tensor, scale: torch.Tensor
) -> Potential:
    """The surrogate fitted at `places` (M, S), a few hundred that are spread like the posterior.

    centre (S,), scale (S, S): M with covariance M M', of the places.

    The exact potential, if the emulator's covariance is not separable, or if it leaves the scale of
    its errors to the likelihood: its mean is all it has then.
    """
    likelihood = target.likelihood
    if likelihood.one_scale or not likelihood.separable:
        return target.potential
    with torch.no_grad():
        evaluated = [target.evaluate(part) for part in places.split(CHUNK)]
    potential = torch.cat([value for value, _ in evaluated])
    logs = join([prediction for _, prediction in evaluated]).variance.log()
    inverse = torch.linalg.inv(scale)
    features = products((places - centre) @ inverse.mT)
    # What lies far above the smallest potential matters less.
    weight = 1 / (1 + (potential - potential.min()) / SCALE).square()
    weighted = weight[:, None] * features
    gram = features.T @ weighted
    gram = gram + RIDGE * torch.diag(gram.diagonal())
    coefficients = torch.linalg.solve(gram, weighted.T @ logs)
    return Surrogate(target, centre, inverse, coefficients, logs.min(), logs.max())


def products(y: torch.Tensor) -> torch.Tensor:
    """1, y and all products of two (..., F)."""
    first, second = torch.triu_indices(y.shape[-1], y.shape[-1])
    return torch.cat([torch.ones_like(y[..., :1]), y, y[..., first] * y[..., second]], dim=-1)
