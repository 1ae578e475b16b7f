"""The checked config, the paths, the dependencies on the library, for all other files here."""

import json
import os
import re
import sys
from functools import cache
from pathlib import Path

from snakemake.exceptions import WorkflowError

SOURCE = Path(str(workflow.current_basedir)).parents[1] / "src"
# Snakemake looks for modules in the folder of its files, too, which may be the working folder.
sys.path[:] = [path for path in sys.path if Path(path).resolve() != Path.cwd()]
# For this process and for the scripts that it starts, in whatever environment.
sys.path.insert(0, str(SOURCE))
os.environ["PYTHONPATH"] = str(SOURCE)
# UFL orders the terms of a form by Python's hashes, which differ from process to process unless
# seeded: compiled forms would not be found again, and sums would differ in their last digit.
os.environ["PYTHONHASHSEED"] = "0"

from regional_lv.study import surroundings  # noqa: E402

# Where Snakemake did not import the project's logger.
surroundings.settle()

from regional_lv import config as study_config  # noqa: E402
from regional_lv.study import dependencies, running  # noqa: E402
from regional_lv.channels import Channels  # noqa: E402
from regional_lv.config import meshes_anew  # noqa: E402
from regional_lv.criticism.settings import settings_of  # noqa: E402
from regional_lv.data import SHIPPED  # noqa: E402
from regional_lv.data import path as packaged  # noqa: E402
from regional_lv.data import segment_table  # noqa: E402
from regional_lv.emulators import OF_INPUTS  # noqa: E402
from regional_lv.errors import InputError  # noqa: E402
from regional_lv.study.faults import AGAIN, damage_of  # noqa: E402
from regional_lv.geometry.mesh_config import finer  # noqa: E402
from regional_lv.hearts import ONE_HEART  # noqa: E402
from regional_lv.hearts.listing import batches_of, list_hearts, model_of_hearts  # noqa: E402
from regional_lv.input_files import without_braces  # noqa: E402
from regional_lv.inputs.space import (  # noqa: E402
    Inputs,
    model_sections_of,
    sections_of,
    sections_of_stiffness,
)
from regional_lv.study.jobs import arguments_of, calls_of, module_of  # noqa: E402
from regional_lv.study.layout import Layout  # noqa: E402
from regional_lv.measured import states_noise  # noqa: E402
from regional_lv.inputs.stiffness import StiffnessInputs  # noqa: E402
from regional_lv.inputs.physics import physics_of, why_not_scaling  # noqa: E402
from regional_lv.data.published import (  # noqa: E402
    FILES,
    HEART_MESH,
    HEART_SEGMENTS,
    PUBLISHED,
    PUBLISHED_HEART,
    PUBLISHED_TABLES,
    TRAINING_INPUTS,
    TRAINING_OUTPUTS,
    VOLUNTEER,
    VOLUNTEER_SLICES,
    volunteer_available,
)
from regional_lv.paper.scenarios import labels_of  # noqa: E402
from regional_lv.simulation.scenarios import scenario_size, stiff_zones  # noqa: E402

# Of several configurations the last one counts first, for the paths in them too; those that were
# named count before the workflow's own.
CONFIG_FILES = [os.path.relpath(file) for file in workflow.overwrite_configfiles]
if not workflow.config_settings.replace_workflow_config:
    CONFIG_FILES = [
        *(file for file in map(os.path.relpath, workflow.configfiles) if file not in CONFIG_FILES),
        *CONFIG_FILES,
    ]
try:
    # Read anew: to Snakemake's parser 012 is ten, and of a key that occurs twice it takes the last.
    gathered = study_config.gather(CONFIG_FILES, workflow.config_settings.config)
    folders = [Path(file).parent for file in reversed(CONFIG_FILES)]
    config.update(study_config.load(gathered, ", ".join(CONFIG_FILES), folders))
except InputError as error:
    raise WorkflowError(str(error))

# Jobs find the plugins there, next to those that are set already.
os.environ["REGIONAL_LV_PLUGINS"] = os.pathsep.join(
    dict.fromkeys(
        [
            *filter(None, os.environ.get("REGIONAL_LV_PLUGINS", "").split(os.pathsep)),
            *(str(Path(plugin).resolve()) for plugin in config["plugins"]),
        ]
    )
)


