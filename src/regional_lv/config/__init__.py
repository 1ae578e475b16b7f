"""The configuration of a study: checked against the schema, defaults filled in.

Keys, units, defaults and limits stand in `schema/config.schema.yaml` and nowhere else. What a
schema cannot say (what fits together, and what is registered) is checked by
`regional_lv.config.checks`.
`python -m regional_lv.config config/README.md` writes the tables of keys in that page.
"""

import copy
import functools
import glob
import math
import os
import reprlib
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import jsonschema
import yaml

from regional_lv.config import yaml_core
from regional_lv.config.checks import check_effects, cross_check, meshes_anew, table_sizes
from regional_lv.config.schema import load_schema
from regional_lv.config.schema.keys import (
    choice_text,
    describe,
    entry_schema,
    key_path,
    section_schema,
)
from regional_lv.config.schema.messages import explain, is_asked_for
from regional_lv.errors import InputError
from regional_lv.input_files import read_text, reading
from regional_lv.inputs.parameters import Parameterisation
from regional_lv.registry import load_plugins

MARK = "<!-- The tables below are written from the schema by `make format`. -->\n"
"""Line of config/README.md after which everything is generated."""

LONGEST_NAME, LONGEST_TEXT = 100, 4000
"""Characters that a key and any other text may have."""

MOST_ENTRIES, MOST_DEPTH = 100_000, 20
"""Values that a configuration may hold, and sections in one another."""


def load(
    config: str | Path | dict, source: str = "config", folders: Sequence[str | Path] = ()
) -> dict:
    """Read, check and complete a configuration.

    Parameters
    ----------
    config: path of a YAML file, or what such files hold (`gather`).
    source: name of the configuration in messages, for a mapping; a path names itself.
    folders: where the files were that the mapping comes from; of a path, its own.

    Returns
    -------
    A new nested dict with every key of the schema; `design.test` is the number of test cases and
    `simulations.holdout` that of the rows held out also where they follow from tables. A relative
    path counts from the folder of the configuration if it leads to a file from there, and from the
    working directory otherwise; what is returned counts from the working directory. The plugins
    that it names are loaded.

    Raises
    ------
    InputError: one line per mistake, each with the key and the remedy; also for a subject's
        measured file or a table of simulations that cannot be used.
    """
    if not isinstance(config, dict):
        source, folders = str(config), [Path(config).parent]
        config = read(config)
    config, schema = _in_full(_usable(source, config)), load_schema()
    errors = list(jsonschema.Draft202012Validator(schema).iter_errors(config))
    empty = [error for error in errors if is_asked_for(error)]
    unfilled = sorted(line for error in empty for line in explain(error))
    if len(empty) < len(errors):
        _raise(source, sorted(line for error in errors for line in explain(error)))
    for error in empty:
        # The defaults serve to find what else is wrong; nothing runs on them.
        _remove(config, error.absolute_path)
    given: dict = _resolve(schema, config, folders)
    try:
        load_plugins(Path(plugin).resolve() for plugin in given.get("plugins", ()))
    except InputError as error:
        _raise(source, [str(error)])
    complete = _complete(schema, given)
    if "inputs" not in given and complete["simulations"]["source"] == "table":
        complete["inputs"] = {}
    if "subjects" not in given:
        complete["subjects"] = _default_subjects(complete)
    _complete_by_registries(complete)
    _complete_holdout(complete)
    if "synthetic_subjects" not in given:
        _carry_over(complete)
        _drop_impossible(complete, named=given.get("subjects", {}))
    _drop_unused(complete)
    _raise(source, [*unfilled, *cross_check(complete)])
    if complete["simulations"]["source"] == "table":
        # The one place that says how many test cases there are.
        complete["design"]["test"] = table_sizes(complete)["test"]
    return complete


def final_emulator(config: dict) -> str:
    """Name of the files of the emulator that subjects, scenarios and figures use."""
    return "final" if config["evaluation"] else config["emulators"]["final"]


def read(path: str | Path) -> dict:
    """What a YAML file of keys holds. Raises InputError."""
    text = read_text(path, most_mb=1)
    with reading(path, "correct what the parser names"):
        try:
            content = yaml_core.parse(text)
        except yaml.YAMLError as error:
            raise InputError(
                f"{path}: not valid YAML; correct what the parser names: {str(error)[:1000]}"
            ) from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds no keys; write at least `study: <name>`")
    return content


