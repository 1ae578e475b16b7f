"""The configuration of a study: checked against the schema, defaults filled in.

Keys, units, defaults and limits stand in `schema/config.schema.yaml` and nowhere else; this module
adds what a schema cannot say: what fits together, and what is registered.
`python -m regional_lv.config config/README.md` writes the tables of keys in that page.
"""

import copy
import difflib
import itertools
import math
import os
import re
import reprlib
import statistics
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import jsonschema
import yaml

from regional_lv.channels import Channels
from regional_lv.criticism.hypotheses import REGISTRY
from regional_lv.data import VOLUNTEER
from regional_lv.errors import InputError
from regional_lv.input_files import read_text, reading
from regional_lv.mechanics.loads import LOADS
from regional_lv.mechanics.materials import material_from_config
from regional_lv.mechanics.observables.layer import check_layer
from regional_lv.mechanics.supports import SUPPORTS, supports_from_config
from regional_lv.parameters import Parameterisation
from regional_lv.published import (
    PUBLISHED,
    PUBLISHED_HEART,
    PUBLISHED_ROWS,
    PUBLISHED_TABLES,
    SLICES_OF_LEVEL,
)
from regional_lv.quantities import QUANTITIES
from regional_lv.registry import load_plugins
from regional_lv.schema import load_schema

MARK = "<!-- The tables below are written from the schema by `make format`. -->\n"
"""Line of config/README.md after which everything is generated."""

RESERVED = {"train", "test", "holdout", "resimulated", "subjects"}
"""Names that no scenario may have."""

PATHS = "give its path from the folder of the configuration, or from the one in which you start"
"""Where a path may count from."""

CURVES = ("curves", "unit", "reference", "frame")
"""What a subject with `source: curves` has to say."""

LONGEST_NAME, LONGEST_TEXT = 100, 4000
"""Characters that a key and any other text may have."""

MOST_ENTRIES, MOST_DEPTH = 100_000, 20
"""Values that a configuration may hold, and sections in one another."""

PHYSICS = ("material", "fibres", "loading", "supports", "observables", "solver")
"""Sections that describe the simulator."""

MESHED_ANEW = ("segments", "surfaces")
"""Sources of the geometry of which a finer mesh can be made."""

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
}
"""Keys of earlier versions, and what does their work now."""


def load(
    config: str | Path | dict, source: str = "config", folders: Sequence[str | Path] = ()
) -> dict:
    """Read, check and complete a configuration.

    Parameters
    ----------
    config: path of a YAML file, or what such a file holds (as Snakemake hands it over).
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
    config, schema = _usable(source, config), load_schema()
    errors = list(jsonschema.Draft202012Validator(schema).iter_errors(config))
    empty = [error for error in errors if _is_asked_for(error)]
    unfilled = sorted(line for error in empty for line in _explain(error))
    if len(empty) < len(errors):
        _raise(source, sorted(line for error in errors for line in _explain(error)))
    for error in empty:
        # The defaults serve to find what else is wrong; nothing runs on them.
        _remove(config, error.absolute_path)
    given: dict = _resolve(schema, config, folders)
    try:
        load_plugins(Path(plugin).resolve() for plugin in given.get("plugins", ()))
    except InputError as error:
        _raise(source, [str(error)])
    complete = _complete(schema, given)
    if "subjects" not in given and not complete["evaluation"]:
        del complete["subjects"]["volunteer"]
    _complete_by_registries(complete)
    _complete_holdout(complete)
    if "synthetic_subjects" not in given:
        _carry_over(complete)
        _drop_impossible(complete, named=given.get("subjects", {}))
    _raise(source, [*unfilled, *_cross_check(complete)])
    if complete["simulations"]["source"] == "table":
        # The one place that says how many test cases there are.
        complete["design"]["test"] = _table_sizes(complete)["test"]
    return complete


def final_emulator(config: dict) -> str:
    """Name of the files of the emulator that subjects, scenarios and figures use."""
    return "final" if config["evaluation"] else config["emulators"]["final"]


def physics(config: dict) -> dict:
    """What a checked configuration says of the simulator, as `make_simulator` takes it."""
    return {section: config[section] for section in PHYSICS} | {
        "geometry": {"wall_thickness_scale": config["geometry"]["wall_thickness_scale"]},
        "parameters": Parameterisation.from_config(config).spec(),
    }


def read(path: str | Path) -> dict:
    """What a YAML file of keys holds. Raises InputError."""
    text = read_text(path, most_mb=1)
    with reading(path, "correct what the parser names"):
        try:
            content = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise InputError(
                f"{path}: not valid YAML; correct what the parser names: {str(error)[:1000]}"
            ) from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds no keys; write at least `study: <name>`")
    return content


def _usable(source: str, config: dict) -> dict:
    """A copy whose keys are text: YAML reads keys such as 1 or no as something else.

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
                at = _join(key, _shown(name))
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


