"""What has to fit between the keys of a configuration, and what a file or a registry has to say.

The schema has accepted each key by itself, and the defaults are filled in (`regional_lv.config`).
"""

import difflib
import itertools
import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

from regional_lv.channels import Channels
from regional_lv.config.schema.keys import entry_schema, section_schema
from regional_lv.config.schema.messages import explain_unknown
from regional_lv.data import TABLES
from regional_lv.data.published import (
    PUBLISHED,
    PUBLISHED_HEART,
    PUBLISHED_ROWS,
    PUBLISHED_TABLES,
    SLICES_OF_LEVEL,
)
from regional_lv.emulators import OF_INPUTS
from regional_lv.emulators import REGISTRY as EMULATORS
from regional_lv.errors import InputError
from regional_lv.inputs.parameters import Parameterisation
from regional_lv.mechanics.loads import LOADS
from regional_lv.mechanics.materials import material_from_config
from regional_lv.mechanics.observables.layer import check_layer
from regional_lv.mechanics.supports import SUPPORTS, supports_from_config
from regional_lv.quantities import QUANTITIES

RESERVED = {"train", "test", "holdout", "resimulated", "subjects"}
"""Names that no scenario may have."""

PATHS = "give its path from the folder of the configuration, or from the one in which you start"
"""Where a path may count from."""

WEIGHTED_SHARE = 0.6
"""Of the draws, how many may be asked to be effective. Importance sampling reaches two thirds if
all weights are the same (`inference.by_importance`), and they never quite are."""

KEPT = "an imported mesh that is kept cannot be made finer (geometry.imported.remesh)"

CURVES = ("curves", "unit", "reference", "frame")
"""What a subject with `source: curves` has to say."""


def meshes_anew(config: Mapping) -> bool:
    """Whether the study makes its meshes itself, so that it can make finer ones."""
    geometry = config["geometry"]
    return geometry["source"] != "mesh" or geometry["imported"]["remesh"]


def cross_check(config: dict) -> Iterator[str]:
    """Mistakes that only show between keys, or between a key and a file or a registry.

    config: complete, and each key as the schema has it. One line per mistake, with the key and the
    remedy.
    """
    geometry, design, loading = config["geometry"], config["design"], config["loading"]
    if geometry["epi_apex_z_mm"] >= geometry["endo_apex_z_mm"]:
        yield "geometry.epi_apex_z_mm: must lie below geometry.endo_apex_z_mm; lower it"
    without_heart = list(_check_geometry_files(geometry))
    yield from without_heart
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
    yield from _check_draws(config)
    mistakes += _check_emulators(config["emulators"], config["evaluation"])
    mistakes += _complaints(material_from_config, config["material"])
    mistakes += _complaints(check_layer, *config["observables"]["layer"])
    mistakes += _complaints(Channels.from_config, config)
    if design["lower"] < design["upper"]:
        mistakes += _complaints(Parameterisation.from_config, config)
    sound = not (mistakes or without_heart) and design["lower"] < design["upper"]
    if config["inputs"] and sound:
        # The catalogue reads segment tables: pandas, for every process that reads a configuration.
        from regional_lv.inputs.space import Inputs

        mistakes += _complaints(Inputs.from_config, config)
    yield from mistakes
    for name, subject in config["subjects"].items():
        yield from _check_subject(f"subjects.{name}", subject, name, config["synthetic_subjects"])
    if not mistakes and design["lower"] < design["upper"]:
        yield from _check_model(
            config, Parameterisation.from_config(config), Channels.from_config(config)
        )