envvars:
    "MPLBACKEND",
    "PYTHONPATH",
    "PYTHONSAFEPATH",
    "PYTHONUTF8",
    "PYTHONHASHSEED",
    "REGIONAL_LV_PLUGINS",


if workflow.is_main_process:
    running.begin(config["study"])

# Where everything lies.
LAYOUT = Layout.of(config["study"])
R = LAYOUT.folder


def given(path):
    """A file that the study does not make, as the input of a rule."""
    return without_braces(path, f"{R}/inputs")


LOGS = f"{R}/logs"
# The emulator of the stiffness alone that scenarios and the paper's figures use, in studies of
# tables the answers of subjects, too: `choose_final` makes it, where there is something to choose
# by.
EVALUATION = config["evaluation"]
EMULATOR = study_config.final_emulator(config)
# Read while the workflow is planned, where Snakemake would show a traceback.
SHORTLIST = LAYOUT.shortlist
if damage := damage_of(SHORTLIST):
    raise WorkflowError(f"{SHORTLIST}: damaged ({damage}); delete it and {AGAIN}")

# What is inferred and what is observed: the objects, and the plain values that rules hand over.
PARAMETERS = StiffnessInputs.from_config(config)
PARAMETER_SPEC = PARAMETERS.spec()
CHANNELS = Channels.from_config(config)
OUTPUTS = list(CHANNELS.names)
PHYSICS = physics_of(config)
SEGMENT_TABLE = given(os.path.relpath(segment_table(config["geometry"]["segments"])))

FROM_TABLES = config["simulations"]["source"] == "table"
TABLE_SETS = config["simulations"]["tables"]

SUBJECT_SOURCES = {
    name: subject["source"]
    for name, subject in config["subjects"].items()
    if subject["source"] != "published_volunteer" or volunteer_available(config)
}
SUBJECTS = list(SUBJECT_SOURCES)
# Subjects whose measured files give no sd of the strains, so that their noise is inferred.
NOISE_INFERRED = [
    name
    for name, source in SUBJECT_SOURCES.items()
    if source.startswith("published_")
    or (
        source == "file"
        and not states_noise(
            config["subjects"][name]["measured"],
            config["loading"]["pressure_mmhg"],
            config["subjects"][name]["segments"],
        )
    )
    or (source == "curves" and config["subjects"][name]["sd"]["strain"] is None)
]
SUBJECT_NUTS = study_config.nuts_of_subjects(config)
SYNTHETIC = [name for name, source in SUBJECT_SOURCES.items() if source == "synthetic"]

VOLUNTEERS = [name for name in SUBJECTS if SUBJECT_SOURCES[name] == "published_volunteer"]

# Without a simulator, those scenarios that come with tables.
SCENARIOS = {
    name: scenario
    for name, scenario in config["scenarios"]["sets"].items()
    if not FROM_TABLES or name in TABLE_SETS
}
NOISY = {f"{name}-noisy": name for name in SCENARIOS}
# Sets that point estimates and predictions are scored on: the test set, and what is held out of the
# training table beside it.
SCORED = ["test"]
if FROM_TABLES and "test" in TABLE_SETS and config["simulations"]["holdout"]:
    SCORED.append("holdout")
# Sets with a known truth whose posteriors are sampled, and how many cases each has.
SETS = {
    "test": (
        config["design"]["test"]
        if config["test_posteriors"]["cases"] == "all"
        else config["test_posteriors"]["cases"]
    ),
    **{name: scenario_size(scenario, PARAMETERS) for name, scenario in SCENARIOS.items()},
    **{noisy: scenario_size(SCENARIOS[name], PARAMETERS) for noisy, name in NOISY.items()},
}

HEALTHY = {
    "mean": config["scenarios"]["healthy_mean"],
    "sd": config["scenarios"]["healthy_sd"],
}

IMPORTED = config["geometry"]["imported"]
GIVEN_SURFACES = config["geometry"]["surfaces"]

