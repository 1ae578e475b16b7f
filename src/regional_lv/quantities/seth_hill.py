"""The Seth-Hill family of strains, (l^n - 1) / n of a stretch l and its logarithm for n = 0.

Hill 1968, J Mech Phys Solids 16:229-242, doi 10.1016/0022-5096(68)90031-8.
"""

from collections.abc import Mapping
from typing import NamedTuple, Self

import numpy as np

MEASURES: dict[float, str] = {-2: "Almansi", 0: "logarithmic", 1: "nominal", 2: "Green"}
"""Exponent n -> what the strain is called."""


class Measure(NamedTuple):
    """exponent: n. line_share: 0 for the tensor's component, 1 for the line's, linear between
    (`mechanics.observables.strain_measure`)."""

    exponent: float = 2.0
    line_share: float = 0.0

    @classmethod
    def of(cls, observables: Mapping) -> Self:
        """Of the section `observables` of a configuration."""
        return cls(observables["strain_exponent"], observables["line_share"])


def measure_name(exponent: float) -> str:
    """What the strain with this exponent is called."""
    return MEASURES.get(exponent, f"Seth-Hill (n = {exponent:g})")


def strain(stretches: np.ndarray, exponent: float) -> np.ndarray:
    """Strains of stretches."""
    if exponent == 0:
        return np.log(stretches)
    return (stretches**exponent - 1) / exponent


def stretch(strains: np.ndarray, exponent: float) -> np.ndarray:
    """Stretches of strains, the inverse of `strain`; NaN where no stretch has this strain."""
    if exponent == 0:
        return np.exp(strains)
    return (1 + exponent * strains) ** (1 / exponent)
