"""The inputs of a study in their order, and the roles that its configuration gives them."""

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from regional_lv.errors import InputError, closest
from regional_lv.inputs.base import ROLES, Input, InputSequence
from regional_lv.inputs.catalogue import INPUTS
from regional_lv.inputs.closed_forms import ClosedForm
from regional_lv.inputs.coordinates import Coordinates
from regional_lv.inputs.model import model_of
from regional_lv.inputs.observation import StrainMeasure
from regional_lv.inputs.physics import SECTIONS
from regional_lv.inputs.scales import Logarithmic
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.units import after_number

log = logging.getLogger(__name__)

GREEN = {"strain_exponent": 2.0}
"""What is observed in a model that does not say."""

SECTION = "inputs"
"""Of the configuration."""


def stencil(here: float, step: float, low: float, high: float) -> list[tuple[float, float]]:
    """Offsets and weights of a first derivative of second order that stays between two ends."""
    if low <= here - step and here + step <= high:
        return [(step, 0.5 / step), (-step, -0.5 / step)]
    side = step if here + step <= high else -step
    return [(0.0, -1.5 / side), (side, 2 / side), (2 * side, -0.5 / side)]


@dataclass(frozen=True)
class Role:
    """What a study does with an input: `kind`, one of `ROLES`; the `sd` (in its unit) of one that
    is measured; `value` in place of the nominal one and `range` in place of the plausible one, if
    the study gives them."""

    kind: str
    sd: float | None = None
    value: float | None = None
    range: tuple[float, float] | None = None


class Inputs(InputSequence[Input]):
    """Inputs of one model.

    Attributes: base, the model of the configuration; roles (K,).

    Parameters
    ----------
    base: a model (`inputs.model`).
    members: the inputs, made for it.
    roles: by name; inferred where none is given.
    """

    def __init__(
        self, base: Mapping, members: Iterable[Input], roles: Mapping[str, Role] | None = None
    ):
        super().__init__(members)
        self.base = base
        given = roles or {}
        self.roles = tuple(given.get(name, Role("inferred")) for name in self.names)

    @classmethod
    def from_config(cls, config: Mapping) -> "Inputs":
        """The inputs of a checked configuration that are not fixed.

        Raises InputError for roles that inputs cannot have, or not together.
        """
        base: Mapping = model_of(config)
        every = catalogue(base)
        roles = roles_of(config[SECTION], every, base)
        for each in every:
            if (limits := roles[each.name].range) is not None:
                each.low, each.high = limits
        free = [each for each in every if roles[each.name].kind != "fixed"]
        _check_closed_forms(free, every)
        return cls(base, free, roles)

    def fixing(self, names: Iterable[str]) -> "Inputs":
        """The same, some of them at their nominal values in every model."""
        roles = dict(zip(self.names, self.roles, strict=True))
        fixed = {name: replace(roles[name], kind="fixed") for name in names}
        return Inputs(self.base, self, roles | fixed)

    def subset(self, kept: Iterable[bool]) -> "Inputs":
        """Those of a mask (K,)."""
        members = [each for each, keep in zip(self, kept, strict=True) if keep]
        return Inputs(self.base, members, dict(zip(self.names, self.roles, strict=True)))

    @cached_property
    def directions(self) -> list[tuple[int, Input]]:
        """Places of the inputs that are directions in others which are there, too."""
        known = {each.name for each in self if each.is_simulated}
        return [
            (k, each)
            for k, each in enumerate(self)
            if each.is_simulated and each.moves and not set(each.moves) - known and each.carries
        ]

    @cached_property
    def are_simulated(self) -> np.ndarray:
        """Mask (K,) of the inputs without closed forms and directions."""
        directions = {k for k, _ in self.directions}
        return np.array(
            [each.is_simulated and k not in directions for k, each in enumerate(self)], dtype=bool
        )

    @cached_property
    def simulated(self) -> "Inputs":
        """Those of `are_simulated`."""
        return self.subset(self.are_simulated)

    def of_role(self, kind: str) -> np.ndarray:
        """Mask (K,) of the inputs of one role."""
        return np.array([role.kind == kind for role in self.roles], dtype=bool)

    @cached_property
    def nominal(self) -> np.ndarray:
        """Values (K,) of the model as it is, or what the study gives in their place."""
        return np.array(
            [
                each.middle if role.value is None else role.value
                for each, role in zip(self, self.roles, strict=True)
            ],
            dtype=float,
        )

    @cached_property
    def reference(self) -> np.ndarray:
        """Values (K,) of the model as it is, its wall that of the reference material."""
        return np.array([each.reference for each in self], dtype=float)

    @cached_property
    def coordinates(self) -> Coordinates:
        """Their scaled coordinates; zones are blocks of their own, other inputs one by family."""
        exponents = [k for k, each in enumerate(self) if isinstance(each, StrainMeasure)]
        return replace(
            super().coordinates,
            exponent=exponents[0] if exponents else None,
            strain_exponent=float(self.base.get("observables", GREEN)["strain_exponent"]),
        )

    def beside(
        self, x: Sequence[float] | np.ndarray, which: Iterable[int]
    ) -> Iterator[tuple[int, list[tuple[Mapping, float]]]]:
        """Of the inputs numbered `which`: number, and models beside x (K,) along its scaled
        coordinate, with the weights of a difference of second order: on either side, or at the end
        of the range on one."""
        here = self.model(x)
        for k in which:
            each = self[k]
            at, low, high = (each.scale(float(v)) for v in (x[k], each.low, each.high))
            step = each.step * (high - low)
            sides = []
            for offset, weight in stencil(at, step, low, high):
                there = np.array(x, dtype=float)
                there[k] = each.scale.inverse(at + offset)
                sides.append((self._with_section(here, each.changes, there), weight))
            yield k, sides

    def _with_section(self, model: Mapping, section: str, x: np.ndarray) -> Mapping:
        """The model with one section as at x (K,): what the inputs that change it make of it."""
        model = {**model, section: self.base[section]}
        for k in self._of_section[section]:
            model = self[k].act(model, float(x[k]))
        return model

    @cached_property
    def _of_section(self) -> dict[str, list[int]]:
        """Numbers of the inputs that change each section."""
        found: dict[str, list[int]] = {}
        for k, each in enumerate(self):
            found.setdefault(each.changes, []).append(k)
        return found

    def model(self, x: Sequence[float] | np.ndarray) -> Mapping:
        """The model at values x (K,)."""
        model = self.base
        for each, value in zip(self, x, strict=True):
            model = each.act(model, float(value))
        return model


