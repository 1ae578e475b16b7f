"""What to say of a configuration that is refused: which key is wrong, and the remedy."""

import math
import typing
from collections.abc import Sequence
from typing import Any

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from regional_lv.config.docs import describe
from regional_lv.config.section import (
    Kind,
    Note,
    Section,
    alternatives,
    choices,
    is_section,
    key_path,
    note,
    offers,
    shown,
    text_of,
)
from regional_lv.config.study import Configuration, sections_of
from regional_lv.csv_lines import number_in
from regional_lv.errors import closest

MOVED = {
    **{
        f"material.{name}": f"`material.constants.{name}`"
        for name in ("a_kpa", "b", "a_f_kpa", "b_f", "a_s_kpa", "b_s", "a_fs_kpa", "b_fs")
    },
    "material.factor_a": "`material.reference.C_a`",
    "material.factor_b": "`material.reference.C_b`",
    "material.anisotropy": "`material.constants.a_f_kpa`, the law's value times this factor",
    "loading.base": "`supports.base`, each component by itself (radial, axial, circumferential)",
    "loading.base_spring_kpa_per_mm": "`supports.base.radial`, one over the stiffness",
    "loading.basal_compliance_mm_per_kpa": "`supports.base.radial`",
    "loading.epicardial_spring_kpa_per_mm": "`supports.epicardium_kpa_per_mm`",
    "observables.region": "`observables.layer`, such as [0.0, 0.333] for the endocardial third",
    "observables.endocardial_share": "`observables.layer`, such as [0.0, 0.333]",
    "observables.nominal_share": "`observables.strain_exponent`; 1 is nominal strain",
    **{
        f"criticism.benchmark.{name}": "`criticism.benchmark.hearts`"
        for name in ("planted", "injected", "null")
    },
    "criticism.rounds": "`criticism.largest_set`; causes are searched for in sets, not one by one",
    "criticism.leading": "nothing: all sets of causes are fitted",
    "criticism.hypotheses": "`inputs`, such as {septal_load: suspected}, or {causes: suspected}",
    "criticism.anchors": "`all_inputs.simulations`",
    "criticism.mesh": "nothing: causes are simulated on `mesh`",
    "criticism.discretisation": "`all_inputs.finer`",
    "criticism.draws": "nothing: as many draws are taken as are needed",
    "criticism.extends": "nothing: findings hold the model as it is beside the averaged one",
    "all_inputs.largest_set": "`criticism.largest_set`",
}
"""Keys of earlier versions, and what does their work now."""

TYPES = {
    "model": "a section (keys with values)",
    "dict": "a section (keys with values)",
    "list": "a list",
    "string": "text",
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
}

LIMITS = {
    "greater_than": ("too small", "more than", "gt"),
    "greater_than_equal": ("too small", "at least", "ge"),
    "less_than": ("too large", "less than", "lt"),
    "less_than_equal": ("too large", "at most", "le"),
}


def explain(refused: ValidationError) -> list[str]:
    """Lines that say which key is wrong, and the remedy."""
    errors = refused.errors(include_url=False)
    # What a plugin was to add is not known, and would be called wrong.
    errors = [error for error in errors if error["loc"][:1] == ("plugins",)] or errors
    return sorted(filter(None, (_line(error) for error in errors)))


def unknown(study: Configuration) -> list[str]:
    """Lines about keys where plugins add some, and which none has added."""
    return [
        explain_unknown(type(section), path, name)
        for path, section in sections_of(study)
        for name in section.model_extra or ()
        if _is_unknown(type(section), name)
    ]


def _line(error) -> str:
    keys, field, text, kinds, around = _place(error["loc"])
    section, name = key_path(*keys[:-1]), "".join(keys[-1:])
    key = key_path(section, name)
    if error["type"] == "default_factory_not_called":
        return ""  # it follows from what is refused already
    if error["type"] == "value_error":
        return str(error["ctx"]["error"])  # of the library, whose messages name the key
    if error["loc"][-1:] == ("[key]",):
        return f"{key}: not a usable name; {note(field, 'names')}"
    if around is not None and _is_unknown(around, name):
        return explain_unknown(around, section, name)
    if error["type"].startswith("union_tag"):
        family = kinds[-1].family
        key, text = key_path(key, family.tag), text_of(family, family.tag)
        complaint = "missing; give it"
        if family.tag in error["input"]:
            complaint = offers(error["input"][family.tag], family.all_tags())
    else:
        complaint = _complaint(error, field, kinds)
    return f"{key or 'the whole file'}: {complaint}. {text}".rstrip()