def gather(files: Iterable[str | Path], given: Mapping) -> dict:
    """The keys of several files, of which the last one counts first, and on top of them those of
    the command line, as Snakemake hands them over (`given`). Raises InputError.

    Snakemake's own reading of the files is not used: it
    follows YAML 1.1 (`yaml_core`), and keeps numbers inside a section of the command line as text.
    """
    return functools.reduce(merged, [*map(read, files), {k: _typed(v) for k, v in given.items()}])


def merged(below: Mapping, above: Mapping) -> dict:
    """The keys of both, `above` first: sections are joined, other values replaced."""
    both = dict(below)
    for key, value in above.items():
        joins = isinstance(value, dict) and isinstance(below.get(key), dict)
        both[key] = merged(below[key], value) if joins else value
    return both


def _typed(value):
    if isinstance(value, Mapping):
        return {key: _typed(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_typed(item) for item in value]
    return yaml_core.value_of(value) if isinstance(value, str) else value


def _usable(source: str, config: dict) -> dict:
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
            _raise(source, [*complaints, f"{key}: holds too much, or itself; {aliases}"])
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

    usable = copied(config, "", 0)
    _raise(source, complaints)
    return usable


def _in_full(config: dict) -> dict:
    """With a cohort that stands as the word for its hearts as a section."""
    cohort = config.get("cohort")
    return config | {"cohort": {"hearts": cohort}} if isinstance(cohort, str) else config


def _unusable_text(text: str, longest: int) -> str:
    if len(text) > longest:
        return f"has {len(text)} characters, and at most {longest} are possible"
    return "" if text.isprintable() else f"{text!r} holds line breaks or other control characters"


def _shown(value) -> str:
    """A value in a message, on one line and short."""
    return reprlib.repr(value).strip("'")


def _remove(config: dict, path: Sequence[str]) -> None:
    *sections, key = path
    for name in sections:
        config = config[name]
    del config[key]


def _resolve(schema: dict, value, folders: Sequence[str | Path]):
    """`value` with its paths counted from the working directory."""
    if isinstance(value, dict):
        return {
            key: _resolve(entry_schema(schema, key), item, folders) for key, item in value.items()
        }
    if isinstance(value, list):
        return [_resolve(schema.get("items", {}), item, folders) for item in value]
    if schema.get("path") and isinstance(value, str) and not os.path.isabs(value):
        for folder in folders:
            if (Path(folder) / value).is_file():
                return os.path.relpath(Path(folder) / value)
    if schema.get("glob") and isinstance(value, str) and not os.path.isabs(value):
        for folder in folders:
            if glob.glob(os.path.join(glob.escape(str(folder)), value)):
                return os.path.join(glob.escape(os.path.relpath(folder)), value)
    return value


def files_of(config: Mapping, folders: Sequence[str | Path]) -> list[str]:
    """The files that keys of a configuration name and that are there, counted from the working
    directory. folders: where the configuration was."""

    def named(schema: dict, value) -> Iterator[str]:
        if isinstance(value, dict):
            for key, item in value.items():
                yield from named(entry_schema(schema, key), item)
        elif isinstance(value, list):
            for item in value:
                yield from named(schema.get("items", {}), item)
        elif schema.get("path") and isinstance(value, str) and Path(value).is_file():
            yield value

    schema = load_schema()
    return list(dict.fromkeys(named(schema, _resolve(schema, config, folders))))


def _raise(source: str, lines: list[str]) -> None:
    if lines:
        # Several missing keys are several errors of the validator with one and the same line.
        raise InputError("\n".join(f"{source}: {line}" for line in dict.fromkeys(lines)))


def _complete(schema: dict, value):
    """`value` with defaults for absent keys, and numbers in the schema's type."""
    if isinstance(value, dict):
        return {
            key: _complete(entry_schema(schema, key), copy.deepcopy(value.get(key, default)))
            for key, default in (_defaults(schema) | value).items()
        }
    if isinstance(value, list):
        return [_complete(schema.get("items", {}), item) for item in value]
    # 5 and 5.0 must be the same value, or Snakemake sees a change where there is none.
    if "number" in schema.get("type", ()):
        return float(value) if isinstance(value, int) else value
    if isinstance(value, float) and value.is_integer():
        return int(value)
    return value


def _default_subjects(complete: dict) -> dict:
    """Those of a study that names none: its synthetic ones, and the default's volunteer in a study
    with evaluation."""
    entry = entry_schema(section_schema("subjects"), "")
    own = {
        name: _complete(entry, {"source": "synthetic"}) for name in complete["synthetic_subjects"]
    }
    default = complete["subjects"]
    return own | ({"volunteer": default["volunteer"]} if complete["evaluation"] else {})


def _complete_by_registries(config: dict) -> None:
    """Add what a schema does not know of: settings of emulators that plugins add."""
    emulators = config["emulators"]
    for name in emulators["names"]:
        if name not in emulators:
            emulators[name] = _complete(entry_schema(section_schema("emulators"), name), {})


def _complete_holdout(config: dict) -> None:
    """Where tables give the simulations, say how many training rows are held out."""
    simulations = config["simulations"]
    if simulations["source"] == "table" and simulations["holdout"] is None:
        own = "test" in simulations["tables"]
        simulations["holdout"] = 0 if own else config["design"]["test"]


def _carry_over(config: dict) -> None:
    """Give the default subjects, whose theta is in the paper's zones, the zones of the study.

    A zone has the mean of its segments; a factor that the paper's law does not have is 1, but for
    the one that scales all stresses.
    """
    paper = Parameterisation()
    try:
        own = Parameterisation.from_config(config)
    except InputError:
        return  # reported with everything else
    if own.names == paper.names:
        return
    stress = next(p.factor for p in paper if p.stress_power)
    for subject in config["synthetic_subjects"].values():
        given = subject["theta"]
        subject["theta"] = {
            p.name: statistics.mean(
                given.get(f"{stress if p.stress_power else p.factor}_{paper.zone_of(s)}", 1.0)
                for s in own.zones[p.zone]
            )
            for p in own
        }


def _drop_impossible(config: dict, named: Iterable[str]) -> None:
    """Leave out default synthetic subjects that this study cannot have: whose effects are part of
    its model, or for which it cannot mesh its geometry anew. named: subjects that the study asks
    for itself, which stay, to be complained about."""
    again = meshes_anew(config)
    for name, subject in list(config["synthetic_subjects"].items()):
        possible = not list(check_effects(name, subject["effects"], config))
        if name not in named and not (possible and (again or subject["mesh"] == "study")):
            del config["synthetic_subjects"][name]
            config["subjects"].pop(name, None)


def _drop_unused(config: dict) -> None:
    """Leave out synthetic subjects that no subject is of and that this study cannot have: those of
    another configuration, below one with subjects and a heart of its own."""
    for name, subject in list(config["synthetic_subjects"].items()):
        if name in config["subjects"]:
            continue
        impossible = list(check_effects(name, subject["effects"], config))
        if impossible or (subject["mesh"] == "finer" and not meshes_anew(config)):
            del config["synthetic_subjects"][name]


def _defaults(schema: dict) -> dict:
    """Defaults of a section's keys; an absent section is an empty one, with defaults inside."""
    return {
        key: entry.get("default", {})
        for key, entry in schema.get("properties", {}).items()
        if "default" in entry or (entry.get("type") == "object" and "required" not in entry)
    }


# --------------------------------------------------------------------------- documentation


def document() -> str:
    """Markdown tables of all keys, one per section of the schema."""
    sections: dict[str, list[tuple[str, dict]]] = {}
    for path, entry in describe():
        sections.setdefault(path.split(".")[0] if "." in path else "", []).append((path, entry))
    schema, lines = load_schema(), []
    for section, entries in sections.items():
        if section:
            lines += [f"## `{section}`", "", schema["properties"][section]["description"], ""]
        lines += ["| key | unit | default | meaning | reruns when changed |", "|---" * 5 + "|"]
        for path, entry in entries:
            default = "required" if entry["required"] else _default_text(entry)
            unit = entry.get("unit", "")
            lines.append(
                f"| `{path}` | {unit} | {default} | {_meaning(entry)} | {entry['reruns']} |"
            )
        lines.append("")
    return "\n".join(lines)


def _default_text(entry: dict) -> str:
    if "default" not in entry:
        return "none"
    text = yaml.safe_dump(entry["default"], default_flow_style=True, width=math.inf)
    return f"`{text.splitlines()[0]}`"


def _meaning(entry: dict) -> str:
    """Description, with the choices where it does not name them itself."""
    text = entry["description"].strip()
    choices = [choice_text(choice) for choice in entry.get("enum", [])]
    missing = [choice for choice in choices if f"`{choice}`" not in text]
    return f"{text} One of {', '.join(f'`{c}`' for c in choices)}." if missing else text


def main(readme: Path) -> None:
    """Rewrite what follows `MARK` in config/README.md."""
    head = readme.read_text().split(MARK)[0]
    readme.write_text(f"{head}{MARK}\n{document()}")
