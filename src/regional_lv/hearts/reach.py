"""Whether the emulator of any heart knows one, and that heart's study within what it knows."""

import copy
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import torch

from regional_lv.aha import LEVELS
from regional_lv.channels import Channels
from regional_lv.data.published import with_published_heart
from regional_lv.emulators.joint_gp import JointGP
from regional_lv.errors import InputError
from regional_lv.geometry import described
from regional_lv.hearts.checks import geometry_of
from regional_lv.hearts.emulator import InputMap, inputs_of
from regional_lv.hearts.file import AnyHeart
from regional_lv.hearts.population import COLUMNS
from regional_lv.hearts.sectors import SAME_DEG, turn_deg
from regional_lv.inputs.base import Input
from regional_lv.inputs.shape import Length
from regional_lv.inputs.space import SECTION, Inputs, Role, sd_key, sections_of
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.units import after_number

REMEDY = "simulate this heart (regional-lv run --own)"
"""What to do about a heart that the emulator does not know."""

COMPARED = ("material", "fibres", "loading", "supports", "observables", "factors")
"""Sections of a model that have to be the emulator's, once the inputs act that it has."""

NOT_COMPARED = {
    ("material", "bulk_modulus_kpa"),
    ("material", "segment_factors"),
    ("loading", "pressure_mmhg"),
    ("loading", "frames"),
    ("observables", "quantities"),
}
"""Keys that stand for inputs, or are compared as what they make."""

SAME = 1e-9
"""Share by which numbers may differ that are the same."""

ROUNDED = 1e-3
"""Logarithm of what figures of a shape may be beyond the learnt range: tables are rounded."""


class OutOfReach(InputError):
    """The emulator of any heart does not know this one; the message says why."""


def by_table(config: Mapping, table: str | Path) -> Mapping:
    """The configuration of a heart from surfaces or a mesh by a segment table, which is written;
    that of another heart as it is. Raises InputError for files that cannot be used."""
    geometry = with_published_heart(config)
    if geometry["source"] == "segments":
        return config
    return {**config, "geometry": described.section_by_table(geometry, table)}


def within_by_table(
    config: Mapping, any_heart: AnyHeart, table: str | Path
) -> tuple[dict, list[str]]:
    """`within` of a heart `by_table`."""
    described = by_table(config, table)
    return within(described, any_heart.emulator, any_heart.known, geometry_of(config))


def within(
    config: Mapping, emulator: JointGP, known: Inputs, made_of: str | None = None
) -> tuple[dict, list[str]]:
    """The study of a heart, with ranges of its inputs cut to what the emulator knows, and what was
    cut, a sentence each.

    config: checked, or what `inputs.space.sections_of` takes of it. known: the emulator's inputs,
    in the model that they are about. made_of: the user's files of the heart, for messages; the
    segment table by default.

    Raises OutOfReach, with the entry and the range, for a heart that it does not know.
    """
    _check_model(config, known)
    made_of = made_of or geometry_of(config)
    inputs = Inputs.from_config(sections_of(config)).simulated
    _check_borders(made_of, known, inputs)
    unknown = set(Channels.from_config(config).names) - set(emulator.outputs)
    if unknown:
        _refuse(f"observables: {min(unknown)} is nothing that the emulator predicts")
    input_map = InputMap(known, inputs)
    there = input_map(torch.as_tensor(inputs.nominal)[None])[0]
    _check_values(known, there, input_map.factor)
    _check_shape(made_of, emulator, known, there, input_map.factor)
    return _cut(config, known, inputs, input_map.factor)


def _refuse(why: str) -> None:
    raise OutOfReach(f"{why}; {REMEDY}")


def _check_model(config: Mapping, known: Inputs) -> None:
    geometry = config["geometry"]
    if geometry["source"] != "segments":
        _refuse(f"geometry.source: {geometry['source']}, and the emulator is of segment tables")
    if geometry["wall_thickness_scale"] != 1:
        _refuse("geometry.wall_thickness_scale: is not 1; give the thickness in the segment table")
    own = StiffnessInputs.from_config(config)
    theirs = StiffnessInputs.from_spec(known.base["parameters"])
    for key in ("law", "zones", "factors"):
        mine, its = getattr(own, key), getattr(theirs, key)
        if mine != its:
            _refuse(f"parameters.{key}: {mine} is not the emulator's {its}")
    model = Inputs.from_config(sections_of(config)).base
    try:
        here = inputs_of(model, known)
    except InputError as error:
        raise OutOfReach(f"{error}; {REMEDY}") from None
    values = [each.value_in(model) for each in here]
    # Of a stiffness nothing is known beforehand.
    there = known.model([1.0 if value is None else value for value in values])
    for section in COMPARED:
        for path in _differing(model[section], there[section], (section,)):
            _refuse(f"{'.'.join(path)}: is not as in the emulator, and none of its inputs")


