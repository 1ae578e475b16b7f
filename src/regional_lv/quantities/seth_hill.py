"""The Seth-Hill family of strains, (l^n - 1) / n of a stretch l and its logarithm for n = 0.

Hill 1968, J Mech Phys Solids 16:229-242, doi 10.1016/0022-5096(68)90031-8.
"""

from typing import NamedTuple

import numpy as np

MEASURES: dict[float, str] = {-2: "Almansi", 0: "logarithmic", 1: "nominal", 2: "Green"}
"""Exponent n -> what the strain is called."""


class Measure(NamedTuple):
    """Which strain is meant: of the tensor's component (line_share 0) or of a material line (1), as
    `mechanics.observables.strain_measure` has it."""

    exponent: float = 2.0
    line_share: float = 0.0


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