def sections_of(config: Mapping) -> dict:
    """What `Inputs.from_config` reads of a configuration, and no more: plain values."""
    return {**model_sections_of(config), SECTION: config[SECTION]}


def sections_of_stiffness(config: Mapping) -> dict:
    """The same with all inputs but the stiffness fixed, as in the paper, whatever standard
    deviations the segment table has."""
    sections = {**model_sections_of(config), SECTION: {}}
    inputs = Inputs.from_config(sections)
    others = inputs.subset(~inputs.of_role("inferred")).names
    return {**sections, SECTION: dict.fromkeys(others, "fixed")}


def model_sections_of(config: Mapping) -> dict:
    """The same without the roles: what `inputs.model.model_of` reads."""
    return {
        **{section: config[section] for section in (*SECTIONS, "geometry", "parameters")},
        "design": {end: config["design"][end] for end in ("lower", "upper")},
    }


def coordinates_of(physics: Mapping) -> Coordinates:
    """Those of the simulator's inputs: of all that `sections_of` describes, or of the parameters
    alone (`physics.physics_of`)."""
    if SECTION in physics:
        return Inputs.from_config(physics).simulated.coordinates
    return StiffnessInputs.from_spec(physics["parameters"]).coordinates


def catalogue(model: Mapping) -> list[Input]:
    """All inputs that a study with this model can have, in the order of `INPUTS`."""
    return [each for kind in INPUTS.values() for each in kind.members(model)]


# ------------------------------------------------------------------------------------- roles


