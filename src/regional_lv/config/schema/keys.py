"""The keys of the schema: what it says of one, and all of them.

A module of its own, so that what needs only the schema (an emulator its settings) does not depend
on how keys are described.
"""

from collections.abc import Iterator

from regional_lv.config.schema import load_schema


def section_schema(name: str) -> dict:
    """The schema of a section. Raises KeyError if there is none of this name."""
    return load_schema()["properties"][name]


def entry_schema(schema: dict, key: str) -> dict:
    """The schema of a section's key, also of one that the user names; {} where there is none."""
    if key in schema.get("properties", {}):
        return schema["properties"][key]
    for entry in schema.get("patternProperties", {}).values():
        return entry
    further = schema.get("additionalProperties")
    return further if isinstance(further, dict) else {}


def describe() -> list[tuple[str, dict]]:
    """Every key that holds a value as (path, entry), in the order of the schema.

    Names that the user chooses appear as `<name>`. `entry` is the schema's, with `reruns` from
    its section where it has none, and `required` (bool).
    """

    def walk(schema: dict, path: str, reruns: str | None) -> Iterator[tuple[str, dict]]:
        named = list(schema.get("patternProperties", {}).values())
        if isinstance(schema.get("additionalProperties"), dict):
            named.append(schema["additionalProperties"])
        for key, entry in [*schema.get("properties", {}).items(), *(("<name>", e) for e in named)]:
            inner = entry.get("reruns", reruns)
            holds = entry.get("properties") or entry.get("patternProperties")
            if entry.get("type") == "object" and holds:
                yield from walk(entry, key_path(path, key), inner)
                continue
            required = key in schema.get("required", [])
            yield key_path(path, key), entry | {"reruns": inner, "required": required}

    return list(walk(load_schema(), "", None))


def key_path(*parts: str) -> str:
    """The names of sections and key as messages write them, with points between; "" is skipped."""
    return ".".join(part for part in parts if part)


def choice_text(value) -> str:
    """A value of an `enum` as YAML writes it."""
    return "null" if value is None else str(value)
