"""The configuration of a study: checked against the schema, defaults filled in.

Keys, units, defaults and limits stand in `workflow/schemas/config.schema.yaml` and nowhere else;
this module adds what a schema cannot say. `python -m regional_lv.config config/README.md` writes
the tables of keys in that page.
"""

import copy
import difflib
import itertools
import math
import re
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path

import jsonschema
import yaml

from regional_lv.criticism.hypotheses import REGISTRY
from regional_lv.errors import InputError
from regional_lv.resources import PUBLISHED, PUBLISHED_HEART, PUBLISHED_ROWS, SLICES_OF_LEVEL
from regional_lv.schema import load_schema

MARK = "<!-- The tables below are written from the schema by `make format`. -->\n"
"""Line of config/README.md after which everything is generated."""

LEAST_ROWS = 12
"""Simulations that every emulator needs: two more than there are parameters."""
RESERVED = {"train", "test", "resimulated", "subjects"}
"""Names that no scenario may have."""


def load(config: str | Path | dict, source: str = "config") -> dict:
    """Read, check and complete a configuration.

    Parameters
    ----------
    config: path of a YAML file, or what such a file holds (as Snakemake hands it over).
    source: name of the configuration in messages, for a mapping; a path names itself.

    Returns
    -------
    A new nested dict with every key of the schema; `design.test` is the number of test cases also
    where they come from a table. Relative paths stay as they are: they count
    from the working directory.

    Raises
    ------
    InputError: one line per mistake, each with the key and the remedy; also for a subject's
        measured file or a table of simulations that cannot be used.
    """
    if not isinstance(config, dict):
        source = str(config)
        config = _read(Path(config))
    config, schema = _with_text_keys(config), load_schema()
    errors = jsonschema.Draft202012Validator(schema).iter_errors(config)
    _raise(source, sorted(line for error in errors for line in _explain(error)))
    complete = _complete(schema, config)
    _raise(source, list(_cross_check(complete)))
    if complete["simulations"]["source"] == "table":
        # The one place that says how many test cases there are.
        complete["design"]["test"] = _table_sizes(complete)["test"]
    return complete


def _read(path: Path) -> dict:
    try:
        content = yaml.safe_load(path.read_text())
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except yaml.YAMLError as error:
        raise InputError(f"{path}: not valid YAML; mend what the parser names: {error}") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds no keys; write at least `study: <name>`")
    return content


def _with_text_keys(value):
    """YAML reads keys such as 1 or no as something else than text."""
    if isinstance(value, dict):
        return {str(key): _with_text_keys(item) for key, item in value.items()}
    return value


def _raise(source: str, lines: list[str]) -> None:
    if lines:
        # Several missing keys are several errors of the validator with one and the same line.
        raise InputError("\n".join(f"{source}: {line}" for line in dict.fromkeys(lines)))


def _complete(schema: dict, value):
    """`value` with defaults for absent keys, and numbers in the schema's type."""
    if schema.get("type") == "object":
        return {
            key: _complete(_entry_schema(schema, key), copy.deepcopy(value.get(key, default)))
            for key, default in (_defaults(schema) | value).items()
        }
    if schema.get("type") == "array":
        return [_complete(schema["items"], item) for item in value]
    # 5 and 5.0 must be the same value, or Snakemake sees a change where there is none.
    if schema.get("type") == "number":
        return float(value)
    if isinstance(value, float) and value.is_integer():
        return int(value)
    return value


def _defaults(schema: dict) -> dict:
    """Defaults of a section's keys; an absent section is an empty one, with defaults inside."""
    return {
        key: entry.get("default", {})
        for key, entry in schema.get("properties", {}).items()
        if "default" in entry or (entry.get("type") == "object" and "required" not in entry)
    }


def _entry_schema(schema: dict, key: str) -> dict:
    if key in schema.get("properties", {}):
        return schema["properties"][key]
    return next(iter(schema["patternProperties"].values()))


# ------------------------------------------------------------------------------- messages


