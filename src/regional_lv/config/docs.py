"""What there is to say of every key: for config/README.md, messages and tests."""

import dataclasses
import functools
import math
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml
from pydantic.fields import FieldInfo

from regional_lv.config.section import (
    Kind,
    Section,
    alternatives,
    is_section,
    key_path,
    note,
    unit_of,
)
from regional_lv.config.study import Configuration

MARK = "<!-- The tables below are written from the sections by `make format`. -->\n"
"""Line of config/README.md after which everything is generated."""


@dataclass(frozen=True)
class Key:
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
    for key in _keys(Configuration, Key("", "", "", "", "")):
        same = keys.get(key.path)  # of another kind of the section
        keys[key.path] = dataclasses.replace(key, text=f"{same.text} {key.text}") if same else key
    return list(keys.values())


def _keys(section: type[Section], around: Key) -> Iterator[Key]:
    """The keys of a section; `around` has its path and reruns, and as text when it is there."""
    around = dataclasses.replace(around, reruns=section.reruns or around.reruns)
    for name, field in section.model_fields.items():
        yield from _key(name, field, field.annotation, around)
    for annotation in section.of_added():
        field = FieldInfo.from_annotation(annotation)
        yield from _key("<name>", field, field.annotation, around)


def _key(name: str, field: FieldInfo, annotation, around: Key) -> Iterator[Key]:
    path = key_path(around.path, name)
    here = dataclasses.replace(around, path=path, reruns=note(field, "reruns") or around.reruns)
    kinds = alternatives(annotation)
    if typing.get_origin(kinds[0]) is dict and len(kinds) == 1:
        value = FieldInfo.from_annotation(typing.get_args(kinds[0])[1])
        value.metadata += field.metadata
        value.description = value.description or field.description
        yield from _key("<name>", value, value.annotation, here)
    elif not all(map(is_section, kinds)):
        text = around.text + _meaning(field, kinds)
        yield Key(path, unit_of(name, field), _default(name, field), text, here.reruns)
    elif len(kinds) == 1:
        yield from _keys(kinds[0], here)
    else:
        yield from _keys_of_kinds(kinds, here)


def _keys_of_kinds(kinds: list[type[Kind]], around: Key) -> Iterator[Key]:
    """The keys that all kinds have, and those that some have."""
    family = kinds[0].family
    yield from _keys(family, around)
    of: dict[tuple, list[type[Kind]]] = {}
    for kind in kinds:
        for name, field in kind.model_fields.items():
            if name not in family.model_fields:
                of.setdefault((name, field.description), []).append(kind)
    around = dataclasses.replace(around, reruns=family.reruns or around.reruns)
    for (name, _), having in of.items():
        field = having[0].model_fields[name]
        tags = [tag for kind in having for tag in kind.tags()]
        when = f"With `{family.tag}: {'` or `'.join(tags)}`: "
        yield from _key(name, field, field.annotation, dataclasses.replace(around, text=when))


def _default(name: str, field: FieldInfo) -> str:
    if name == "<name>":
        return "none"
    if field.is_required():
        return "required"
    text = yaml.safe_dump(field.default, default_flow_style=True, width=math.inf)
    return f"`{text.splitlines()[0]}`"


def choices(kinds: list) -> list:
    """What a key of these types offers."""
    literal = typing.Literal
    offered = [c for k in kinds if typing.get_origin(k) is literal for c in typing.get_args(k)]
    return [*offered, *["null"] * (type(None) in kinds)] if offered else []


def _meaning(field: FieldInfo, kinds: list) -> str:
    """Description, with the choices where it does not name them itself."""
    text, offered = " ".join((field.description or "").split()), choices(kinds)
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
            kind = kind.family if is_section(kind) and issubclass(kind, Kind) else kind
            text = field.description or kind.__doc__
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
