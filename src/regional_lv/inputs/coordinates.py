"""The scaled coordinates of inputs: what predictors and emulators know of them."""

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np

from regional_lv.inputs.scales import Scale, scale_from_spec

UNIT = math.log(50)
"""Of scaled coordinates, an input's range in units of the predictor's: that of the logarithm of a
stiffness factor between 0.1 and 5."""


@dataclass(frozen=True)
class Coordinates:
    """Coordinates z = scale(x) of K inputs, on which priors are uniform and effects are smooth.

    Attributes: names (K); scales (K); lower and upper (K,), the ends of the values' ranges; blocks,
    slices that share out the inputs in their order: those of one zone, of the shape, and so on,
    whose effects go together; softness, places of the factors whose smallness makes outputs answer
    more, and errors larger; fields, by name of a field over the wall, of each of the 17 AHA
    segments the places of the inputs that are about it; exponent, the place of the exponent of the
    strain measure, None if it is no input but always `strain_exponent`. `x` are values (..., K),
    arrays or tensors.
    """

    names: tuple[str, ...]
    scales: tuple[Scale, ...]
    lower: np.ndarray
    upper: np.ndarray
    blocks: list[slice]
    softness: tuple[int, ...]
    fields: Mapping[str, tuple[tuple[int, ...], ...]] = field(default_factory=dict)
    exponent: int | None = None
    strain_exponent: float = 2.0

    def __len__(self) -> int:
        return len(self.names)

    @property
    def coordinates(self) -> "Coordinates":
        """Itself, so that it can stand for the parameters of an emulator."""
        return self

    def scaled(self, x):
        """Scaled coordinates (..., K) of values."""
        return self._each(x, lambda scale, column: scale(column))

    def natural(self, z):
        """Values (..., K) of scaled coordinates."""
        return self._each(z, lambda scale, column: scale.inverse(column))

    def slope(self, x):
        """d(value)/d(scaled coordinate) (..., K) at values."""
        return self._each(x, lambda scale, column: 0 * column + scale.slope(column))

    def _each(self, columns, function):
        library = sys.modules[type(columns).__module__.split(".")[0]]
        places, order = self._of_scale
        parts = [function(scale, columns[..., at]) for scale, at in places.items()]
        return library.concatenate(parts, -1)[..., order]

    @cached_property
    def _of_scale(self) -> tuple[dict[Scale, list[int]], list[int]]:
        """Places of each scale's inputs, and where each input is among these one after another."""
        places: dict[Scale, list[int]] = {}
        for k, scale in enumerate(self.scales):
            places.setdefault(scale, []).append(k)
        return places, np.argsort(np.concatenate([*places.values()])).tolist()

    @cached_property
    def units(self) -> np.ndarray:
        """(K,): the length on the scale that counts as one where coordinates are compared."""
        units = (self.scaled(self.upper) - self.scaled(self.lower)) / UNIT
        units[list(self.softness)] = 1.0
        return units

    def place(self, x: np.ndarray) -> np.ndarray:
        """Scaled coordinates in their units (..., K), of values."""
        return self.scaled(np.asarray(x, dtype=float)) / self.units

    # ------------------------------------------------------------------- kept beside results

    def spec(self) -> dict:
        """Plain values from which `from_spec` makes the same coordinates."""
        return {
            "names": list(self.names),
            "scales": [scale.spec() for scale in self.scales],
            "lower": self.lower.tolist(),
            "upper": self.upper.tolist(),
            "blocks": [[block.start, block.stop] for block in self.blocks],
            "softness": list(self.softness),
            "fields": {name: [list(at) for at in places] for name, places in self.fields.items()},
            "exponent": self.exponent,
            "strain_exponent": self.strain_exponent,
        }

    @classmethod
    def from_spec(cls, spec: Mapping) -> "Coordinates":
        """What `spec` describes."""
        return cls(
            tuple(spec["names"]),
            tuple(map(scale_from_spec, spec["scales"])),
            np.array(spec["lower"], dtype=float),
            np.array(spec["upper"], dtype=float),
            [slice(*ends) for ends in spec["blocks"]],
            tuple(spec["softness"]),
            {name: tuple(map(tuple, places)) for name, places in spec["fields"].items()},
            spec["exponent"],
            spec["strain_exponent"],
        )


def blocks_of(keys: Sequence) -> list[slice]:
    """Slices of neighbours with the same key."""
    edges = [0, *(i for i in range(1, len(keys)) if keys[i] != keys[i - 1]), len(keys)]
    return [slice(a, b) for a, b in pairwise(edges)]