def _explain(error: jsonschema.ValidationError) -> Iterator[str]:
    """Lines that say which key is wrong, and the remedy."""
    key = ".".join(str(part) for part in error.absolute_path)
    if error.validator == "additionalProperties":
        patterns = error.schema.get("patternProperties", {})
        for name in set(error.instance) - set(error.schema.get("properties", {})):
            if not any(re.search(pattern, name) for pattern in patterns):
                yield _explain_unknown(error.schema, key, name)
    elif error.validator == "required":
        missing = [name for name in error.validator_value if name not in error.instance]
        yield f"{key or 'the whole file'}: missing {', '.join(missing)}; add what is missing"
    else:
        description = error.schema.get("description", "")
        yield f"{key or 'the whole file'}: {_complaint(error)}. {description}".rstrip()


def _explain_unknown(schema: dict, key: str, name: str) -> str:
    here = list(schema.get("properties", {}))
    if "patternProperties" in schema:
        remedy = "use letters, digits and underscores, and begin with a letter"
        return f"{_join(key, name)}: not a usable name; {schema.get('names', remedy)}"
    if not here:
        return f"{_join(key, name)}: unknown key. {schema['description']} Leave it empty: {{}}"
    close = difflib.get_close_matches(name, here, n=1, cutoff=0.5)
    if close:
        return f"{_join(key, name)}: unknown key; did you mean `{_join(key, close[0])}`?"
    # A right key in the wrong section is as frequent a slip as a typo.
    elsewhere = {path.rsplit(".", 1)[-1]: path for path, _ in describe()}
    close = difflib.get_close_matches(name, elsewhere, n=1, cutoff=0.75)
    hint = f"did you mean `{elsewhere[close[0]]}`? " if close else ""
    return f"{_join(key, name)}: unknown key; {hint}allowed here: {', '.join(here)}"


def _complaint(error: jsonschema.ValidationError) -> str:
    value, limit = error.instance, error.validator_value
    if error.validator == "type":
        given = "an empty value" if value is None else repr(value)
        return f"{given} is not {_type_name(limit)}{_number_hint(value, limit)}"
    if error.validator == "enum":
        close = difflib.get_close_matches(str(value), [str(v) for v in limit], n=1)
        hint = f"; did you mean {close[0]}?" if close else ""
        return f"{value!r} is not offered; choose one of {', '.join(map(str, limit))}{hint}"
    if error.validator == "anyOf":
        return f"{value!r} is neither `all` nor {_alternative(limit)}; give one of them"
    words = {
        "minimum": f"{value!r} is too small; give at least {limit}",
        "exclusiveMinimum": f"{value!r} is too small; give more than {limit}",
        "maximum": f"{value!r} is too large; give at most {limit}",
        "exclusiveMaximum": f"{value!r} is too large; give less than {limit}",
        "minItems": "the list is empty; name at least one",
        "uniqueItems": f"{value!r} names something twice; remove the repetition",
        "pattern": f"{value!r} is not a usable name; use letters, digits and underscores, and "
        "begin with a letter",
    }
    return words[error.validator]


def _alternative(entries: list[dict]) -> str:
    """What may stand instead of `all`."""
    other = next(entry for entry in entries if "type" in entry)
    if other["type"] == "array":
        return f"a list of {', '.join(_resolved(other['items'])['enum'])}"
    return "a whole number above zero"


def _resolved(entry: dict) -> dict:
    reference = entry.get("$ref", "").removeprefix("#/$defs/")
    return load_schema()["$defs"][reference] if reference else entry


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
    """YAML reads 1e-8 as text; only with a point it is a number."""
    if isinstance(value, str) and types == "number":
        try:
            return f"; write it as {float(value)!r}" if "e" not in value else "; write it as 1.0e-8"
        except ValueError:
            pass
    return "; give that instead"


def _join(*parts: str) -> str:
    return ".".join(part for part in parts if part)


# ---------------------------------------------------------------------------- cross-checks