# Meshes that are compared with one at least twice as fine as the study's in every direction.
STUDY_MESHES = {
    "coarse": {"circumferential": 16, "basal": 2, "apical": 1, "apex": 1, "transmural": 1},
    "one_apical_row": {"apical": 1, "apex": 1},
    "one_apical_row_one_layer": {"apical": 1, "apex": 1, "transmural": 1},
    "one_apical_row_three_layers": {"apical": 1, "apex": 1, "transmural": 3},
    "study": {},
    "fine": {"circumferential": 32, "basal": 4, "mid": 3, "apex": 1},
    "reference": {
        "circumferential": 48,
        "basal": 6,
        "basal_grading": 0.707,
        "mid": 4,
        "apical": 4,
        "apex": 4,
        "transmural": 4,
    },
}
# Uniform refinement: elements around, rows of each level and layers grow alike.
REFINEMENTS = {
    f"refinement/{n}/": {"circumferential": 16 * n}
    | dict.fromkeys(["basal", "mid", "apical", "apex", "transmural"], n)
    for n in (1, 2, 3)
}
# Meshes of the same ventricle, by the folder that they and what is solved on them are in.
MESHES = {
    "": config["mesh"],
    "finer/": finer(config["mesh"]),
    **{f"mesh_study/{name}/": config["mesh"] | own for name, own in STUDY_MESHES.items()},
    **{folder: config["mesh"] | own for folder, own in REFINEMENTS.items()},
}
ANCHORS = min(
    config["simulations"]["anchors"], config["design"]["natural"] + config["design"]["log"]
)


def mesh_of(wildcards):
    """Settings of one of the meshes."""
    return MESHES[wildcards.mesh_folder]


def imported_files():
    """The mesh to import and, if there is one, the file of its segments; by name."""
    if IMPORTED["file"] == PUBLISHED_HEART:
        return {
            "mesh": LAYOUT.published(HEART_MESH),
            "segments": LAYOUT.published(HEART_SEGMENTS),
        }
    files = {"mesh": IMPORTED["file"], "segments": IMPORTED["segments"]}
    return {name: given(path) for name, path in files.items() if path is not None}


def published_table(name, kind):
    """File of the `inputs` or `outputs` of a published set."""
    return LAYOUT.published(PUBLISHED_TABLES[name][kind])


def simulation_table(name, kind):
    """File of the `inputs` or `outputs` of a set that comes from a table; what has no table of its
    own is held out of `train`."""
    source = name if name in TABLE_SETS else "train"
    path = TABLE_SETS[source][kind]
    return published_table(source, kind) if path == PUBLISHED else given(path)


# By emulator and input transform, the name of its files: its own for the one that it is configured
# with, `<emulator>-<transform>` for the other.
TRANSFORMS = {
    name: {
        transform: (
            name
            if transform == config["emulators"][name]["input_transform"]
            else f"{name}-{transform}"
        )
        for transform in ("identity", "log")
    }
    for name in config["emulators"]["names"]
}
# By the name of its files, an emulator and its settings.
EMULATORS = {
    files: (name, config["emulators"][name] | {"input_transform": transform})
    for name, transforms in TRANSFORMS.items()
    for transform, files in transforms.items()
}

# Scales of the inputs on which emulators are compared by the simulations that they need.
SCALES = ["log", "identity"]
# Tables of finished simulations need not bring sensitivities; where an emulator is asked for that
# learns from them, they do (the config is checked for that).
EFFICIENCY_CURVES = [
    f"{emulator}-{transform}"
    for emulator in ("exact_gp", "gradient_gp")
    for transform in SCALES
    if emulator == "exact_gp" or not FROM_TABLES or emulator in config["emulators"]["names"]
]


# Priority of what a criticism waits for: its last steps follow one another on one core, and figures
# fill the others meanwhile.
FIRST = 1


def needs(mem_mb=1500, minutes=30):
    """Resources of a job that takes more than the default ones of profiles/slurm: resident memory
    and time, doubled with each attempt. Each is about twice the largest that was measured
    (results/<study>/benchmarks/costs.csv) at the paper's sizes; of what learns from simulations,
    with room for the 5,661 that the paper published. Those of verification and of the benchmark of
    hidden effects were not measured: theirs are estimates.
    """
    return {
        "mem_mb": lambda wildcards, attempt: mem_mb * 2 ** (attempt - 1),
        "runtime": lambda wildcards, attempt: minutes * 2 ** (attempt - 1),
    }


# Modules that decide how things are reported or called, never what comes out.
WITHOUT_EFFECT = {
    *("errors", "registry"),
    *(f"study.{module}" for module in ("jobs", "progress", "running", "surroundings")),
}