def roles_of(section: Mapping, every: Sequence[Input], model: Mapping) -> dict[str, Role]:
    """Roles by name of `every` input, from the section `inputs` of a configuration.

    A key is the name of an input or a word for several (its class's name, its family), of which
    the narrower one counts. A standard deviation, `sd_<unit>`, goes to those that have this unit.
    What is not named is inferred if it is a stiffness, measured if the segment table has its sd
    (which counts before that of a word, where it is not fixed), and otherwise fixed. Raises
    InputError.
    """
    roles = {each.name: Role("inferred" if each.nominal is None else "fixed") for each in every}
    named = []
    for word, given in section.items():
        asked = {"role": given} if isinstance(given, str) else dict(given)
        named.append((word, asked, _meant(word, asked, every, model)))
    by_table = {each.name: each.known_sd(model) for each in every}
    for word, asked, meant in sorted(named, key=lambda each: len(each[2]), reverse=True):
        for each in meant:
            roles[each.name] = _role(word, asked, each)
    told = {each.name for _, _, meant in named for each in meant}
    for name, sd in by_table.items():
        if sd is not None and name not in section:
            if roles[name].kind == "measured" or name not in told:
                roles[name] = replace(roles[name], kind="measured", sd=sd)
    _check_directions(every, roles)
    return roles


def sd_key(unit: str) -> str:
    """The key of a standard deviation in a unit: `sd_mm`, `sd_kpa_per_mm`, `sd` of a number."""
    words = unit.lower().replace("/", "_per_").removeprefix("1").strip("_")
    return f"sd_{words}" if words else "sd"


def _meant(word: str, asked: dict, every: Sequence[Input], model: Mapping) -> list[Input]:
    """The inputs that a word stands for in the role asked for."""
    kind = asked.get("role")
    if kind not in ROLES:
        raise InputError(
            f"{SECTION}.{word}: {kind!r} is no role; give {', '.join(ROLES[:-1])} or {ROLES[-1]}"
        )
    by_name = [each for each in every if each.name == word]
    by_word = [each for each in every if word in each.words and each not in by_name]
    if not by_name and not by_word:
        if kind == "fixed" and word in INPUTS:
            return []  # what a study does not have stays as it is
        if kind == "measured" and (kind_of := INPUTS.get(word)) and kind_of.why_not(model):
            warn_of_exact_shape(word, kind_of.why_not(model))
            return []
        raise InputError(f"{SECTION}.{word}: {why_unknown(word, every, model)}")
    able = [[each for each in group if kind in each.roles] for group in (by_name, by_word)]
    able = [group for group in able if group]
    if not able:
        possible = ", ".join((by_name or by_word)[0].roles)
        where = ", or name the others in `parameters.factors`" if kind == "fixed" else ""
        raise InputError(f"{SECTION}.{word}: cannot be {kind}; choose among {possible}{where}")
    sds = [key for key in asked if key.startswith("sd")]
    if kind != "measured":
        if sds:
            raise InputError(
                f"{SECTION}.{word}.{sds[0]}: only what is measured has a standard deviation; write "
                "role: measured, or remove it"
            )
        return able[0]
    if len(sds) != 1:
        units = sorted({sd_key(each.unit) for group in able for each in group})
        raise InputError(
            f"{SECTION}.{word}: is measured, with {len(sds) or 'no'} standard deviation"
            f"{'s' if len(sds) > 1 else ''}; give one, {' or '.join(units)}"
        )
    for group in able:
        mine = [each for each in group if sd_key(each.unit) == sds[0]]
        if mine:
            return mine
    units = sorted({sd_key(each.unit) for group in able for each in group})
    raise InputError(
        f"{SECTION}.{word}.{sds[0]}: nothing of this name has that unit; write {' or '.join(units)}"
    )


@cache
def warn_of_exact_shape(word: str, why: str) -> None:
    """Once in a process, however often its inputs are made."""
    log.warning("%s.%s: %s; its shape counts as exact where it is simulated", SECTION, word, why)


def why_unknown(word: str, every: Sequence[Input], model: Mapping) -> str:
    """Why no input of `every` is meant by a word, and the remedy."""
    for kind in INPUTS.values():
        if word in (kind.name, kind.family) or word.startswith(f"{kind.name}_"):
            reason = kind.why_not(model)
            if reason:
                return f"this study has no such input, {reason}; remove it"
    known = dict.fromkeys([e.name for e in every] + [w for e in every for w in e.words])
    close = closest(word, known)
    hint = f"did you mean {close}?" if close else f"choose among {', '.join(INPUTS)}"
    return f"is no input, nor a word for several; {hint}"


