"""The inputs that are inferred of every study: factors of the material law in zones of the wall.

One `StiffnessInputs` is made from the configuration and passed to whatever needs it. Its default
is the paper's: five zones, with the factors C_a and C_b of the Holzapfel-Ogden law in each.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from regional_lv import aha
from regional_lv.errors import InputError
from regional_lv.inputs.base import LOGARITHMIC, Input, InputSequence, multiplied
from regional_lv.inputs.coordinates import Coordinates
from regional_lv.mechanics.materials import MATERIALS, Factor

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


SCAR = "focal_scar"
"""Name of the input that multiplies the stiffness of one segment."""


class Stiffness(Input):
    """One factor of the material law in one zone, such as `C_a_anterior`, from `low` to `high`."""

    name = "stiffness"
    is_cause = False
    family = "material"
    changes = "factors"
    roles = ("inferred", "measured", "suspected")  # figures and pages show every one
    scale = LOGARITHMIC
    softens = True
    parameter = "factor of the material law in a zone"
    description = (
        "A zone's muscle is as many times stiffer, or stiffens as many times faster with stretch, "
        "as the reference material. This is what a study looks for: nothing is known of it "
        "beforehand but its range (`design.lower` and `upper`, `parameters.bounds`)."
    )

    def __init__(
        self, law: str, factor: Factor, zone: str, segments: Sequence[int], low: float, high: float
    ):
        self.name, self.zone, self.factor = f"{factor.name}_{zone}", zone, factor.name
        self.low, self.high, self.source = low, high, MATERIALS[law].source
        self.stress_power = int(factor.scales_stress)
        self.segments = tuple(segments)
        if factor.scales_stress:
            self.moves = tuple(f"{SCAR}_{s}" for s in segments)

    @classmethod
    def members(cls, model):
        return tuple(StiffnessInputs.from_spec(model["parameters"]))

    @property
    def words(self):
        return (self.family, Stiffness.name, self.factor)

    @property
    def reference(self):
        return 1.0

    @property
    def field(self):
        return self.factor

    @property
    def block(self):
        return self.zone

    def value_in(self, model):
        return None

    def act(self, model, value):
        factors = model["factors"]
        changed = multiplied(factors[self.factor], [s - 1 for s in self.segments], value)
        return {**model, "factors": {**factors, self.factor: changed}}


class StiffnessInputs(InputSequence[Stiffness]):
    """The stiffness inputs theta, P of them, zone by zone in the order of the zones.

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
        super().__init__(
            Stiffness(law, offered[name], zone, segments, *self.bounds[name])
            for zone, segments in self.zones.items()
            for name in self.factors
        )

    @classmethod
    def from_config(cls, config: Mapping) -> "StiffnessInputs":
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
        """Plain values from which `from_spec` makes the same inputs."""
        return {
            "zones": {zone: list(segments) for zone, segments in self.zones.items()},
            "law": self.law,
            "factors": list(self.factors),
            "bounds": {name: list(pair) for name, pair in self.bounds.items()},
        }

    @classmethod
    def from_spec(cls, spec: Mapping) -> "StiffnessInputs":
        """What `spec` describes."""
        return cls(**spec)

    def __eq__(self, other) -> bool:
        return isinstance(other, StiffnessInputs) and self.spec() == other.spec()

    def __hash__(self) -> int:
        return hash((self.law, self.names))

    @cached_property
    def middle(self) -> np.ndarray:
        """Geometric means (P,) of the bounds."""
        return np.sqrt(self.lower * self.upper)

    @cached_property
    def scales_stress(self) -> np.ndarray:
        """Mask (P,) of the inputs that all stresses of their zone are proportional to."""
        return np.array([each.stress_power == 1 for each in self])

    @property
    def of_paper(self) -> bool:
        """Whether law, factors and zones are the paper's, within whatever bounds."""
        paper = StiffnessInputs()
        return (
            self.law == paper.law
            and self.names == paper.names
            and np.array_equal(self.segment_zone, paper.segment_zone)
        )

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


def from_spec(spec: Mapping) -> StiffnessInputs | Coordinates:
    """What a `spec` of either describes."""
    return (StiffnessInputs if "law" in spec else Coordinates).from_spec(spec)


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
