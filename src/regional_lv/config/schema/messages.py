"""What to say of a configuration that the schema refuses: which key is wrong, and the remedy."""

import difflib
import math
import re
from collections.abc import Iterator

import jsonschema

from regional_lv.config.schema import load_schema
from regional_lv.config.schema.keys import choice_text, describe, key_path, section_schema
from regional_lv.csv_lines import number_in

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


def is_asked_for(error: jsonschema.ValidationError) -> bool:
    """Whether it is about a key that stands empty so that it is filled in."""
    return error.instance is None and "if_empty" in error.schema


def explain(error: jsonschema.ValidationError) -> Iterator[str]:
    """Lines that say which key is wrong, and the remedy."""
    key = ".".join(str(part) for part in error.absolute_path)
    if error.validator == "additionalProperties":
        patterns = error.schema.get("patternProperties", {})
        for name in set(error.instance) - set(error.schema.get("properties", {})):
            if not any(re.search(pattern, name) for pattern in patterns):
                yield explain_unknown(error.schema, key, name)
    elif _is_unknown_name(error):
        section, name = error.absolute_path
        yield explain_unknown(section_schema(section), section, name)
    elif error.validator == "required":
        missing = [name for name in error.validator_value if name not in error.instance]
        yield f"{key or 'the whole file'}: missing {', '.join(missing)}; add what is missing"
    else:
        description = error.schema.get("description", "")
        yield f"{key or 'the whole file'}: {_complaint(error)}. {description}".rstrip()


def _is_unknown_name(error: jsonschema.ValidationError) -> bool:
    """Whether it is about a key of a section that plugins add to, and cannot be one of theirs."""
    section, *inner = error.absolute_path or [""]
    schema = load_schema()["properties"].get(section, {})
    further = isinstance(schema.get("additionalProperties"), dict)
    return further and len(inner) == 1 and inner[0] not in schema["properties"]


def explain_unknown(schema: dict, key: str, name: str) -> str:
    """The line about `name`, which the section `key` with this `schema` does not have."""
    if key_path(key, name) in MOVED:
        return f"{key_path(key, name)}: has moved; use {MOVED[key_path(key, name)]}"
    here = list(schema.get("properties", {}))
    if "patternProperties" in schema:
        remedy = "use letters, digits and underscores, and begin with a letter"
        return f"{key_path(key, name)}: not a usable name; {schema.get('names', remedy)}"
    if not here:
        return f"{key_path(key, name)}: unknown key. {schema['description']} Leave it empty: {{}}"
    elsewhere = {path.rsplit(".", 1)[-1]: path for path, _ in describe()}
    if name in elsewhere:
        return f"{key_path(key, name)}: unknown key here; did you mean `{elsewhere[name]}`?"
    close = difflib.get_close_matches(name, here, n=1, cutoff=0.5)
    if close:
        return f"{key_path(key, name)}: unknown key; did you mean `{key_path(key, close[0])}`?"
    close = difflib.get_close_matches(name, elsewhere, n=1, cutoff=0.75)
    hint = f"did you mean `{elsewhere[close[0]]}`? " if close else ""
    return f"{key_path(key, name)}: unknown key; {hint}allowed here: {', '.join(here)}"


def _repr(value) -> str:
    """`repr` without the middle of what is long."""
    text = repr(value)
    return text if len(text) <= 300 else f"{text[:200]} ... {text[-50:]}"


def _complaint(error: jsonschema.ValidationError) -> str:
    value, limit = error.instance, error.validator_value
    if is_asked_for(error):
        return f"empty; {error.schema['if_empty']}"
    if error.validator == "type":
        given = "an empty value" if value is None else _repr(value)
        return f"{given} is not {_type_name(limit)}{_number_hint(value, limit)}"
    if error.validator == "enum":
        close = difflib.get_close_matches(str(value), [str(v) for v in limit], n=1)
        hint = f"; did you mean {close[0]}?" if close else ""
        offered = ", ".join(map(choice_text, limit))
        return f"{_repr(value)} is not offered; choose one of {offered}{hint}"
    if error.validator == "anyOf":
        return f"{_repr(value)} is neither `all` nor {_alternative(limit)}; give one of them"
    if error.validator == "pattern" and "remedy" in error.schema:
        return f"{_repr(value)} is not possible; {error.schema['remedy']}"
    if error.validator in ("minItems", "maxItems") and limit > 1:
        return f"{_repr(value)} holds {len(value)} values; give {limit}"
    words = {
        "maxLength": f"{_repr(value)} has more than {limit} characters; shorten it",
        "minimum": f"{_repr(value)} is too small; give at least {limit}",
        "exclusiveMinimum": f"{_repr(value)} is too small; give more than {limit}",
        "maximum": f"{_repr(value)} is too large; give at most {limit}",
        "exclusiveMaximum": f"{_repr(value)} is too large; give less than {limit}",
        "minItems": "the list is empty; name at least one",
        "uniqueItems": f"{_repr(value)} names something twice; remove the repetition",
        "pattern": f"{_repr(value)} is not a usable name; use letters, digits and underscores, and "
        "begin with a letter",
    }
    return words[error.validator]


def _alternative(entries: list[dict]) -> str:
    """What may stand instead of `all`."""
    other = next(entry for entry in entries if "type" in entry)
    return "a list of names" if other["type"] == "array" else "a whole number above zero"


def _type_name(types: str | list[str]) -> str:
    names = {
        "object": "a section (keys with values)",
        "array": "a list",
        "string": "text",
        "integer": "a whole number",
        "number": "a number",
        "boolean": "true or false",
        "null": "null",
    }
    return " or ".join(names[t] for t in ([types] if isinstance(types, str) else types))


def _number_hint(value, types: str | list[str]) -> str:
    """Numbers in quotes are text, and so are those with `_` or signs of typography."""
    if not isinstance(value, str) or not {"number", "integer"} & set(
        [types] if isinstance(types, str) else types
    ):
        return "; give that instead"
    number = number_in(value.replace("_", ""))
    if math.isnan(number):
        return "; give the number alone, without a unit and with a decimal point"
    return f"; write it as {number:.15g}, without quotes"