def _cross_check(config: dict) -> Iterator[str]:
    """Mistakes that only show between keys, or between a key and a file."""
    geometry, design, loading = config["geometry"], config["design"], config["loading"]
    if geometry["epi_apex_z_mm"] >= geometry["endo_apex_z_mm"]:
        yield "geometry.epi_apex_z_mm: must lie below geometry.endo_apex_z_mm; lower it"
    yield from _check_geometry_files(geometry)
    if design["lower"] >= design["upper"]:
        yield (
            f"design.lower: {design['lower']} is not below design.upper ({design['upper']}); "
            "exchange them"
        )
    frames = loading["frames"]
    if any(b <= a for a, b in itertools.pairwise(frames)):
        yield f"loading.frames: {frames} does not rise; sort it and remove repetitions"
    solver = config["solver"]
    if solver["min_load_fraction"] > solver["first_load_fraction"]:
        yield "solver.min_load_fraction: exceeds solver.first_load_fraction; lower it"
    mistakes = list(_check_tables(config))
    yield from mistakes
    sizes = {"train": design["natural"] + design["log"], "test": design["test"]}
    if config["simulations"]["source"] == "table":
        # What cannot be read has been said already.
        sizes = None if mistakes else _table_sizes(config)
    if sizes:
        yield from _check_sizes(config, sizes)
    emulators = config["emulators"]
    shortlist = emulators["shortlist"]["names"]
    for name in shortlist or ():
        if name not in emulators["names"]:
            yield f"emulators.shortlist.names: {name} is not in emulators.names; add it there"
    candidates = shortlist or emulators["names"]
    if emulators["final"] not in ("auto", *candidates):
        yield (
            f"emulators.final: {emulators['final']} is not among those whose posteriors are "
            f"compared ({', '.join(candidates)}); add it to emulators.names and to "
            "emulators.shortlist.names, or write `auto`"
        )
    yield from _check_scenarios(config["scenarios"], design)
    for name, subject in config["subjects"].items():
        yield from _check_subject(f"subjects.{name}", subject, name, config["synthetic_subjects"])
    yield from _check_joint(config["criticism"]["joint"], config["subjects"])
    for name, subject in config["synthetic_subjects"].items():
        for parameter, value in subject["theta"].items():
            if not design["lower"] <= value <= design["upper"]:
                yield (
                    f"synthetic_subjects.{name}.theta.{parameter}: {value} lies outside "
                    f"[{design['lower']}, {design['upper']}] (design.lower, design.upper), where "
                    "nothing is simulated; move it inside"
                )
        yield from _check_effects(f"synthetic_subjects.{name}.effects", subject["effects"], config)
    asked = config["criticism"]["hypotheses"]
    for name in asked if asked != "all" else ():
        why_not = REGISTRY[name].why_not(config)
        if why_not:
            yield f"criticism.hypotheses: {name} cannot be asked, {why_not}; remove it"
    if loading["basal_compliance_mm_per_kpa"] and loading["base"] != "u_r_u_z_fixed":
        yield (
            f"loading.basal_compliance_mm_per_kpa: only `u_r_u_z_fixed` holds the base on its "
            f"circle, `{loading['base']}` does not; leave it at 0"
        )


def _check_effects(key: str, effects: dict, config: dict) -> Iterator[str]:
    for name, value in effects.items():
        hypothesis = REGISTRY[name].for_study(config)
        why_not = hypothesis.why_not(config)
        if why_not:
            yield f"{key}.{name}: cannot be planted, {why_not}; remove it"
        psi = value["multiplier"] if isinstance(value, dict) else value
        if not hypothesis.low <= psi <= hypothesis.high:
            yield (
                f"{key}.{name}: {psi} lies outside the plausible range, {hypothesis.low} to "
                f"{hypothesis.high} {hypothesis.unit}; move it inside"
            )


def _check_joint(joint: dict, subjects: dict) -> Iterator[str]:
    for name, entry in joint.items():
        key = f"criticism.joint.{name}"
        if name in subjects:
            yield f"{key}: a subject has this name, too, and both write there; choose another"
        for subject in entry["subjects"]:
            if subject not in subjects:
                close = difflib.get_close_matches(subject, subjects, n=1)
                hint = f"did you mean {close[0]}?" if close else "add it to `subjects`"
                yield f"{key}.subjects: there is no subject {subject}; {hint}"
        if entry["theta"] == "published":
            for subject in entry["subjects"]:
                if subjects.get(subject, {}).get("source", "") != "published_simulation":
                    yield (
                        f"{key}.theta: the theta of {subject} is not published; give a table of "
                        "all thetas, or leave the subject out"
                    )
        elif entry["theta"] is not None and not Path(entry["theta"]).is_file():
            yield (
                f"{key}.theta: there is no file {entry['theta']}; give its path from the folder in "
                "which you start"
            )


