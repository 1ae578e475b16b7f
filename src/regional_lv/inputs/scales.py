"""Scales on which the prior of an input is uniform and its effect is smooth.

A scale takes values (numbers, arrays or tensors) to growing numbers, `inverse` takes them back, and
`slope` is the derivative of the value with respect to that number, at the value.
"""

import math
from dataclasses import asdict, dataclass
from typing import Protocol

import numpy as np


class Scale(Protocol):
    def __call__(self, psi): ...
    def inverse(self, scaled): ...
    def slope(self, psi): ...
    def spec(self) -> dict: ...


class _Kept:
    """Plain values from which `scale_from_spec` makes the same scale."""

    def spec(self) -> dict:
        return {"scale": type(self).__name__, **asdict(self)}  # type: ignore[call-overload]


@dataclass(frozen=True)
class Linear(_Kept):
    """The value itself."""

    def __call__(self, psi):
        return psi

    def inverse(self, scaled):
        return scaled

    def slope(self, psi):
        return 1.0


@dataclass(frozen=True)
class Logarithmic(_Kept):
    """For factors: half as much and twice as much are equally far."""

    def __call__(self, psi):
        return _applied(math.log, np.log, "log", psi)

    def inverse(self, scaled):
        return _applied(math.exp, np.exp, "exp", scaled)

    def slope(self, psi):
        return psi


@dataclass(frozen=True)
class Saturating(_Kept):
    """psi / (psi + half_way), for springs and compliances: the share of its largest effect that two
    springs in series have. half_way: psi at which the effect is half of that."""

    half_way: float

    def __call__(self, psi):
        return psi / (psi + self.half_way)

    def inverse(self, scaled):
        return self.half_way * scaled / (1 - scaled)

    def slope(self, psi):
        return (psi + self.half_way) ** 2 / self.half_way


def _applied(of_number, of_array, method: str, values):
    """A function of a number, of an array, or of a tensor, which has it as a method."""
    if isinstance(values, float | int):
        return of_number(values)
    return of_array(values) if isinstance(values, np.ndarray) else getattr(values, method)()


def scale_from_spec(spec: dict) -> Scale:
    """The scale of whose `spec` this is."""
    kinds = {kind.__name__: kind for kind in (Linear, Logarithmic, Saturating)}
    given = dict(spec)
    return kinds[given.pop("scale")](**given)
