"""What YAML files, the command line and Python hold, before it is known whether they are keys."""

import functools
import math
import reprlib
from collections.abc import Iterable, Mapping
from pathlib import Path

import yaml

from regional_lv.config import yaml_core
from regional_lv.config.section import key_path
from regional_lv.errors import InputError
from regional_lv.input_files import read_text, reading

LONGEST_NAME, LONGEST_TEXT = 100, 4000
"""Characters that a key and any other text may have."""

MOST_ENTRIES, MOST_DEPTH = 100_000, 20
"""Values that a configuration may hold, and sections in one another."""


def read(path: str | Path) -> dict:
    """What a YAML file of keys holds. Raises InputError."""
    text = read_text(path, most_mb=1)
    with reading(path, "correct what the parser names"):
        try:
            content = yaml_core.parse(text)
        except yaml.YAMLError as error:
            raise InputError(_not_yaml(path, error)) from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds no keys; write at least `study: <name>`")
    return content


def _not_yaml(path: str | Path, error: yaml.YAMLError) -> str:
    """In one line, by the line of the file."""
    problem, mark = getattr(error, "problem", None), getattr(error, "problem_mark", None)
    if not problem or mark is None:
        return f"{path}: not valid YAML; correct what the parser names: {str(error)[:1000]}"
    remedy = "indent with spaces" if "\\t" in problem else "correct what the parser names there"
    return f"{path}, line {mark.line + 1}: not valid YAML ({problem[:500]}); {remedy}"


def gather(files: Iterable[str | Path], given: Mapping) -> dict:
    """The keys of several files, of which the last one counts first, and on top of them those of
    the command line, as Snakemake hands them over (`given`). Raises InputError.

    Entries of `synthetic_subjects` that `subjects` does not name are left out, but for those of the
    last file: they are of another study, which may have other zones, factors or bounds.

    Snakemake's own reading of the files is not used: it follows YAML 1.1 (`yaml_core`), and keeps
    numbers inside a section of the command line as text.
    """
    layers = [*map(read, files), {k: _typed(v) for k, v in given.items()}]
    config = functools.reduce(merged, layers)
    named, entries = config.get("subjects"), config.get("synthetic_subjects")
    if isinstance(named, dict) and isinstance(entries, dict):
        own = functools.reduce(merged, layers[-2:]).get("synthetic_subjects") or {}
        config["synthetic_subjects"] = {
            name: entry for name, entry in entries.items() if name in named or name in own
        }
    return config


def merged(below: Mapping, above: Mapping) -> dict:
    """The keys of both, `above` first: sections are joined, but for an empty one, which takes the
    one below away, and other values replaced; so is what is said of an input where `above` gives it
    a role, since other keys go with other roles."""
    both = dict(below)
    for key, value in above.items():
        sections = isinstance(value, dict) and isinstance(below.get(key), dict)
        joins = sections and value and "role" not in value
        both[key] = merged(below[key], value) if joins else value
    return both


def _typed(value):
    if isinstance(value, Mapping):
        return {key: _typed(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_typed(item) for item in value]
    return yaml_core.value_of(value) if isinstance(value, str) else value


def usable(source: str, config: dict) -> dict:
    """A copy whose keys are text, as they are in a file; what Python hands over may have others.

    Raises InputError for what no key of a study may hold: other things than text, finite numbers of
    64 bits, lists and sections, text of several lines, and more than a study can have, such as
    aliases (`*name`) that stand for each other.
    """
    complaints: list[str] = []
    entries = 0

    def copied(value, key: str, depth: int):
        nonlocal entries
        entries += 1
        if entries > MOST_ENTRIES or depth > MOST_DEPTH:
            aliases = "write out what aliases (`*name`) stand for, or remove them"
            refuse(source, [*complaints, f"{key}: holds too much, or itself; {aliases}"])
        if isinstance(value, dict):
            section = {}
            for name, item in value.items():
                at = key_path(key, _shown(name))
                complaint = _unusable_text(str(name), LONGEST_NAME) if name != "" else "is no name"
                if complaint:
                    complaints.append(f"{at}: {complaint}; rename this key")
                elif str(name) in section:
                    complaints.append(f"{at}: occurs twice; remove one of the two")
                else:
                    section[str(name)] = copied(item, at, depth + 1)
            return section
        if isinstance(value, list):
            return [copied(item, f"{key}.{i}", depth + 1) for i, item in enumerate(value)]
        if isinstance(value, str):
            complaint = _unusable_text(value, LONGEST_TEXT)
        elif value is None or isinstance(value, bool):
            complaint = ""
        elif not isinstance(value, int | float):
            complaint = f"{_shown(value)} is neither text, a number, a list nor a section"
        elif not -(2**63) <= value < 2**63 and isinstance(value, int):
            complaint = "the number is too large"
        else:
            complaint = "" if math.isfinite(value) else f"{value} is not a finite number"
        if complaint:
            complaints.append(f"{key}: {complaint}; correct it, or leave it out for the default")
        return value

    plain = copied(config, "", 0)
    refuse(source, complaints)
    return plain


def _unusable_text(text: str, longest: int) -> str:
    if len(text) > longest:
        return f"has {len(text)} characters, and at most {longest} are possible"
    return "" if text.isprintable() else f"{text!r} holds line breaks or other control characters"


def _shown(value) -> str:
    """A value in a message, on one line and short."""
    return reprlib.repr(value).strip("'")


def refuse(source: str, lines: list[str]) -> None:
    """Raise InputError with the lines, each once, if there are any."""
    if lines:
        raise InputError("\n".join(f"{source}: {line}" for line in dict.fromkeys(lines)))