def _check_draws(config: Mapping) -> Iterator[str]:
    """As many draws as the convergence check can pass."""
    least = config["nuts"]["ess_min"]
    for section in ("nuts", "clinical"):
        chains, draws = config[section]["chains"], config[section]["draws"]
        reached = WEIGHTED_SHARE * chains * draws
        if least > reached:
            needed = math.ceil(least / WEIGHTED_SHARE / chains)
            yield (
                f"{section}.draws: {chains} chains of {draws} draws have up to {reached:.0f} "
                f"effective ones, fewer than nuts.ess_min ({least:g}): no posterior would pass the "
                f"convergence check; set {section}.draws to {needed} or more, or lower nuts.ess_min"
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
        sizes = {} if mistakes else table_sizes(config)
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
        if subject["mesh"] == "finer" and not meshes_anew(config):
            yield f"{key}.mesh: {KEPT}; write study"
        yield from check_effects(f"{key}.effects", subject["effects"], config)
    if config["all_inputs"]["finer"] and not meshes_anew(config):
        yield f"all_inputs.finer: {KEPT}; write 0"
    yield from _check_shapes(config)
    if config["criticism"]["joint"] and not config["inputs"]:
        yield (
            "criticism.joint: nothing is suspected; make inputs suspected, such as "
            "`inputs: {causes: suspected}`, or remove it"
        )
    benchmark = config["criticism"]["benchmark"]
    yield from _check_noise("criticism.benchmark.noise", benchmark["noise"], channels)
    level = config["criticism"]["level"]
    for key, section in (("criticism", config["criticism"]), ("criticism.benchmark", benchmark)):
        replicates = section["bootstrap"]
        if level * (1 + replicates) < 1:
            yield (
                f"criticism.level: {level} is never reached with {replicates} replicates; raise "
                f"it, or {key}.bootstrap"
            )
    noise = config["scenarios"]["noise"]
    yield from _check_names("scenarios.noise", noise, QUANTITIES)
    if all(noise.get(name) is None for name in channels.quantities):
        yield "scenarios.noise: no quantity that the study observes is measured; name a noise"


def _check_shapes(config: Mapping) -> Iterator[str]:
    """Of a design over all kinds of hearts: inputs that its shapes are values of."""
    if config["all_inputs"]["shapes"] == "study":
        return
    from regional_lv.hearts.population import COLUMNS
    from regional_lv.inputs.space import Inputs

    inputs = Inputs.from_config(config)
    roles = dict(zip(inputs.names, (role.kind for role in inputs.roles), strict=True))
    if any(roles.get(name) != "inferred" for name in COLUMNS):
        yield (
            "all_inputs.shapes: a population has shapes of all kinds, and not all shape inputs are "
            "inferred; write `inputs: {segment_thickness: inferred, endo_radius: inferred, apex: "
            "inferred}` for a heart from a segment table, or `shapes: study`"
        )


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
    section = section_schema(name)
    for key in config[name]:
        if key not in section["properties"] and key not in registry:
            yield explain_unknown(section, name, key)


def _check_emulators(emulators: dict, evaluation: bool) -> Iterator[str]:
    """Names that no emulator has, and choices among those that are not fitted."""
    section = section_schema("emulators")
    own = {"names", "shortlist", "final"}
    known = list(EMULATORS)
    names, shortlist = emulators["names"], emulators["shortlist"]
    yield from _check_names("emulators.names", names, known)
    if OF_INPUTS in (*names, emulators["final"]):
        yield (
            f"emulators: {OF_INPUTS} is of all inputs, and trained where `inputs` gives roles; "
            "name another one"
        )
    yield from _check_names("emulators.shortlist.also", shortlist["also"], known)
    for name in emulators:
        if name not in {*known, *own, *names}:
            yield explain_unknown(section, "emulators", name)
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
        if p.name in theta and not p.low <= theta[p.name] <= p.high:
            yield (
                f"{key}.{p.name}: {theta[p.name]} lies outside [{p.low}, {p.high}] "
                "(design.lower, design.upper, parameters.bounds), where nothing is simulated; move "
                "it inside"
            )


def _check_noise(key: str, noise: dict, channels: Channels) -> Iterator[str]:
    """Names of noise scales that no quantity has, and subjects of whom nothing is measured."""
    yield from _check_names(key, noise, dict.fromkeys(kind.noise for kind in QUANTITIES.values()))
    if not {QUANTITIES[quantity].noise for quantity in channels.quantities} & set(noise):
        yield f"{key}: nothing that the study observes is measured; name the noise of a quantity"


def check_effects(key: str, effects: dict, config: dict) -> Iterator[str]:
    """Mistakes in the effects of a synthetic subject, which stand at `key` of the configuration."""
    if not effects:
        return
    # The catalogue reads segment tables: pandas, for every process that reads a configuration.
    from regional_lv.inputs.model import model_of
    from regional_lv.inputs.space import catalogue, why_unknown

    try:
        model = model_of(config)
        every = catalogue(model)
    except InputError:
        return  # there is no such model, which is reported with everything else
    known = {each.name: each for each in every if each.nominal is not None}
    for name, value in effects.items():
        if name not in known:
            yield f"{key}.{name}: {why_unknown(name, [*known.values()], model)}"
        elif not known[name].low <= value <= known[name].high:
            each = known[name]
            yield (
                f"{key}.{name}: {value} lies outside the plausible range, {each.low:g} to "
                f"{each.high:g} {each.unit}; move it inside"
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
    if config["inputs"]:
        yield (
            "inputs: roles ask for simulations of their own, and `simulations.source: table` runs "
            "none; remove one of them"
        )
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
    from regional_lv.simulation.tables import SENSITIVITY, published_order, read_tables

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


def table_sizes(config: dict) -> dict[str, int]:
    """Rows of the sets of source `table`, `train` and `test` after the split (without what is held
    out beside a test table).

    Raises InputError for tables that cannot be read or leave nothing to train on.
    """
    from regional_lv.simulation.tables import read_tables, split

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
        held_out = max(1, round(min(0.1 * rows, 20)))  # as `LocalGP` calibrates on
        if "neighbours" in settings and rows - held_out < settings["neighbours"]:
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
    filled = {
        "surfaces": [f"surfaces.{k}" for k in ("endocardium", "epicardium") if surfaces[k]],
        "mesh": ["imported.file"] if imported["file"] else [],
    }
    for source, keys in filled.items():
        if keys and geometry["source"] != source:
            yield (
                f"geometry.source: is {geometry['source']}, so that geometry.{keys[0]} is not "
                f"used; write source: {source}, or remove it"
            )
    if geometry["source"] == "segments":
        given = geometry["segments"]
        needed = {"geometry.segments": None if given in TABLES else given}
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
                "an STL, PLY, OBJ, VTP or VTK file"
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
        described = entry_schema(section_schema("subjects"), name)["properties"]
        for part in CURVES:
            if subject.get(part) is None:
                yield f"{key}.{part}: missing; give it. {described[part]['description']}"
    else:
        own = {k: subject.get(k) for k in (*CURVES[:-1], "end_diastole_frame", "volume_ml")}
        own |= {f"sd.{k}": value for k, value in subject["sd"].items()}
        for part, value in own.items():
            if value is not None:
                yield f"{key}.{part}: only `source: curves` has it; remove one of the two"
    if source not in ("file", "curves") and subject["segments"] != 17:
        yield f"{key}.segments: only `source: file` or `curves` has it; remove one of the two"
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
                *(config["observables"]["strain_exponent"], subject["segments"]),
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
