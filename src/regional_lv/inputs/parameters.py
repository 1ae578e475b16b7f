"""Which numbers are inferred: a factor of the material law in each of some zones of the wall.

One `Parameterisation` is made from the configuration and passed to whatever needs it. Its default
is the paper's: five zones, with the factors C_a and C_b of the Holzapfel-Ogden law in each.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from regional_lv import aha
from regional_lv.errors import InputError
from regional_lv.inputs.coordinates import Coordinates
from regional_lv.inputs.scales import Logarithmic
from regional_lv.mechanics.materials import MATERIALS

PAPER_ZONES = {
    "anterior": (1, 7),
    "inferior": (4, 10),
    "lateral": (5, 6, 11, 12),
    "septal": (2, 3, 8, 9),
    "apical": (13, 14, 15, 16, 17),
}
"""Zone -> AHA segments, in the paper's order, z = 1 ... 5."""

ZONES = {
    "paper": PAPER_ZONES,
    "segments": {f"segment_{s.number:02d}": (s.number,) for s in aha.SEGMENTS},
    "whole": {"whole": tuple(s.number for s in aha.SEGMENTS)},
}
"""Word in the configuration (`parameters.zones`) -> zones."""

COLOURS = {
    "anterior": "#0072B2",
    "inferior": "#F0E442",
    "lateral": "#009E73",
    "septal": "#CC79A7",
    "apical": "#E69F00",
}
"""The paper's zone colours (blue, yellow, green, pink, orange), from the Okabe-Ito palette."""

MORE_COLOURS = (*COLOURS.values(), "#56B4E9", "#D55E00", "#999999")
"""For zones of other names: the Okabe-Ito palette, then from the start again."""


@dataclass(frozen=True)
class Parameter:
    """One inferred number: `factor` of the material law in `zone`, between `lower` and `upper`.

    scales_stress: whether all stresses are proportional to it.
    """

    zone: str
    factor: str
    lower: float
    upper: float
    scales_stress: bool

    @property
    def name(self) -> str:
        return f"{self.factor}_{self.zone}"


class Parameterisation(Sequence):
    """The inferred parameters theta, P of them, zone by zone in the order of the zones.

    Parameters
    ----------
    zones: name -> AHA segments (1-17); together every segment once.
    law: name of the material law.
    factors: those of the law's factors that are inferred, the same in every zone; None: all.
    bounds: factor -> (lower, upper) of the box in which theta lies, both above zero.

    Raises InputError for zones that overlap or leave a segment out, a factor that the law does not
    have, and bounds that are no interval above zero.
    """

    def __init__(
        self,
        zones: Mapping[str, Sequence[int]] | None = None,
        law: str = "holzapfel_ogden",
        factors: Sequence[str] | None = None,
        bounds: Mapping[str, Sequence[float]] | Sequence[float] = (0.1, 5.0),
    ):
        self.zones = {
            name: tuple(int(s) for s in segments)
            for name, segments in (PAPER_ZONES if zones is None else zones).items()
        }
        self.law = law
        offered = {factor.name: factor for factor in MATERIALS[law].factors}
        self.factors = tuple(offered if factors is None else factors)
        _check_zones(self.zones)
        _check_factors(self.factors, offered, law)
        if not isinstance(bounds, Mapping):
            bounds = {name: bounds for name in self.factors}
        self.bounds = {name: _interval(name, bounds) for name in self.factors}
        self._parameters = tuple(
            Parameter(zone, name, *self.bounds[name], offered[name].scales_stress)
            for zone in self.zones
            for name in self.factors
        )

    @classmethod
    def from_config(cls, config: Mapping) -> "Parameterisation":
        """From a checked configuration: its sections `parameters`, `material` and `design`."""
        asked, design = config["parameters"], config["design"]
        zones = asked["zones"]
        if isinstance(zones, str):
            zones = ZONES[zones]
        law = config["material"]["law"]
        factors = asked["factors"] or [factor.name for factor in MATERIALS[law].factors]
        _check_factors(tuple(asked["bounds"]), dict.fromkeys(factors), law, "parameters.bounds")
        same = (design["lower"], design["upper"])
        bounds = {name: asked["bounds"].get(name, same) for name in factors}
        return cls(zones, law, factors, bounds)

    # ------------------------------------------------------------------- kept beside results

    def spec(self) -> dict:
        """Plain values from which `from_spec` makes the same parameterisation."""
        return {
            "zones": {zone: list(segments) for zone, segments in self.zones.items()},
            "law": self.law,
            "factors": list(self.factors),
            "bounds": {name: list(pair) for name, pair in self.bounds.items()},
        }

    @classmethod
    def from_spec(cls, spec: Mapping) -> "Parameterisation":
        """What `spec` describes."""
        return cls(**spec)

    # ------------------------------------------------------------------------ the parameters

    def __len__(self) -> int:
        return len(self._parameters)

    def __getitem__(self, at):
        return self._parameters[at]

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self._parameters)

    def __eq__(self, other) -> bool:
        return isinstance(other, Parameterisation) and self.spec() == other.spec()

    def __hash__(self) -> int:
        return hash((self.law, self.names))

    def __repr__(self) -> str:
        return f"Parameterisation({', '.join(self.names)})"

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names (P) of theta, such as `C_a_anterior`: the columns of every table."""
        return tuple(p.name for p in self)

    @cached_property
    def lower(self) -> np.ndarray:
        """Lower bounds (P,)."""
        return np.array([p.lower for p in self])

    @cached_property
    def upper(self) -> np.ndarray:
        """Upper bounds (P,)."""
        return np.array([p.upper for p in self])

    @cached_property
    def middle(self) -> np.ndarray:
        """Geometric means (P,) of the bounds."""
        return np.sqrt(self.lower * self.upper)

    @cached_property
    def coordinates(self) -> Coordinates:
        """Their logarithms, a block for each zone."""
        scales = (Logarithmic(),) * len(self)
        softness = tuple(range(len(self)))
        return Coordinates(self.names, scales, self.lower, self.upper, self.blocks, softness)

    @cached_property
    def scales_stress(self) -> np.ndarray:
        """Mask (P,) of the parameters that all stresses of their zone are proportional to."""
        return np.array([p.scales_stress for p in self])

    # ----------------------------------------------------------------------- zones and factors

    @property
    def zone_names(self) -> tuple[str, ...]:
        return tuple(self.zones)

    @cached_property
    def segment_zone(self) -> np.ndarray:
        """Index (17,) among the zones of AHA segment number i + 1."""
        zone = np.empty(len(aha.SEGMENTS), dtype=int)
        for index, segments in enumerate(self.zones.values()):
            zone[np.array(segments) - 1] = index
        return zone

    def zone_of(self, segment: int) -> str:
        """Name of the zone of an AHA segment (1-17)."""
        return self.zone_names[self.segment_zone[segment - 1]]

    @cached_property
    def colours(self) -> dict[str, str]:
        """Zone -> colour: the paper's for its zones, the Okabe-Ito palette for others."""
        if set(self.zones) <= set(COLOURS):
            return {zone: COLOURS[zone] for zone in self.zones}
        return {z: MORE_COLOURS[i % len(MORE_COLOURS)] for i, z in enumerate(self.zones)}

    def of_zone(self, zone: str) -> slice:
        """Places in theta of one zone's factors."""
        first = self.zone_names.index(zone) * len(self.factors)
        return slice(first, first + len(self.factors))

    def of_factor(self, factor: str) -> np.ndarray:
        """Mask (P,) of one factor's parameters, a zone each."""
        return np.array([p.factor == factor for p in self])

    @property
    def blocks(self) -> list[slice]:
        """Places in theta of the zones' factors, zone by zone."""
        return [self.of_zone(zone) for zone in self.zones]

    def table(self, theta: np.ndarray) -> np.ndarray:
        """Theta (..., P) by zone and factor, (..., Z, F)."""
        return np.asarray(theta).reshape(*np.shape(theta)[:-1], len(self.zones), len(self.factors))

    def vector(self, values: Mapping[str, float], absent: float = 1.0) -> np.ndarray:
        """Theta (P,) of values by name; `absent` for names that are not given."""
        return np.array([values.get(name, absent) for name in self.names], dtype=float)


