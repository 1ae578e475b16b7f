"""What every input is: one number of the simulator, with its range, its scale and its source."""

import math
from abc import ABC
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import ClassVar, Literal, TypeVar, get_args

import numpy as np

from regional_lv.aha import SEGMENTS
from regional_lv.inputs.coordinates import Coordinates, blocks_of
from regional_lv.inputs.keys import value_at, with_value
from regional_lv.inputs.scales import Linear, Logarithmic, Scale

RoleName = Literal["inferred", "measured", "suspected", "fixed"]
ROLES: tuple[RoleName, ...] = get_args(RoleName)
"""What a study does with an input: it has a prior over its range; it is known with a standard
deviation; it is at its nominal value in the model as it is, and free in the models that contain it;
or it is at its nominal value."""


class Input(ABC):
    """One number that the simulator, or what is reported of it, depends on.

    A class stands for one input or for several of one kind (`members`), each an instance. A new
    one is one class and one entry in `INPUTS`, also from a plugin.

    Attributes: name; family, a word for many inputs; parameter, the field's term; unit; nominal,
    the value of the model as it is (None where nothing is known of it beforehand); low and high,
    its plausible range; least and most, what it can be at all; scale, on which a prior is uniform
    and effects are smooth; description and source (literature); roles that it can have; moves, the
    names of other inputs of which it is a direction, so that inferring it with all of them has no
    solution; segments, of the AHA, that it is about, none for what concerns the whole ventricle;
    changes, the section of the model that it changes.

    Values of the dimension of a stress are proportional to stress^stress_power: a ventricle whose
    stresses, loads and springs are all multiplied by one number moves as before. length_power is
    the same of a ventricle that is scaled as a whole.
    """

    name: str
    family: ClassVar[str]
    parameter: str
    unit: str = "1"
    nominal: float | None = None
    low: float
    high: float
    least: ClassVar[float] = -math.inf
    most: ClassVar[float] = math.inf
    scale: Scale = Linear()
    description: str
    source: str
    roles: tuple[str, ...] = ROLES
    moves: tuple[str, ...] = ()
    segments: tuple[int, ...] = ()
    changes: ClassVar[str]
    softens: ClassVar[bool] = False
    """Whether outputs answer more, and errors are larger, where it is small."""
    is_cause: ClassVar[bool] = True
    """Whether the word `causes` of the configuration stands for it, too."""
    step: ClassVar[float] = 1e-6
    """Of the range, in which differences with respect to it are taken."""
    stress_power: int = 0
    length_power: int = 0

    def __init__(self, model: Mapping):
        """The input in a study with this `model`, whose value is the nominal one."""
        self._set_nominal(self.value_in(model))

    def _set_nominal(self, value: float | None) -> None:
        """Take `value` as nominal, in a range that holds it."""
        self.nominal = value
        if value is not None:
            self.low, self.high = min(self.low, value), max(self.high, value)

    @classmethod
    def members(cls, model: Mapping) -> Sequence["Input"]:
        """The inputs of this class in a study with this model, none where it rules them out."""
        return () if cls.why_not(model) else (cls(model),)

    @classmethod
    def why_not(cls, model: Mapping) -> str:
        """Why a study with this model has no such input; empty if it has."""
        return ""

    @property
    def words(self) -> tuple[str, ...]:
        """Words of the configuration for several inputs, this one among them."""
        return (self.family, type(self).name, *(["causes"] if self.is_cause else []))

    @property
    def block(self) -> str:
        """Neighbours of the same block have effects that go together."""
        return self.family

    @property
    def cause(self) -> str:
        """Name of the cause that it is if it is suspected; several inputs can be its places."""
        return self.name

    @property
    def field(self) -> str:
        """Name of what inputs of other segments are about as well: a field over the wall. What
        inputs of one field and segment do adds up, on their scale."""
        return self.cause

    @property
    def place(self) -> str:
        """Of its cause; empty where that has one only."""
        return ""

    def value_in(self, model: Mapping) -> float | None:
        """Its value in a model; None where nothing is known of it beforehand."""
        raise NotImplementedError

    def known_sd(self, model: Mapping) -> float | None:
        """Standard deviation, in its unit, with which the study's own data give it; None where they
        do not say."""
        return None

    def act(self, model: Mapping, value: float) -> Mapping:
        """The model with this input at `value`, which replaces or multiplies what is there; at the
        nominal value as it was. Closed forms change no model."""
        raise NotImplementedError

    carries: ClassVar[bool] = False
    """Whether it is nothing but a change of the inputs in `moves`: `carry` says which."""

    def carry(self, other: "Input", there, value):
        """The value of one of the inputs in `moves`, which is `there` (M,) without it, when this
        input is at `value` (M,), and its derivatives (M,) with respect to both."""
        raise NotImplementedError

    @property
    def is_simulated(self) -> bool:
        """Whether the simulator has it; if not, it is an exact transform of its outputs, or
        concerns the noise alone."""
        return True

    @property
    def middle(self) -> float:
        """Where the model as it is has it; the middle of the range, on the scale, of what is not
        known beforehand."""
        if self.nominal is not None:
            return self.nominal
        return self.scale.inverse((self.scale(self.low) + self.scale(self.high)) / 2)

    @property
    def reference(self) -> float:
        """`middle`, but of the reference material where nothing is known of the wall's."""
        return self.middle


