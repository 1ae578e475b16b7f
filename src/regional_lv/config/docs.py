"""What there is to say of every key: for config/README.md, messages and tests."""

import functools
import math
import typing
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import yaml
from pydantic.fields import FieldInfo

from regional_lv.config.section import (
    Section,
    alternatives,
    choices,
    is_section,
    key_path,
    note,
    text_of,
)
from regional_lv.config.study import Configuration

MARK = "<!-- The tables below are written from the sections by `make format`. -->\n"
"""Line of config/README.md after which everything is generated."""


class Key(NamedTuple):
    """A key that holds a value; names that the user chooses appear in its path as `<name>`.

    default: as YAML; "required" or "none" where there is no default.
    """

    path: str
    unit: str
    default: str
    text: str
    reruns: str


@functools.cache
def describe() -> list[Key]:
    """Every key that holds a value, in the order of the sections."""
    keys: dict[str, Key] = {}
    for key in _keys(Configuration, "", ""):
        same = keys.get(key.path, key)  # of another kind of the section
        keys[key.path] = key if same == key else key._replace(text=f"{same.text} {key.text}")
    return list(keys.values())


def _keys(
    section: type[Section], path: str, reruns: str, when: str = "", kinds: Sequence = ()
) -> Iterator[Key]:
    """The keys of a section; of one of several `kinds`, those that not all have.

    when: begins their text, and says when the section is there."""
    reruns = section.reruns or reruns
    for name, field in section.model_fields.items():
        text = text_of(section, name)
        if kinds and name in kinds[0].family.model_fields:
            continue
        if kinds:
            same = [k for k in kinds if name in k.model_fields and text_of(k, name) == text]
            when = f"With {' or '.join(f'`{k.tag}: {k.tags()[0]}`' for k in same)}: "
        yield from _key(name, field, text, path, reruns, when)
    for annotation in section.of_added():
        field = FieldInfo.from_annotation(annotation)
        yield from _key("<name>", field, field.description or "", path, reruns, when)


def _key(
    name: str, field: FieldInfo, text: str, path: str, reruns: str, when: str
) -> Iterator[Key]:
    path, reruns = key_path(path, name), note(field, "reruns") or reruns
    kinds = alternatives(field.annotation)
    if len(kinds) == 1 and typing.get_origin(kinds[0]) is dict:
        value = FieldInfo.from_annotation(typing.get_args(kinds[0])[1])
        value.metadata += field.metadata
        yield from _key("<name>", value, value.description or text, path, reruns, when)
    elif len(kinds) == 1 and is_section(kinds[0]):
        yield from _keys(kinds[0], path, reruns, when)
    elif all(map(is_section, kinds)):
        family = kinds[0].family
        yield from _keys(family, path, reruns)
        for kind in kinds:
            yield from _keys(kind, path, family.reruns or reruns, kinds=kinds)
    else:
        yield Key(
            path, _unit(name, field), _default(name, field), when + _meaning(text, kinds), reruns
        )


def _unit(name: str, field: FieldInfo) -> str:
    """What the key's name ends with, or a note says."""
    units = {"kpa_per_mm": "kPa/mm", "mm": "mm", "deg": "deg", "mmhg": "mmHg", "kpa": "kPa"}
    ends = (unit for end, unit in (units | {"ml": "mL"}).items() if name.endswith(f"_{end}"))
    return note(field, "unit") or next(ends, "")


def _default(name: str, field: FieldInfo) -> str:
    if field.is_required():
        return "none" if name == "<name>" else "required"
    text = yaml.safe_dump(field.default, default_flow_style=True, width=math.inf)
    return f"`{text.splitlines()[0]}`"


def _meaning(text: str, kinds: list) -> str:
    """The text, with the choices where it does not name them itself."""
    offered = choices(kinds)
    missing = [choice for choice in offered if f"`{choice}`" not in text]
    return f"{text} One of {', '.join(f'`{c}`' for c in offered)}." if missing else text


def document() -> str:
    """Markdown tables of all keys, one per section."""
    sections: dict[str, list[Key]] = {}
    for key in describe():
        sections.setdefault(key.path.split(".")[0] if "." in key.path else "", []).append(key)
    lines = []
    for section, keys in sections.items():
        if section:
            field = Configuration.model_fields[section]
            kind = alternatives(field.annotation)[0]
            kind = getattr(kind, "family", kind)
            text = text_of(Configuration, section) or kind.__doc__
            lines += [f"## `{section}`", "", " ".join(text.split()), ""]
        lines += ["| key | unit | default | meaning | reruns when changed |", "|---" * 5 + "|"]
        lines += [
            f"| `{key.path}` | {key.unit} | {key.default} | {key.text} | {key.reruns} |"
            for key in keys
        ]
        lines.append("")
    return "\n".join(lines)


def write(readme: Path) -> None:
    """Rewrite what follows `MARK` in config/README.md."""
    head = readme.read_text().split(MARK)[0]
    readme.write_text(f"{head}{MARK}\n{document()}")