def _unusable_text(text: str, longest: int) -> str:
    if len(text) > longest:
        return f"has {len(text)} characters, and at most {longest} are possible"
    return "" if text.isprintable() else f"{text!r} holds line breaks or other control characters"


def _shown(value) -> str:
    """A value in a message, on one line and short."""
    return reprlib.repr(value).strip("'")


def _is_asked_for(error: jsonschema.ValidationError) -> bool:
    """Whether it is about a key that stands empty so that it is filled in."""
    return error.instance is None and "if_empty" in error.schema


def _remove(config: dict, path: Sequence[str]) -> None:
    *sections, key = path
    for name in sections:
        config = config[name]
    del config[key]


def _resolve(schema: dict, value, folders: Sequence[str | Path]):
    """`value` with its paths counted from the working directory."""
    if isinstance(value, dict):
        return {
            key: _resolve(_entry_schema(schema, key), item, folders) for key, item in value.items()
        }
    if isinstance(value, list):
        return [_resolve(schema.get("items", {}), item, folders) for item in value]
    if schema.get("path") and isinstance(value, str) and not os.path.isabs(value):
        for folder in folders:
            if (Path(folder) / value).is_file():
                return os.path.relpath(Path(folder) / value)
    return value


def _raise(source: str, lines: list[str]) -> None:
    if lines:
        # Several missing keys are several errors of the validator with one and the same line.
        raise InputError("\n".join(f"{source}: {line}" for line in dict.fromkeys(lines)))