def _differing(one, other, path: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """Paths at which two sections of a model differ."""
    if path in NOT_COMPARED:
        return
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in dict.fromkeys((*one, *other)):
            yield from _differing(one.get(key), other.get(key), (*path, str(key)))
    elif isinstance(one, str) or one is None or other is None:
        if one != other:
            yield path
    elif np.shape(one) != np.shape(other) or not np.allclose(one, other, rtol=SAME):
        yield path


def _check_borders(made_of: str, known: Inputs, inputs: Inputs) -> None:
    """Raise OutOfReach for zones that begin elsewhere around the axis than the emulator's."""
    table, other = (each.base["geometry"]["table"] for each in (inputs, known))
    _, away = turn_deg(table, other)
    zone_of = StiffnessInputs.from_spec(known.base["parameters"]).zone_of
    for numbers in filter(lambda numbers: len(numbers) > 1, LEVELS.values()):
        # A segment begins where the one that follows in the AHA's numbering ends.
        for s, following in zip(numbers, np.roll(numbers, -1).tolist(), strict=True):
            if zone_of(s) != zone_of(following) and abs(away[s - 1]) > SAME_DEG:
                _refuse(
                    f"{made_of}, segment {s}: the sector begins {away[s - 1]:+.0f} degrees from "
                    f"where the emulator has it, and {SAME_DEG:g} are possible"
                )


def _check_values(known: Inputs, there: torch.Tensor, factor: torch.Tensor) -> None:
    """Raise OutOfReach for a value beyond the emulator's range, whether the study fixes it or not.
    The shape is for `_check_shape`; of a stiffness nothing is known beforehand."""
    for e, each in enumerate(known):
        low, high = float(known.lower[e]), float(known.upper[e])
        within = low - SAME * (high - low) <= there[e] <= high + SAME * (high - low)
        if within or each.nominal is None or each.name in COLUMNS:
            continue
        value, low, high = (float(number / factor[e]) for number in (there[e], low, high))
        _refuse(
            f"{SECTION}.{each.name}: {value:.3g} is outside of {low:.3g} to {high:.3g}"
            f"{after_number(each.unit)}, which the emulator knows at this size and pressure"
        )


def _check_shape(
    made_of: str, emulator: JointGP, known: Inputs, there: torch.Tensor, factor: torch.Tensor
) -> None:
    """Raise OutOfReach for a shape that is unlike all that the emulator has learnt from: a figure
    beyond their range, or all of them farther from their middle, in the normal distribution of
    their logarithms, than any of them is. The figure is named that is least like what the others
    would have it."""
    places = [known.names.index(name) for name in COLUMNS]
    learnt = np.log(emulator.learnt_from[:, places].numpy())
    here = there[places].log().numpy()
    low, high = learnt.min(axis=0), learnt.max(axis=0)
    middle, precision = learnt.mean(axis=0), np.linalg.pinv(np.cov(learnt.T), hermitian=True)
    off, spread = here - middle, learnt - middle
    farthest = np.einsum("ni,ij,nj->n", spread, precision, spread).max()
    beyond = np.maximum(low - here, here - high) - ROUNDED
    if beyond.max() <= 0 and off @ precision @ off <= farthest:
        return
    alone = np.abs(precision @ off) / np.sqrt(precision.diagonal())
    worst = int((beyond if beyond.max() > 0 else alone).argmax())
    size = float(factor[places[worst]])
    value, least, most = (np.exp(each[worst]) / size for each in (here, low, high))
    _refuse(
        f"{made_of}: {COLUMNS[worst]} is {value:.3g}; in hearts of this "
        f"length the emulator knows {least:.3g} to {most:.3g}, together with figures of the other "
        "segments that are like it"
    )


def _cut(
    config: Mapping, known: Inputs, inputs: Inputs, factor: torch.Tensor
) -> tuple[dict, list[str]]:
    """Ranges of the study's inputs cut to the emulator's."""
    places = {name: e for e, name in enumerate(known.names)}
    changed = copy.deepcopy(dict(config))
    bounds, notes = changed["parameters"]["bounds"], {}
    for each, role in zip(inputs, inputs.roles, strict=True):
        if each.name not in places:
            if not each.carries and each.name != Length.name:
                _refuse(f"{SECTION}.{each.name}: the emulator has no such input")
            continue
        e = places[each.name]
        low, high = (float(end / factor[e]) for end in (known.lower[e], known.upper[e]))
        if low <= each.low and each.high <= high:
            continue
        low, high = max(low, each.low), min(high, each.high)
        of = getattr(each, "factor", None)
        if of is not None:
            bounds[of] = [low, high]
        else:
            changed[SECTION][each.name] = _entry(each, role, low, high)
        notes[of or each.name] = (
            f"the range of {of or each.name} is cut to {low:.3g} to {high:.3g}"
            f"{after_number(each.unit)}, beyond which the emulator knows nothing at this size and "
            "pressure"
        )
    return changed, list(notes.values())


def _entry(each: Input, role: Role, low: float, high: float) -> dict:
    """What a configuration says of an input with a role and a range."""
    entry: dict = {"role": role.kind, "range": [low, high]}
    if role.sd is not None:
        entry[sd_key(each.unit)] = role.sd
    return entry | ({} if role.value is None else {"value": role.value})