def _place(
    location: Sequence[str | int],
) -> tuple[list[str], FieldInfo | None, str, list[Any], type[Section] | None]:
    """The keys of a location without what pydantic puts between them (the kinds of sections, and
    whether a key or its value is meant), the last of them as a field, its text, the types that
    stand there, and the section around the last key."""
    keys: list[str] = []
    kinds: list[Any] = [Configuration]
    field, text, around = None, "", None
    for part in map(str, location):
        sections = [kind for kind in kinds if is_section(kind)]
        if part.startswith("\0") or part == "[key]":
            continue
        if len(sections) > 1:
            kinds = [kind for kind in sections if part in kind.tags()] or sections
            continue
        keys.append(part)
        around = next(iter(sections), None)
        if around is not None:
            field, text = around.model_fields.get(part), text_of(around, part)
            holds = [field.annotation] if field else around.of_added()
        else:
            holds = [typing.get_args(kind)[-1] for kind in kinds if typing.get_args(kind)]
        kinds = [each for annotation in holds for each in alternatives(annotation)]
    return keys, field, text, kinds, around


def _is_unknown(around: type[Section], name: str) -> bool:
    """Whether neither the section nor a plugin has a key of this name."""
    if around.added is None:
        return around.model_config["extra"] == "forbid" and name not in around.model_fields
    return name not in (*around.model_fields, *around.added())


def explain_unknown(section: type[Section], key: str, name: str) -> str:
    """The line about `name`, which the `section` at `key` does not have."""
    path = key_path(key, name)
    if path in MOVED:
        return f"{path}: has moved; use {MOVED[path]}"
    if issubclass(section, Kind) and name in section.absent_defaults():
        kinds = " or ".join(f"`{section.tag}: {tag}`" for tag in section.all_tags(name))
        return f"{path}: only {kinds} has it; write that, or remove it"
    here = list(dict.fromkeys([*section.model_fields, *(section.added() if section.added else ())]))
    path_of = {each.path.rsplit(".", 1)[-1]: each.path for each in describe()}
    if name not in path_of and (close := closest(name, here, cutoff=0.5)):
        return f"{path}: unknown key; did you mean `{key_path(key, close)}`?"
    elsewhere = path_of.get(closest(name, path_of, cutoff=0.75))
    hint = f"did you mean `{elsewhere}`? " if elsewhere else ""
    return f"{path}: unknown key; {hint}allowed here: {', '.join(here)}"


def _complaint(error, field: FieldInfo | None, kinds: list) -> str:
    """What is wrong with a value, and the remedy."""
    kind, given, details = error["type"], error["input"], error.get("ctx", {})
    what, remedy = shown(given), note(field, "remedy")
    if kind == "missing":
        return "missing; give it"
    if kind in LIMITS:
        size, how, limit = LIMITS[kind]
        return f"{what} is {size}; give {how} {details[limit]:g}"
    if kind in ("too_short", "too_long"):
        limit = details.get("min_length") or details["max_length"]
        if limit == 1:
            return "the list is empty; name at least one"
        return f"{what} holds {len(given)} values; give {limit}"
    if kind == "repeated":
        return f"{what} names something twice; remove the repetition"
    if kind == "string_too_long":
        return f"{what} has more than {details['max_length']} characters; shorten it"
    if kind == "string_pattern_mismatch":
        return f"{what} is not a usable name; {Note().names}"
    if remedy:
        return f"{what} is not possible; {remedy}"
    if kind == "literal_error":
        return offers(given, choices(kinds))
    wanted = TYPES[kind.split("_")[0]] + (" or null" if type(None) in kinds else "")
    if given is None and wanted == TYPES["model"]:
        return "holds nothing; give its keys, or remove it for their defaults"
    if given is None and field and not field.is_required():
        return f"{what} is not {wanted}; remove the key for its default, or give that instead"
    return f"{what} is not {wanted}{_number_hint(given, kind)}"


def _number_hint(given, kind: str) -> str:
    """Numbers in quotes are text, and so are those with `_` or signs of typography."""
    if not isinstance(given, str) or not kind.startswith(("int", "float")):
        return "; give that instead"
    number = number_in(given.replace("_", ""))
    if math.isnan(number):
        return "; give the number alone, without a unit and with a decimal point"
    return f"; write it as {number:.15g}, without quotes"