@cache
def code_of(*modules, files=()):
    """What stands for the code of library modules, all that they import, and the plugins.

    As a param, it makes what depends on code run again when that code changes. The files themselves,
    as inputs, would be some sixty per job: they doubled the time and the memory of planning.
    """
    own = dependencies.files(SOURCE, modules, without=WITHOUT_EFFECT)
    plugins = map(os.path.relpath, config["plugins"])
    return f"{modules[0]} {dependencies.digest([*own, *files, *plugins])}"


# By what the emulator of any heart takes surfaces and meshes into account.
DESCRIBED = os.path.relpath(packaged("described_surfaces.csv"))

# What functions require by these names, and rules need not say.
OF_STUDY = {
    "parameters": PARAMETER_SPEC,
    "channels": OUTPUTS,
    "physics": PHYSICS,
    "fibres": config["fibres"],
    "pressure_mmhg": config["loading"]["pressure_mmhg"],
    "strain_exponent": config["observables"]["strain_exponent"],
    "healthy": HEALTHY,
    "sampler": config["test_posteriors"]["sampler"],
    "nuts": config["nuts"],
    "point": config["map"],
    "adam_steps": config["estimates"]["adam_steps"],
    "hops": config["estimates"]["hops"],
    "study": config["study"],
    "seed": config["seed"],
}


def complete(steps):
    """Give every rule that calls functions values of the study that these require and that it does
    not say itself (`OF_STUDY`), and the code behind them as `code`."""
    for step in steps:
        calls = calls_of(step.params)
        parts = step.input, step.output, step.params
        for before, call in calls.items():
            wanted = dependencies.required(SOURCE, call)
            said = {*arguments_of(parts, before, wanted), *step.wildcard_names}
            missing = [name for name in wanted if name in OF_STUDY and name not in said]
            step.set_params(**{f"{before}{name}": OF_STUDY[name] for name in missing})
        if calls and "code" not in step.params.keys():
            step.set_params(code=code_of(*map(module_of, calls.values())))


def written(names):
    """As a param: the output of that name, or a list of several, which one call of a job writes and
    a later one reads."""
    if isinstance(names, str):
        return lambda wildcards, output: output[names]
    return lambda wildcards, output: [output[name] for name in names]


def page_of_criticism(job):
    """Params of a page: what `plots.criticism` draws in the same job."""
    return {f"{name}_picture": written(f"criticism/{job}.{name}") for name in CRITICISM_FIGURES} | {
        "extended": "" if FROM_TABLES else LAYOUT.extended("{subject}")
    }


def limitations_from(folder):
    """As a param: the page of limitations as seen from a folder; its braces are no wildcards."""
    return lambda wildcards: os.path.relpath(SOURCE.parent / "LIMITATIONS.md", folder)