def _check_tables(config: dict) -> Iterator[str]:
    """Tables of simulations that cannot be used, and what cannot be had without a simulator."""
    simulations, design = config["simulations"], config["design"]
    tables = simulations["tables"]
    if simulations["source"] != "table":
        if tables:
            yield (
                "simulations.tables: tables are read with `simulations.source: table` only; set "
                "that, or remove them"
            )
        return
    if "train" not in tables:
        yield "simulations.tables.train: missing; give the inputs and outputs to learn from"
    # Imported here for the same reason as measured files are.
    from regional_lv.simulation_tables import SENSITIVITY, read_tables

    for name, files in tables.items():
        key = f"simulations.tables.{name}"
        if PUBLISHED in files.values():
            if name != "train" or set(files.values()) != {PUBLISHED}:
                yield (
                    f"{key}: `{PUBLISHED}` is the paper's training table, inputs and outputs "
                    "together; name it for both of `train`, or give paths"
                )
            columns = ()
        else:
            try:
                columns = read_tables(**files, lower=design["lower"], upper=design["upper"]).columns
            except InputError as error:
                yield f"{key}: {error}"
                continue
        learner = "gradient_gp"
        if name == "train" and learner in config["emulators"]["names"]:
            if SENSITIVITY not in columns:
                yield (
                    f"emulators.names: {learner} learns from sensitivities, and {key} has no "
                    f"column {SENSITIVITY}; add it (Parquet, 520 numbers per row), or leave "
                    f"{learner} out"
                )
    for name, subject in config["subjects"].items():
        if subject["source"] == "synthetic":
            yield (
                f"subjects.{name}: synthetic subjects come out of the simulator, which "
                "`simulations.source: table` does without; remove it"
            )


def _table_sizes(config: dict) -> dict[str, int]:
    """Rows of the sets of source `table`, `train` and `test` after the split."""
    from regional_lv.simulation_tables import read_tables, split

    simulations, design = config["simulations"], config["design"]
    sizes = {
        name: PUBLISHED_ROWS
        if PUBLISHED in files.values()
        else len(read_tables(**files, lower=design["lower"], upper=design["upper"]))
        for name, files in simulations["tables"].items()
    }
    holdout = 0 if "test" in sizes else simulations["holdout"]
    parts = split(sizes["train"], holdout, simulations["rows"], config["seed"])
    return {"test": holdout} | sizes | {"train": len(parts["train"])}


def _check_sizes(config: dict, sizes: dict[str, int]) -> Iterator[str]:
    """Too few simulations for what is asked of them."""
    cases = config["test_posteriors"]["cases"]
    if cases != "all" and cases > sizes["test"]:
        yield (
            f"test_posteriors.cases: {cases} posteriors on {sizes['test']} test cases "
            "(design.test, or the test table); lower it, or write `all`"
        )
    rows = sizes["train"]
    if rows < LEAST_ROWS:
        yield f"{rows} training simulations are too few for any emulator; give {LEAST_ROWS} or more"
    for name in config["emulators"]["names"]:
        settings = config["emulators"][name]
        if "neighbours" in settings and rows < settings["neighbours"] / 0.9:
            yield (
                f"emulators.{name}.neighbours: {rows} training simulations are too few for "
                f"{settings['neighbours']} neighbours and some to calibrate on; lower it, leave "
                f"{name} out of emulators.names, or simulate more"
            )


def _check_scenarios(scenarios: dict, design: dict) -> Iterator[str]:
    """Means outside the bounds, and names that other sets have."""
    lower, upper = design["lower"], design["upper"]
    means = {f"sets.{name}.mu": entry["mu"] for name, entry in scenarios["sets"].items()}
    for key, mean in (means | {"healthy_mean": scenarios["healthy_mean"]}).items():
        if not lower <= mean <= upper:
            yield (
                f"scenarios.{key}: {mean:g} lies outside [{lower:g}, {upper:g}] (design.lower, "
                "design.upper), where nothing is learnt; move it inside"
            )
    for name in sorted(set(scenarios["sets"]) & RESERVED):
        yield f"scenarios.sets.{name}: the name is taken by another set; choose another"