def from_spec(spec: Mapping) -> Parameterisation | Coordinates:
    """What a `spec` of either describes."""
    return (Parameterisation if "law" in spec else Coordinates).from_spec(spec)


def label(name: str) -> str:
    """`C_a_anterior` as figures show it, with the factor as mathematics."""
    parts = name.split("_", 2)
    if len(parts) < 3:
        return name
    return f"${parts[0]}_{{{parts[1]}}}$ {parts[2].replace('_', ' ')}"


def repeated(theta: np.ndarray) -> tuple[int, int] | None:
    """Numbers of the first two rows of theta (N, P) that are the same; None if there are none."""
    _, first, which = np.unique(theta, axis=0, return_index=True, return_inverse=True)
    later = np.flatnonzero(first[which.ravel()] != np.arange(len(theta)))
    return (int(first[which.ravel()[later[0]]]), int(later[0])) if later.size else None


def _check_zones(zones: dict[str, tuple[int, ...]]) -> None:
    owner: dict[int, str] = {}
    for zone, segments in zones.items():
        key = f"parameters.zones.{zone}"
        if zone == "all":
            raise InputError(f"{key}: stands for all zones in tables; give the zone another name")
        if not segments:
            raise InputError(f"{key}: holds no segment; give AHA segments (1 to 17) or remove it")
        for segment in segments:
            if not 1 <= segment <= len(aha.SEGMENTS):
                raise InputError(f"{key}: {segment} is no AHA segment; use numbers from 1 to 17")
            if segment in owner:
                raise InputError(
                    f"{key}: segment {segment} belongs to {owner[segment]} already; name every "
                    "segment in one zone only"
                )
            owner[segment] = zone
    missing = [s.number for s in aha.SEGMENTS if s.number not in owner]
    if missing:
        raise InputError(
            f"parameters.zones: no zone holds segment {', '.join(map(str, missing))}; add what is "
            "missing to one of them"
        )


def _check_factors(factors, offered, law, key="parameters.factors") -> None:
    unknown = [name for name in factors if name not in offered]
    if unknown:
        raise InputError(
            f"{key}: {', '.join(unknown)} is not inferred of the law {law}; choose among "
            f"{', '.join(offered)}"
        )
    if not offered or len(set(factors)) < len(factors):
        raise InputError(f"{key}: {list(factors)} names a factor twice or none; name each once")


def _interval(name: str, bounds: Mapping[str, Sequence[float]]) -> tuple[float, float]:
    lower, upper = (float(value) for value in bounds[name])
    if not 0 < lower < upper:
        raise InputError(
            f"parameters.bounds.{name}: [{lower:g}, {upper:g}] is no interval above zero; give the "
            "lower bound first"
        )
    return lower, upper