def batches(size, per_batch):
    """Numbers of the batches that `size` items make: 0000, 0001, ..."""
    return [f"{i:04d}" for i in range(-(-size // per_batch))]


def posterior_batches(name):
    """Numbers of the batches of posteriors of a set."""
    return batches(SETS[name], config["nuts"]["cases_per_batch"])


def noise_prior_posteriors(wildcards):
    """A posterior for each scale; that of the study's own scale is there anyway."""
    clinical = config["clinical"]
    folder = f"{R}/posteriors/{wildcards.emulator}/subjects"
    return [
        (
            f"{folder}/{wildcards.subject}.nc"
            if scale == clinical["noise_prior_scale"]
            else f"{folder}/noise_prior/{wildcards.subject}-{scale}.nc"
        )
        for scale in clinical["noise_prior_scales"]
    ]


def posterior_files(emulator, name):
    """Files of the posteriors of a set."""
    return expand(LAYOUT.posteriors(emulator).batch(name, "{batch}"), batch=posterior_batches(name))


def local_scenarios(noisy):
    """Sets in which one zone is stiffened, with or without measurement noise."""
    names = [name for name, scenario in SCENARIOS.items() if scenario["kind"] == "local"]
    return [name for name, plain in NOISY.items() if plain in names] if noisy else names


def any_of(names):
    """Wildcard constraint: one of the names, and nothing else."""
    return "|".join(map(re.escape, names)) or "(?!)"


def subjects_from(source):
    """Wildcard constraint: the subjects of one source (or what no name can be)."""
    return any_of([name for name, where in SUBJECT_SOURCES.items() if where == source])


def volunteer_files(wildcards):
    """The volunteer's published file, and the slices' curves where one frame is asked for."""
    files = {"case": LAYOUT.published(VOLUNTEER)}
    if config["subjects"][wildcards.subject]["frame"] is not None:
        files["slices"] = [LAYOUT.published(path) for path in VOLUNTEER_SLICES]
    return files


def to_rank(name):
    """Files of every emulator that a ranking on the set `name` reads."""
    files = {
        "estimates": LAYOUT.estimates("{emulator}", name),
        "checked": LAYOUT.estimates_checked("{emulator}", name),
        "costs": LAYOUT.estimates_cost("{emulator}"),
        "fits": LAYOUT.fit("{emulator}"),
        "predictions": LAYOUT.predictions("{emulator}", name),
    }
    sets = {"train": LAYOUT.screened("train"), "test": LAYOUT.screened(name)}
    ranked = config["emulators"]["names"]
    return {kind: expand(path, emulator=ranked) for kind, path in files.items()} | sets


def shortlist():
    """Emulators whose posteriors on the test set are compared; if they are named, the ranking need
    not be there."""
    if named := config["emulators"]["shortlist"]["names"]:
        return named
    file = checkpoints.rank_emulators.get().output.shortlist
    return json.loads(Path(file).read_text())["shortlist"]


def of_shortlist(*files):
    """Files of the test set's posteriors, of every shortlisted emulator."""
    return [f"{R}/posteriors/{emulator}/test/{file}" for emulator in shortlist() for file in files]


def ventricle_of(wildcards):
    """Mesh that a synthetic subject is simulated on: the study's, or a finer one."""
    finer = config["synthetic_subjects"][wildcards.subject]["mesh"] == "finer"
    return LAYOUT.heart("finer/" if finer else "").mesh


def criticised(name):
    """Subjects that a criticism is of: those of a joint one, or the one of that name."""
    joint = config["criticism"]["joint"]
    return joint[name]["subjects"] if name in joint else [name]


def known_theta(name):
    """Tables of the known thetas of a joint criticism, if it has any."""
    joint = config["criticism"]["joint"].get(name, {})
    theta = joint.get("theta")
    if theta == "published":
        return expand(LAYOUT.known_theta("{subject}"), subject=joint["subjects"])
    return [] if theta is None else [given(theta)]


def made_by(*jobs, kind=""):
    """Files that jobs make (`MADE_BY_JOBS`), of all their subjects; of one kind, or of all."""
    return [
        path
        for name, made in MADE_BY_JOBS.items()
        if made["job"] in jobs and name.startswith(kind)
        for path in expand([*made["output"].values()], subject=OF_SUBJECTS.get(made["job"], [""]))
    ]


def of_report(made, key, path):
    """An output as it is, or with the place in the report that is its own."""
    if key not in made.get("reported", {}):
        return path
    return report(
        path,
        caption=f"../report/{made['reported'][key]}.rst",
        category=made["category"],
        subcategory="{subject}" if made["job"] in OF_SUBJECTS else None,
    )


def fields_of(names):
    """Of hearts of a cohort, what a job reads them by, without the line of a row, which others
    move."""
    return [vars(LISTED[name]) | {"line": None} for name in names]


def files_of_hearts(names):
    """The files that hearts of a cohort are made of."""
    return [given(file) for name in names for file in LISTED[name].files(OF_COHORT["folders"])]


def checked_files_of_hearts(names):
    """The same after all hearts were checked."""
    checkpoints.check_cohort.get()
    return files_of_hearts(names)


def rows_drawn(wildcards):
    """How many rows of the design there are up to the end of a batch. Every job draws them itself:
    the first rows of a longer design are the same, and full batches are not made again."""
    end = (int(wildcards.batch) + 1) * config["simulations"]["batch_size"]
    return min(end, INPUTS_SIZES[wildcards.set])


def anchors_of(wildcards):
    """How many anchors are solved on a mesh."""
    return FINER if wildcards.mesh_folder else INPUTS_ANCHORS


def own_emulator_of_inputs(_):
    """The study's, of what cannot do with that of any heart."""
    if JOINED:
        raise InputError(
            "all_inputs.emulator: the hidden effects need the study's own emulator; write joint_gp"
        )
    return EMULATOR_OF_INPUTS