def _check_geometry_files(geometry: dict) -> Iterator[str]:
    """Files that the geometry's source needs and that are not there."""
    imported = geometry["imported"]
    if geometry["source"] == "segments":
        needed = {"geometry.segments": geometry["segments"]}
    elif imported["file"] is None:
        yield "geometry.imported.file: missing; source `mesh` needs a mesh, give its path"
        return
    elif imported["file"] == PUBLISHED_HEART:
        if imported["segments"] is not None:
            yield (
                f"geometry.imported.segments: {PUBLISHED_HEART} comes with its segments; remove it"
            )
        return
    else:
        needed = {f"geometry.imported.{key}": imported[key] for key in ("file", "segments")}
    for key, path in needed.items():
        if path is not None and not Path(path).is_file():
            yield (
                f"{key}: there is no file {path}; give its path from the folder in which you start"
            )


def _check_subject(key: str, subject: dict, name: str, synthetic: dict) -> Iterator[str]:
    source, measured = subject["source"], subject.get("measured")
    if source == "synthetic" and name not in synthetic:
        close = difflib.get_close_matches(name, synthetic, n=1)
        hint = f"; did you mean the name {close[0]}?" if close else "; add it there"
        yield f"{key}: synthetic_subjects has no entry {name}{hint}"
    if source == "file":
        if measured is None:
            yield f"{key}.measured: missing; give the path of the measured file"
        else:
            # Imported here because pandas takes longer to load than the rest of this module, and
            # every job of a run reads the configuration.
            from regional_lv.measured import read_measured

            try:
                with warnings.catch_warnings():
                    # The job that imports the file says them once, in its log.
                    warnings.simplefilter("ignore")
                    read_measured(measured)
            except InputError as error:
                yield f"{key}.measured: {error}"
    elif measured is not None:
        yield f"{key}.measured: only `source: file` reads a file; remove one of the two"
    if subject.get("frame") is not None and source != "published_volunteer":
        yield f"{key}.frame: only `source: published_volunteer` has frames; remove one of the two"
    slices = subject.get("slices")
    if slices is not None and subject.get("frame") is None:
        yield f"{key}.slices: slices are of a frame; add `frame: extrema` or the number of one"
    if slices is not None and not all(set(level) & set(slices) for level in SLICES_OF_LEVEL):
        yield f"{key}.slices: {slices} lacks a level; name one of 1 and 2, one of 3 and 4, and 5"
    row = subject.get("row")
    if source == "published_simulation" and row is None:
        yield f"{key}.row: missing; give the row of the published simulation (1, 2, ...)"
    if source != "published_simulation" and row is not None:
        yield f"{key}.row: only `source: published_simulation` has rows; remove one of the two"


# --------------------------------------------------------------------------- documentation


def describe() -> list[tuple[str, dict]]:
    """Every key that holds a value as (path, entry), in the order of the schema.

    Names that the user chooses appear as `<name>`. `entry` is the schema's, with `reruns` from
    its section where it has none, and `required` (bool).
    """

    def walk(schema: dict, path: str, reruns: str | None) -> Iterator[tuple[str, dict]]:
        named = schema.get("patternProperties", {}).values()
        for key, entry in [*schema.get("properties", {}).items(), *(("<name>", e) for e in named)]:
            inner = entry.get("reruns", reruns)
            if entry.get("properties") or entry.get("patternProperties"):
                yield from walk(entry, _join(path, key), inner)
                continue
            required = key in schema.get("required", [])
            yield _join(path, key), entry | {"reruns": inner, "required": required}

    return list(walk(load_schema(), "", None))


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
    choices = [str(choice) for choice in entry.get("enum", [])]
    missing = [choice for choice in choices if f"`{choice}`" not in text]
    return f"{text} One of {', '.join(f'`{c}`' for c in choices)}." if missing else text


def main(readme: Path) -> None:
    """Rewrite what follows `MARK` in config/README.md."""
    head = readme.read_text().split(MARK)[0]
    readme.write_text(f"{head}{MARK}\n{document()}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