Member = TypeVar("Member", bound=Input)


class InputSequence(Sequence[Member]):
    """Inputs in their order, K of them; vectors have one number each."""

    def __init__(self, members: Iterable[Member]):
        self._members = tuple(members)

    def __len__(self) -> int:
        return len(self._members)

    def __getitem__(self, at):
        return self._members[at]

    def __iter__(self) -> Iterator[Member]:
        return iter(self._members)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self.names)})"

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names (K), such as `C_a_anterior`: columns of tables."""
        return tuple(each.name for each in self)

    @cached_property
    def lower(self) -> np.ndarray:
        """Lower ends (K,) of the ranges."""
        return np.array([each.low for each in self], dtype=float)

    @cached_property
    def upper(self) -> np.ndarray:
        """Upper ends (K,) of the ranges."""
        return np.array([each.high for each in self], dtype=float)

    @cached_property
    def coordinates(self) -> Coordinates:
        """Their scaled coordinates, in the blocks that they name."""
        return Coordinates(
            self.names,
            tuple(each.scale for each in self),
            self.lower,
            self.upper,
            blocks_of([each.block for each in self]),
            tuple(k for k, each in enumerate(self) if each.softens),
            self._fields,
        )

    @property
    def _fields(self) -> dict[str, tuple[tuple[int, ...], ...]]:
        """By field over the wall, of each segment the places of the inputs that are about it."""
        names = dict.fromkeys(each.field for each in self if each.segments)
        return {
            name: tuple(
                tuple(
                    k
                    for k, each in enumerate(self)
                    if each.field == name and segment.number in each.segments
                )
                for segment in SEGMENTS
            )
            for name in names
        }


class KeyInput(Input):
    """The value of one key of the model, at `path`."""

    path: tuple[str, ...]

    def __init_subclass__(cls):
        if "path" in vars(cls):
            cls.changes = cls.path[0]

    @classmethod
    def why_not(cls, model):
        try:
            value_at(model, cls.path)
        except KeyError:
            return f"its configuration has no {'.'.join(cls.path)}"
        return ""

    def value_in(self, model):
        return float(value_at(model, self.path))

    def act(self, model, value):
        return with_value(model, self.path, value)


class AddedInput(Input):
    """A number that is added to keys below one section, with a sign each: `signs`."""

    signs: ClassVar[tuple[tuple[str, int], ...]]

    def value_in(self, model):
        return 0.0

    def act(self, model, value):
        section = dict(model[self.changes])
        for key, sign in self.signs:
            section[key] = section[key] + sign * value
        return {**model, self.changes: section}


class SegmentInput(Input):
    """One of the inputs of a kind that every AHA segment has: `stem`, by default the class's name,
    and the segment's number."""

    stem: ClassVar[str] = ""

    def __init__(self, model, segment: int):
        self.segment, self.segments = segment, (segment,)
        self.name = f"{self.cause}_{segment}"
        self._set_nominal(self.value_in(model))

    @property
    def cause(self):
        return self.stem or type(self).name

    @property
    def place(self):
        return str(self.segment)

    @classmethod
    def members(cls, model):
        return () if cls.why_not(model) else [cls(model, segment) for segment in range(1, 18)]


def multiplied(values: np.ndarray, at, factor: float) -> np.ndarray:
    """A copy of `values` with those `at` some places times `factor`."""
    values = values.copy()
    values[at] *= factor
    return values


LOGARITHMIC = Logarithmic()
