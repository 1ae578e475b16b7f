"""Scales on which the prior of psi is uniform and its effect is smooth.

A scale takes psi (float or tensor) to a growing number, `inverse` takes it back, and `slope` is the
derivative of psi about that number, at psi.
"""

import math
from dataclasses import dataclass
from typing import Protocol


class Scale(Protocol):
    def __call__(self, psi): ...
    def inverse(self, scaled): ...
    def slope(self, psi): ...


@dataclass(frozen=True)
class Linear:
    """Psi itself."""

    def __call__(self, psi):
        return psi

    def inverse(self, scaled):
        return scaled

    def slope(self, psi):
        return 1.0


@dataclass(frozen=True)
class Logarithmic:
    """For factors: half as much and twice as much are equally far."""

    def __call__(self, psi):
        return math.log(psi) if isinstance(psi, float | int) else psi.log()

    def inverse(self, scaled):
        return math.exp(scaled) if isinstance(scaled, float | int) else scaled.exp()

    def slope(self, psi):
        return psi


@dataclass(frozen=True)
class Saturating:
    """psi / (psi + half_way), for springs and compliances: the share of its largest effect that two
    springs in series have. half_way: psi at which the effect is half of that."""

    half_way: float

    def __call__(self, psi):
        return psi / (psi + self.half_way)

    def inverse(self, scaled):
        return self.half_way * scaled / (1 - scaled)

    def slope(self, psi):
        return (psi + self.half_way) ** 2 / self.half_way