def _role(word: str, asked: dict, each: Input) -> Role:
    """The role of one input that `word` stands for."""
    key = f"{SECTION}.{word}"
    value, sd = asked.get("value"), asked.get(sd_key(each.unit))
    limits = asked.get("range")
    limits = None if limits is None else (float(limits[0]), float(limits[1]))
    if asked["role"] == "measured" and value is None and each.nominal is None:
        raise InputError(
            f"{key}: {each.name} has a standard deviation but no nominal value; give its `value`"
        )
    low, high = limits or (each.low, each.high)
    if value is not None and not low <= value <= high:
        raise InputError(
            f"{key}.value: {value:g} is outside the range of {each.name}, {low:g} to "
            f"{high:g}{after_number(each.unit)}; correct it, or give its `range`"
        )
    if asked["role"] == "suspected" and value is None and each.nominal is None:
        raise InputError(
            f"{key}: {each.name} has no value in the model as it is, so it cannot be doubted; give "
            "its `value`, or infer it"
        )
    if asked["role"] == "fixed" and value is None and each.nominal is None:
        raise InputError(f"{key}: {each.name} has no nominal value; give its `value`")
    if sd is not None and not 0 <= sd < np.inf:
        raise InputError(f"{key}: a standard deviation of {sd:g}; give a number of 0 or more")
    if limits is not None:
        _check_range(f"{key}.range", each, *limits, each.nominal if value is None else value)
    kind = "fixed" if sd == 0 else asked["role"]
    if kind not in each.roles:
        raise InputError(f"{key}: {each.name} cannot be {kind}; give a standard deviation above 0")
    if kind == "fixed" and value is not None and each.nominal is not None:
        # The mesh is made, and the stiffness alone simulated, from these sections.
        where = f" (section `{each.changes}`)" if each.changes in (*SECTIONS, "geometry") else ""
        raise InputError(
            f"{key}.value: what is fixed is as other sections have it, {each.name} at "
            f"{each.nominal:g}; change it there{where} and remove `value`, or give "
            f"{each.name} another role"
        )
    return Role(kind, sd or None, value, limits)


def _check_range(key: str, each: Input, low: float, high: float, at: float | None) -> None:
    """Raise InputError for ends that are no range of an input whose value is `at`."""
    if not low < high:
        raise InputError(f"{key}: {low:g} is not below {high:g}; give the lower end first")
    if isinstance(each.scale, Logarithmic) and low <= 0:
        raise InputError(f"{key}: {each.name} is above 0; give a lower end above 0")
    if not each.least <= low < high <= each.most:
        raise InputError(
            f"{key}: {each.name} can be {each.least:g} to {each.most:g} at all, which {low:g} to "
            f"{high:g} goes beyond; narrow the range"
        )
    if at is not None and not low <= at <= high:
        raise InputError(
            f"{key}: {each.name} is {at:g} {each.unit}, which {low:g} to {high:g} leaves out; "
            "widen the range"
        )


def _check_directions(every: Sequence[Input], roles: Mapping[str, Role]) -> None:
    """Raise InputError where inferred inputs move the same thing."""
    for each in every:
        if roles[each.name].kind != "inferred" or not each.moves:
            continue
        parts = [name for name in each.moves if name in roles]
        if len(parts) < len(each.moves) or _has_other_stress(each, every, roles):
            continue
        if all(roles[name].kind == "inferred" for name in parts):
            raise InputError(
                f"{SECTION}.{each.name}: moves the same thing as {_listed(parts)}, and all are "
                f"inferred: no measurement tells them apart; fix {each.name}, or give one of them "
                "another role"
            )


def _has_other_stress(each: Input, every: Sequence[Input], roles: Mapping[str, Role]) -> bool:
    """Whether a closed form moves more than its `moves`: there are springs or other loads."""
    return isinstance(each, ClosedForm) and any(
        each.power(other) and (other.middle != 0 or roles[other.name].kind != "fixed")
        for other in every
        if other.name not in each.moves
    )


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _check_closed_forms(free: Sequence[Input], every: Sequence[Input]) -> None:
    """Raise InputError where a closed form would have to scale an input that is fixed."""
    names = {each.name for each in free}
    for form in free:
        if not isinstance(form, ClosedForm):
            continue
        for other in every:
            if form.power(other) and other.name not in names and other.middle != 0:
                raise InputError(
                    f"{SECTION}.{form.name}: is exact only if {other.name} goes along, which is "
                    f"fixed at {other.middle:g}; give {other.name} another role too"
                )
