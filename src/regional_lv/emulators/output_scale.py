"""The scale of outputs on which effects add up: log volume, log stretch."""

from dataclasses import dataclass

import torch

from regional_lv.channels import Channels
from regional_lv.inputs.coordinates import Coordinates

LEAST = 1e-12
"""Exponents nearer to 0 than this are 0."""


@dataclass(frozen=True)
class OutputScale:
    """Outputs y (..., D) on their scale v: the logarithm of what is positive, the logarithmic
    strain of what is a strain, others as they are.

    A strain with the Seth-Hill exponent n has y = (exp(n v) - 1) / n, so that strains of any
    exponent lie close together on the scale. Where the exponent is an input it differs from point
    to point.

    positive, strain: masks (D,). coordinates: of the inputs theta (..., K).
    """

    positive: torch.Tensor
    strain: torch.Tensor
    coordinates: Coordinates

    @classmethod
    def of(cls, outputs, coordinates: Coordinates) -> "OutputScale":
        kinds = [channel.kind for channel in Channels.parse(outputs)]
        positive = torch.tensor([kind.is_positive for kind in kinds])
        strain = torch.tensor([kind.is_strain for kind in kinds])
        return cls(positive, strain, coordinates)

    def exponent(self, theta: torch.Tensor) -> torch.Tensor:
        """n (..., 1) of the strains at theta."""
        place = self.coordinates.exponent
        if place is None:
            return torch.full_like(theta[..., :1], self.coordinates.strain_exponent)
        return theta[..., place : place + 1]

    def of_outputs(self, y: torch.Tensor, theta: torch.Tensor) -> torch.Tensor:
        """v (..., D); NaN for a strain that no stretch has."""
        small, safe = self._divisor(theta)
        stretch = torch.where(small, y, torch.log1p(safe * y) / safe)
        return self._choose(y.log(), stretch, y)

    def outputs(self, v: torch.Tensor, theta: torch.Tensor) -> torch.Tensor:
        """y (..., D)."""
        small, safe = self._divisor(theta)
        return self._choose(v.exp(), torch.where(small, v, torch.expm1(safe * v) / safe), v)

    def slopes(self, v: torch.Tensor, theta: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """dy/dv (..., D), and dy/dn (..., D) at the same v, about the exponent."""
        n = self.exponent(theta)
        by_v = self._choose(v.exp(), torch.exp(n * v), torch.ones_like(v))
        small = (n * v).abs() < 1e-4
        safe = torch.where(small, torch.ones_like(v), n.expand_as(v))
        exact = (n * v * torch.exp(n * v) - torch.expm1(n * v)) / safe.square()
        series = v.square() * (0.5 + n * v / 3)
        by_n = torch.where(self.strain, torch.where(small, series, exact), torch.zeros_like(v))
        return by_v, by_n

    def to_scale(self, slopes: torch.Tensor, v: torch.Tensor, theta: torch.Tensor) -> torch.Tensor:
        """dv/dtheta (..., D, K) of dy/dtheta."""
        by_v, by_n = self.slopes(v, theta)
        slopes = slopes.clone()
        if self.coordinates.exponent is not None:
            slopes[..., self.coordinates.exponent] -= by_n
        return slopes / by_v[..., None]

    def from_scale(self, slopes: torch.Tensor, v: torch.Tensor, theta: torch.Tensor):
        """dy/dtheta (..., D, K) of dv/dtheta."""
        by_v, by_n = self.slopes(v, theta)
        slopes = slopes * by_v[..., None]
        if self.coordinates.exponent is not None:
            slopes[..., self.coordinates.exponent] += by_n
        return slopes

    def select(self, index: torch.Tensor) -> "OutputScale":
        """Of some outputs."""
        return OutputScale(self.positive[index], self.strain[index], self.coordinates)

    def _divisor(self, theta: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Where the exponent is 0 (..., 1), and the exponent, there 1."""
        n = self.exponent(theta)
        small = n.abs() < LEAST
        return small, torch.where(small, torch.ones_like(n), n)

    def _choose(self, positive, strain, other):
        return torch.where(self.positive, positive, torch.where(self.strain, strain, other))