def _complete(schema: dict, value):
    """`value` with defaults for absent keys, and numbers in the schema's type."""
    if isinstance(value, dict):
        return {
            key: _complete(_entry_schema(schema, key), copy.deepcopy(value.get(key, default)))
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


def _complete_by_registries(config: dict) -> None:
    """Add what a schema does not know of: settings of emulators that plugins add."""
    emulators = config["emulators"]
    for name in emulators["names"]:
        if name not in emulators:
            emulators[name] = _complete(_entry_schema(_section("emulators"), name), {})


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
    stress = next(p.factor for p in paper if p.scales_stress)
    for subject in config["synthetic_subjects"].values():
        given = subject["theta"]
        subject["theta"] = {
            p.name: statistics.mean(
                given.get(f"{stress if p.scales_stress else p.factor}_{paper.zone_of(s)}", 1.0)
                for s in own.zones[p.zone]
            )
            for p in own
        }


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
    for entry in schema.get("patternProperties", {}).values():
        return entry
    further = schema.get("additionalProperties")
    return further if isinstance(further, dict) else {}


def _section(name: str) -> dict:
    return load_schema()["properties"][name]


# ------------------------------------------------------------------------------- messages


def _explain(error: jsonschema.ValidationError) -> Iterator[str]:
    """Lines that say which key is wrong, and the remedy."""
    key = ".".join(str(part) for part in error.absolute_path)
    if error.validator == "additionalProperties":
        patterns = error.schema.get("patternProperties", {})
        for name in set(error.instance) - set(error.schema.get("properties", {})):
            if not any(re.search(pattern, name) for pattern in patterns):
                yield _explain_unknown(error.schema, key, name)
    elif _is_unknown_name(error):
        section, name = error.absolute_path
        yield _explain_unknown(_section(section), section, name)
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


def _explain_unknown(schema: dict, key: str, name: str) -> str:
    if _join(key, name) in MOVED:
        return f"{_join(key, name)}: has moved; use {MOVED[_join(key, name)]}"
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


def _repr(value) -> str:
    """`repr` without the middle of what is long."""
    text = repr(value)
    return text if len(text) <= 300 else f"{text[:200]} ... {text[-50:]}"


def _complaint(error: jsonschema.ValidationError) -> str:
    value, limit = error.instance, error.validator_value
    if _is_asked_for(error):
        return f"empty; {error.schema['if_empty']}"
    if error.validator == "type":
        given = "an empty value" if value is None else _repr(value)
        return f"{given} is not {_type_name(limit)}{_number_hint(value, limit)}"
    if error.validator == "enum":
        close = difflib.get_close_matches(str(value), [str(v) for v in limit], n=1)
        hint = f"; did you mean {close[0]}?" if close else ""
        return (
            f"{_repr(value)} is not offered; choose one of {', '.join(map(_choice, limit))}{hint}"
        )
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
    """Mistakes that only show between keys, or between a key and a file or a registry."""
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
    mistakes = [
        *_check_added("loading", LOADS, config),
        *_check_added("supports", SUPPORTS, config),
    ]
    if not mistakes:
        mistakes += _complaints(supports_from_config, config["supports"])
    solver = config["solver"]
    if solver["min_load_fraction"] > solver["first_load_fraction"]:
        yield "solver.min_load_fraction: exceeds solver.first_load_fraction; lower it"
    mistakes += _check_emulators(config["emulators"], config["evaluation"])
    mistakes += _complaints(material_from_config, config["material"])
    mistakes += _complaints(check_layer, *config["observables"]["layer"])
    mistakes += _complaints(Channels.from_config, config)
    if design["lower"] < design["upper"]:
        mistakes += _complaints(Parameterisation.from_config, config)
    yield from mistakes
    for name, subject in config["subjects"].items():
        yield from _check_subject(f"subjects.{name}", subject, name, config["synthetic_subjects"])
    if not mistakes and design["lower"] < design["upper"]:
        yield from _check_model(
            config, Parameterisation.from_config(config), Channels.from_config(config)
        )


def _complaints(make: Callable, *arguments) -> list[str]:
    """What the maker of an object has against its part of the configuration."""
    try:
        make(*arguments)
    except InputError as error:
        return [str(error)]
    return []


def _check_model(config: dict, parameters: Parameterisation, channels: Channels) -> Iterator[str]:
    """What has to fit the parameters that are inferred and the channels that are observed."""
    mistakes = list(_check_tables(config, parameters, channels))
    yield from mistakes
    design = config["design"]
    sizes = {"train": design["natural"] + design["log"], "test": design["test"]}
    if config["simulations"]["source"] == "table":
        # What cannot be read has been reported already.
        sizes = {} if mistakes else _table_sizes(config)
    if sizes:
        yield from _check_sizes(config, sizes, least=len(parameters) + 2)
    yield from _check_scenarios(config["scenarios"], parameters)
    for name, subject in config["subjects"].items():
        yield from _check_observed(f"subjects.{name}", subject, config, channels)
    yield from _check_joint(config["criticism"]["joint"], config["subjects"], parameters)
    for name, subject in config["synthetic_subjects"].items():
        key = f"synthetic_subjects.{name}"
        yield from _check_theta(f"{key}.theta", subject["theta"], parameters)
        yield from _check_noise(f"{key}.noise", subject["noise"], channels)
        if subject["mesh"] == "finer" and config["geometry"]["source"] not in MESHED_ANEW:
            yield f"{key}.mesh: an imported mesh cannot be made finer; write study"
        yield from _check_effects(f"{key}.effects", subject["effects"], config)
    if config["criticism"]["discretisation"] and config["geometry"]["source"] not in MESHED_ANEW:
        yield "criticism.discretisation: an imported mesh cannot be made finer; write 0"
    benchmark = config["criticism"]["benchmark"]
    yield from _check_noise("criticism.benchmark.noise", benchmark["noise"], channels)
    noise = config["scenarios"]["noise"]
    yield from _check_names("scenarios.noise", noise, QUANTITIES)
    if all(noise.get(name) is None for name in channels.quantities):
        yield "scenarios.noise: no quantity that the study observes is measured; name a noise"
    asked = config["criticism"]["hypotheses"]
    if asked != "all":
        yield from _check_names("criticism.hypotheses", asked, REGISTRY)
        described = physics(config)
        for name in asked:
            why_not = REGISTRY[name].why_not(described) if name in REGISTRY else ""
            if why_not:
                yield f"criticism.hypotheses: {name} cannot be tested, {why_not}; remove it"


def _drop_impossible(config: dict, named: Iterable[str]) -> None:
    """Leave out default synthetic subjects that this study cannot have: whose effects are part of
    its model, or for which it cannot mesh its geometry anew. named: subjects that the study asks
    for itself, which stay, to be complained about."""
    again = config["geometry"]["source"] in MESHED_ANEW
    for name, subject in list(config["synthetic_subjects"].items()):
        try:
            possible = not list(_check_effects(name, subject["effects"], config))
        except InputError:
            return  # reported with everything else
        if name not in named and not (possible and (again or subject["mesh"] == "study")):
            del config["synthetic_subjects"][name]
            config["subjects"].pop(name, None)


def _check_names(key: str, names: Iterable[str], known: Iterable[str]) -> Iterator[str]:
    """Names that are not among the `known` ones."""
    known = list(known)
    for name in names:
        if name not in known:
            close = difflib.get_close_matches(name, known, n=1)
            hint = f"; did you mean {close[0]}?" if close else ""
            yield f"{key}: {name!r} is not offered; choose one of {', '.join(known)}{hint}"


def _check_added(name: str, registry: Iterable[str], config: dict) -> Iterator[str]:
    """Keys of the section `name` that neither the schema nor a plugin knows."""
    section = _section(name)
    for key in config[name]:
        if key not in section["properties"] and key not in registry:
            yield _explain_unknown(section, name, key)


def _check_emulators(emulators: dict, evaluation: bool) -> Iterator[str]:
    """Names that no emulator has, and choices among those that are not fitted."""
    section = _section("emulators")
    own = {"names", "shortlist", "final"}
    known = [name for name in section["properties"] if name not in own]
    names, shortlist = emulators["names"], emulators["shortlist"]
    asked = {*names, *(shortlist["names"] or ()), *shortlist["also"], *emulators} - own
    asked |= {emulators["final"]} - {"auto"}
    if not asked <= {*known}:
        # Emulators bring torch in, which takes seconds: only to find those of plugins.
        from regional_lv.emulators import REGISTRY as emulator_registry

        known = list(emulator_registry)
    yield from _check_names("emulators.names", names, known)
    yield from _check_names("emulators.shortlist.also", shortlist["also"], known)
    for name in emulators:
        if name not in {*known, *own, *names}:
            yield _explain_unknown(section, "emulators", name)
    for name in shortlist["names"] or ():
        if name not in names:
            yield f"emulators.shortlist.names: {name} is not in emulators.names; add it there"
    candidates = shortlist["names"] or names
    if not evaluation and emulators["final"] == "auto":
        yield (
            "emulators.final: without `evaluation` nothing says which emulator is the best; name "
            f"one of {', '.join(names)}"
        )
    if emulators["final"] not in ("auto", *candidates):
        yield (
            f"emulators.final: {emulators['final']} is not among those whose posteriors are "
            f"compared ({', '.join(candidates)}); add it to emulators.names and to "
            "emulators.shortlist.names, or write `auto`"
        )


def _check_theta(key: str, theta: dict, parameters: Parameterisation) -> Iterator[str]:
    yield from _check_names(key, theta, parameters.names)
    missing = [name for name in parameters.names if name not in theta]
    if missing:
        yield f"{key}: missing {', '.join(missing)}; add what is missing"
    for p in parameters:
        if p.name in theta and not p.lower <= theta[p.name] <= p.upper:
            yield (
                f"{key}.{p.name}: {theta[p.name]} lies outside [{p.lower}, {p.upper}] "
                "(design.lower, design.upper, parameters.bounds), where nothing is simulated; move "
                "it inside"
            )


def _check_noise(key: str, noise: dict, channels: Channels) -> Iterator[str]:
    """Names of noise scales that no quantity has, and subjects of whom nothing is measured."""
    yield from _check_names(key, noise, dict.fromkeys(kind.noise for kind in QUANTITIES.values()))
    if not {QUANTITIES[quantity].noise for quantity in channels.quantities} & set(noise):
        yield f"{key}: nothing that the study observes is measured; name the noise of a quantity"


def _check_effects(key: str, effects: dict, config: dict) -> Iterator[str]:
    yield from _check_names(key, effects, REGISTRY)
    described = physics(config)
    for name, value in effects.items():
        if name not in REGISTRY:
            continue
        hypothesis = REGISTRY[name].for_study(described)
        local = hypothesis.components != ("",)
        if local != isinstance(value, dict):
            form = "{segment: ..., multiplier: ...}" if local else "a number"
            yield f"{key}.{name}: {value!r} is not its form; give {form}"
            continue
        why_not = hypothesis.why_not(described)
        if why_not:
            yield f"{key}.{name}: cannot be injected, {why_not}; remove it"
        psi = value["multiplier"] if isinstance(value, dict) else value
        if not hypothesis.low <= psi <= hypothesis.high:
            yield (
                f"{key}.{name}: {psi} lies outside the plausible range, {hypothesis.low} to "
                f"{hypothesis.high} {hypothesis.unit}; move it inside"
            )


def _check_joint(joint: dict, subjects: dict, parameters: Parameterisation) -> Iterator[str]:
    for name, entry in joint.items():
        key = f"criticism.joint.{name}"
        if name in subjects:
            yield f"{key}: a subject has this name, too, and both write there; choose another"
        for subject in entry["subjects"]:
            if subject not in subjects:
                close = difflib.get_close_matches(subject, subjects, n=1)
                hint = f"did you mean {close[0]}?" if close else "add it to `subjects`"
                yield f"{key}.subjects: there is no subject {subject}; {hint}"
        if entry["theta"] == "published" and parameters.names != Parameterisation().names:
            yield (
                f"{key}.theta: the published thetas are of the paper's zones and factors; set "
                "`parameters` to them, or give a table of all thetas"
            )
        elif entry["theta"] == "published":
            for subject in entry["subjects"]:
                if subjects.get(subject, {}).get("source", "") != "published_simulation":
                    yield (
                        f"{key}.theta: the theta of {subject} is not published; give a table of "
                        "all thetas, or leave the subject out"
                    )
        elif entry["theta"] is not None and not Path(entry["theta"]).is_file():
            yield f"{key}.theta: there is no file {entry['theta']}; {PATHS}"


def _check_tables(config: dict, parameters: Parameterisation, channels: Channels) -> Iterator[str]:
    """Tables of simulations that cannot be used, and what cannot be had without a simulator."""
    simulations = config["simulations"]
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
    if "test" not in tables and simulations["holdout"] == 0:
        yield (
            "simulations.holdout: 0 leaves no test set; hold out one row or more, or give a test "
            "table (simulations.tables.test)"
        )
    known = ("train", "test", *config["scenarios"]["sets"])
    for name in sorted(set(tables) - set(known)):
        yield (
            f"simulations.tables.{name}: the study has no set of this name; use one of "
            f"{', '.join(known)} (rows held out of `train` need no table: simulations.holdout)"
        )
    # Imported here for the same reason as measured files are.
    from regional_lv.simulation_tables import SENSITIVITY, published_order, read_tables

    for name, files in tables.items():
        key = f"simulations.tables.{name}"
        if PUBLISHED in files.values():
            if name not in PUBLISHED_TABLES or set(files.values()) != {PUBLISHED}:
                yield (
                    f"{key}: `{PUBLISHED}` is the paper's training or test table, inputs and "
                    "outputs together; name it for both of `train` or of `test`, or give paths"
                )
            elif not published_order(parameters, channels):
                yield (
                    f"{key}: `{PUBLISHED}` holds the paper's parameters and channels; leave "
                    "`parameters`, `observables` and `loading.frames` at their defaults, or give "
                    "paths"
                )
            columns = ()
        else:
            try:
                columns = read_tables(**files, parameters=parameters, channels=channels).columns
            except InputError as error:
                yield f"{key}: {error}"
                continue
        learner = "gradient_gp"
        if name == "train" and learner in config["emulators"]["names"]:
            if SENSITIVITY not in columns:
                yield (
                    f"emulators.names: {learner} learns from sensitivities, and {key} has no "
                    f"column {SENSITIVITY}; add it (Parquet, {len(channels) * len(parameters)} "
                    f"numbers per row), or leave {learner} out"
                )
    for name, subject in config["subjects"].items():
        if subject["source"] == "synthetic":
            yield (
                f"subjects.{name}: synthetic subjects come out of the simulator, which "
                "`simulations.source: table` does without; remove it"
            )


def _table_sizes(config: dict) -> dict[str, int]:
    """Rows of the sets of source `table`, `train` and `test` after the split (without what is held
    out beside a test table)."""
    from regional_lv.simulation_tables import read_tables, split

    simulations = config["simulations"]
    parameters, channels = Parameterisation.from_config(config), Channels.from_config(config)
    sizes = {
        name: PUBLISHED_ROWS[name]
        if PUBLISHED in files.values()
        else len(read_tables(**files, parameters=parameters, channels=channels))
        for name, files in simulations["tables"].items()
    }
    holdout = simulations["holdout"]
    parts = split(sizes["train"], holdout, simulations["rows"], config["seed"])
    return {"test": holdout} | sizes | {"train": len(parts["train"])}


def _check_sizes(config: dict, sizes: dict[str, int], least: int) -> Iterator[str]:
    """Too few simulations for what is asked of them; every emulator needs `least`."""
    cases = config["test_posteriors"]["cases"]
    if cases != "all" and cases > sizes["test"]:
        yield (
            f"test_posteriors.cases: {cases} posteriors on {sizes['test']} test cases "
            "(design.test, or the test table); lower it, or write `all`"
        )
    rows = sizes["train"]
    if rows < least:
        yield f"{rows} training simulations are too few for any emulator; give {least} or more"
    efficiency = config["efficiency"]
    for key, size in (
        ("sizes", min(efficiency["sizes"])),
        ("most_with_sensitivities", efficiency["most_with_sensitivities"]),
    ):
        if size < least:
            yield (
                f"efficiency.{key}: {size} simulations are too few for any emulator; give {least} "
                "or more"
            )
    for name in config["emulators"]["names"]:
        settings = config["emulators"][name]
        if "neighbours" in settings and rows < settings["neighbours"] / 0.9:
            yield (
                f"emulators.{name}.neighbours: {rows} training simulations are too few for "
                f"{settings['neighbours']} neighbours and some to calibrate on; lower it, leave "
                f"{name} out of emulators.names, or simulate more"
            )


def _check_scenarios(scenarios: dict, parameters: Parameterisation) -> Iterator[str]:
    """Means outside the bounds, and names that other sets have."""
    lower, upper = parameters.lower.max(), parameters.upper.min()
    means = {f"sets.{name}.mu": entry["mu"] for name, entry in scenarios["sets"].items()}
    for key, mean in (means | {"healthy_mean": scenarios["healthy_mean"]}).items():
        if not lower <= mean <= upper:
            yield (
                f"scenarios.{key}: {mean:g} lies outside [{lower:g}, {upper:g}] (design.lower, "
                "design.upper, parameters.bounds), where there are no training simulations; move "
                "it inside"
            )
    for name in sorted(set(scenarios["sets"]) & RESERVED):
        yield f"scenarios.sets.{name}: the name is taken by another set; choose another"


def _check_geometry_files(geometry: dict) -> Iterator[str]:
    """Files that the geometry's source needs and that are not there."""
    imported, surfaces = geometry["imported"], geometry["surfaces"]
    if geometry["source"] == "segments":
        given = geometry["segments"]
        needed = {"geometry.segments": None if given == VOLUNTEER else given}
    elif geometry["source"] == "surfaces":
        yield from _check_surfaces(surfaces)
        needed = {
            f"geometry.surfaces.{key}": surfaces[key] for key in ("endocardium", "epicardium")
        }
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
            yield f"{key}: there is no file {path}; {PATHS}"
        elif path is not None and geometry["source"] == "segments":
            # Imported here because pandas takes longer to load than the rest of this module.
            from regional_lv.geometry.table import check_apices, read_segments

            mistakes = _complaints(read_segments, path)
            if not mistakes:
                apices = (geometry[f"{wall}_apex_z_mm"] for wall in ("endo", "epi"))
                mistakes = _complaints(check_apices, path, read_segments(path), *apices)
            yield from (f"{key}: {mistake}" for mistake in mistakes)


def _check_surfaces(surfaces: dict) -> Iterator[str]:
    """What the two surfaces need besides their files, or half of it."""
    key = "geometry.surfaces"
    for side in ("endocardium", "epicardium"):
        if surfaces[side] is None:
            yield (
                f"{key}.{side}: missing; source `surfaces` needs both surfaces, give the path of "
                "an STL, PLY or VTP file"
            )
    given = {
        name: [value is not None for value in surfaces[name].values()]
        for name in ("base", "insertions")
    }
    if any(given["base"]) and not all(given["base"]):
        yield f"{key}.base: half of it is missing; give point and normal, or neither"
    if any(given["insertions"]) and not all(given["insertions"]):
        yield f"{key}.insertions: one is missing; give anterior and inferior"
    elif (surfaces["septum"] is None) != any(given["insertions"]):
        known = "unknown" if surfaces["septum"] is None else "given twice"
        yield (
            f"{key}.septum: the septum's side is {known}; give the direction from the long axis "
            f"to the septum's middle, or the two points of {key}.insertions, and not both"
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
    elif measured is not None:
        yield f"{key}.measured: only `source: file` reads a file; remove one of the two"
    if source == "curves":
        described = _entry_schema(_section("subjects"), name)["properties"]
        for part in CURVES:
            if subject.get(part) is None:
                yield f"{key}.{part}: missing; give it. {described[part]['description']}"
    else:
        own = {k: subject.get(k) for k in (*CURVES[:-1], "end_diastole_frame", "volume_ml")}
        own |= {f"sd.{k}": value for k, value in subject["sd"].items()}
        for part, value in own.items():
            if value is not None:
                yield f"{key}.{part}: only `source: curves` has it; remove one of the two"
    of_frame = {"earliest_diastole": ["curves"], "extrema": ["published_volunteer"]}
    have = of_frame.get(subject["frame"], ["curves", "published_volunteer"])
    if subject["frame"] is not None and source not in have:
        yield (
            f"{key}.frame: only `source: {' or '.join(have)}` has the frame {subject['frame']}; "
            "remove one of the two"
        )
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


def _check_observed(key: str, subject: dict, config: dict, channels: Channels) -> Iterator[str]:
    """Measured files that cannot be used, and subjects of whose strains nothing is observed."""
    if subject["source"] == "file" and subject.get("measured") is not None:
        # Imported here because pandas takes longer to load than the rest of this module.
        from regional_lv.measured import read_measured

        with warnings.catch_warnings():
            # The job that imports the file says them once, in its log.
            warnings.simplefilter("ignore")
            for complaint in _complaints(
                read_measured,
                *(subject["measured"], channels, config["loading"]["pressure_mmhg"]),
                config["observables"]["strain_exponent"],
            ):
                yield f"{key}.measured: {complaint}"
    if subject["source"] == "curves" and all(subject.get(name) is not None for name in CURVES):
        from regional_lv.measured.curves import read_curve_subject

        exponent = config["observables"]["strain_exponent"]
        for complaint in _complaints(read_curve_subject, subject, channels, exponent):
            yield f"{key}.curves: {complaint}"
        if exponent != 2 and config["observables"]["line_share"] != 1:
            yield (
                f"observables.line_share: the curves of {key} are strains of material lines, which "
                f"are those of the tensor for Green's strain only; set line_share: 1, or "
                "strain_exponent: 2"
            )
    if (
        subject["source"].startswith("published_")
        and not (channels.at(1.0) & channels.is_strain).any()
    ):
        yield (
            f"{key}: the study observes no strain that was measured there; add circumferential or "
            "radial to observables.quantities, or remove it from `subjects`"
        )


# --------------------------------------------------------------------------- documentation


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


def _choice(value) -> str:
    """A value of an `enum` as YAML writes it."""
    return "null" if value is None else str(value)


def _default_text(entry: dict) -> str:
    if "default" not in entry:
        return "none"
    text = yaml.safe_dump(entry["default"], default_flow_style=True, width=math.inf)
    return f"`{text.splitlines()[0]}`"


def _meaning(entry: dict) -> str:
    """Description, with the choices where it does not name them itself."""
    text = entry["description"].strip()
    choices = [_choice(choice) for choice in entry.get("enum", [])]
    missing = [choice for choice in choices if f"`{choice}`" not in text]
    return f"{text} One of {', '.join(f'`{c}`' for c in choices)}." if missing else text


def main(readme: Path) -> None:
    """Rewrite what follows `MARK` in config/README.md."""
    head = readme.read_text().split(MARK)[0]
    readme.write_text(f"{head}{MARK}\n{document()}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
