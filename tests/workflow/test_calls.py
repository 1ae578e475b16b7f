"""Every rule calls a function that there is, with the names of its arguments; rules make what the
layout of a study names; and the numbers that rules see are those of the configuration."""

import inspect
import json
import re
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from regional_lv.inputs.stiffness import ZONES
from regional_lv.seeds import derive
from regional_lv.study.jobs import NOT_PASSED, arguments_of, function_of
from regional_lv.study.layout import Layout
from tests.hearts.folders import NAMES, write_cohort
from tests.workflow.project import planned

LISTED = """
include: "{root}/Snakefile"

import json

from regional_lv.study.jobs import calls_of
from snakemake.io import is_flagged, strip_wildcard_constraints
from snakemake.iocontainers import Wildcards

for step in workflow.rules:
    print("OUTPUTS", json.dumps([*map(strip_wildcard_constraints, step.output)]))
    if step.script is not None:
        calls = calls_of(step.params)
        said = [name for part in (step.input, step.output, step.params) for name in part.keys()]
        # What an input function unpacks has its names only when a job is made.
        unpacks = any(is_flagged(item, "unpack") for item in step.input)
        code = "code" in step.params.keys()
        seen = step.name, calls, said, list(step.wildcard_names), unpacks, code
        print("RULE", json.dumps(seen))
    attempts = [step.expand_resources({{}}, [], attempt) for attempt in (1, 2)]
    if "runtime" in attempts[0].keys():
        print("NEEDS", json.dumps([step.name, *([a.mem_mb, a.runtime] for a in attempts)]))
    if step.is_checkpoint:
        print("CHECKPOINT", json.dumps([step.name, step.output[0]]))
    if step.name == "sample_posteriors":
        of, sets = step.params.noise, [Wildcards(fromdict={{"set": name}}) for name in SETS]
        print("NOISE", json.dumps({{s.set: of(s) if callable(of) else of for s in sets}}))
    if step.name == "answer_hearts":
        for batch, names in COHORT_BATCHES.items():
            print("READS", json.dumps([names, [*map(str, files_of_hearts(names))]]))
seed_of = study_config.seed_of_subject
print("SEEDS", json.dumps({{name: seed_of(config, name) for name in config["synthetic_subjects"]}}))
"""


def listed(tmp_path, snakefile: str, *arguments) -> subprocess.CompletedProcess:
    """Snakemake that lists the rules of `snakefile`, which may print."""
    (tmp_path / "Snakefile").write_text(snakefile)
    places = "--snakefile", tmp_path / "Snakefile", "--directory", tmp_path
    return planned("--list-rules", *places, *arguments)


@pytest.mark.parametrize(
    ("pressure", "warmup", "given", "expected"),
    [
        ("012", "0o764", ("--config", "nuts={chains: 03}"), ["SEES 12.0 500 700 3 2026"]),
        (
            *("1:30", "1_0", ()),
            [
                "mine.yaml: loading.pressure_mmhg: '1:30' is not a number; give the number",
                "mine.yaml: nuts.warmup: '1_0' is not a whole number; write it as 10,",
            ],
        ),
    ],
)
def test_rules_see_numbers_as_they_are_written(root, tmp_path, pressure, warmup, given, expected):
    """Snakemake's own parser takes 012 for ten, 1:30 for ninety and 1_0 for ten."""
    text = f"loading: {{pressure_mmhg: {pressure}}}\nnuts: {{warmup: {warmup}, draws: 0700}}\n"
    (tmp_path / "mine.yaml").write_text(f"study: mine\n{text}")
    keys = ("loading.pressure_mmhg", "nuts.warmup", "nuts.draws", "nuts.chains")
    seen = ['config["{}"]["{}"]'.format(*key.split(".")) for key in keys]
    files = (root / "config" / "quick.yaml", tmp_path / "mine.yaml")
    done = listed(
        tmp_path,
        f'include: "{root}/Snakefile"\nprint("SEES", {", ".join(seen)}, config["seed"])\n',
        "--configfile",
        *files,
        *given,
    )
    assert all(text in done.stdout + done.stderr for text in expected), done
    assert "Traceback" not in done.stdout + done.stderr


def test_a_mesh_that_is_kept_is_verified_without_finer_ones(root, tmp_path):
    (tmp_path / "heart.vtu").touch()
    imported = "{source: mesh, imported: {file: heart.vtu, remesh: false}}"
    own = tmp_path / "kept.yaml"
    own.write_text(
        f"study: kept\ngeometry: {imported}\nall_inputs: {{finer: 0}}\n"
        "criticism: {benchmark: {hearts: {misread: 0}}}\n"
    )
    places = "--snakefile", root / "Snakefile", "--directory", tmp_path
    done = planned("verify", *places, "--configfile", root / "config" / "smoke.yaml", own)
    rules = set(re.findall(r"^rule (\w+):", done.stdout + done.stderr, flags=re.MULTILINE))
    assert rules == {"verify_land", "plot_land", "verify"}, done


@pytest.fixture(scope="module")
def listing(root, tmp_path_factory):
    """What Snakemake prints of the rules of a study (names of configurations, or `cohort`)."""

    @cache
    def of(study: str) -> list[str]:
        folder = tmp_path_factory.mktemp("listed")
        files = [root / "config" / f"{name}.yaml" for name in study.split()]
        if study == "cohort":
            write_cohort(folder / "group")
            files = [folder / "group" / "config.yaml"]
        done = listed(folder, LISTED.format(root=root), "--configfile", *files)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout.splitlines()

    return of


def printed(lines: list[str], what: str) -> list:
    return [json.loads(line.removeprefix(what)) for line in lines if line.startswith(f"{what} ")]


def called(lines: list[str]) -> dict:
    """By rule: calls, names given, wildcards, whether it unpacks, whether it knows its code."""
    return {name: rest for name, *rest in printed(lines, "RULE")}


def disagreements(rules: dict) -> list[str]:
    """What rules do not give of what their functions take, or give beside it."""
    wrong = []
    for name, (calls, names, wildcards, unpacks, code) in rules.items():
        wrong += [f"{name} does not depend on its code"] if calls and not code else []
        unused = {*names} - NOT_PASSED
        for before, call in calls.items():
            function = function_of(call)
            arguments = inspect.signature(function).parameters
            given = {*arguments_of([dict.fromkeys(names)], before, arguments)}
            needed = {key for key, p in arguments.items() if p.default is p.empty}
            missing = set() if unpacks else needed - {*given, *wildcards}
            unknown = set() if hasattr(function, "__wrapped__") else given - set(arguments)
            unused -= given | {f"{before}{key}" for key in given}
            if missing or unknown:
                wrong.append(f"{name}, {call}: missing {missing}, unknown {unknown}")
        wrong += [f"{name}: {unused} is for none of its calls"] if calls and unused else []
    return wrong


JOINED = "smoke ../src/regional_lv/hearts/one_heart"


@pytest.mark.parametrize(
    "study", ["smoke", "published", "published_heart", "smoke examples/roles", JOINED]
)
def test_rules_and_functions_agree(listing, study):
    rules = called(listing(study))
    assert len(rules) > 30 and "criticise_subject" in rules
    assert ("simulate_inputs" in rules) == (study != "published")
    # Scripts of their own are for what a function cannot take from its rule.
    assert [name for name, (calls, *_) in rules.items() if not calls] == ["fetch_published"]
    assert disagreements(rules) == []


VOLUNTEERS = {
    "config": 1,
    "smoke": 0,  # it downloads nothing
    "heart_emulator": 0,
    "hidden_effects several_effects": 0,
    "hidden_effects volunteer_frames": 9,
    "paper_1500": 1,
    "published": 1,
    "published_criticism": 0,
    "published_faithful": 1,
    "published_heart": 1,
    "quick": 0,
    "sample_efficiency": 1,
    "study": 1,
}
"""Subjects of the repository's studies that are the published volunteer, without a mirror."""

DEEP = pytest.mark.test_all("`make test` lists the rules of five more studies without the network")


@pytest.mark.parametrize(
    "study",
    [pytest.param(s, marks=[] if s in ("config", "smoke") else DEEP) for s in VOLUNTEERS],
)
def test_planning_does_not_use_the_network(root, tmp_path, study):
    files = [root / "config" / f"{name}.yaml" for name in study.split()]
    places = "--snakefile", root / "Snakefile", "--directory", tmp_path
    done = planned(*places, "--quiet", "host", "--configfile", *files)
    assert done.returncode == 0, done.stdout + done.stderr
    imported = re.search(r"^import_volunteer +(\d+)$", done.stdout, flags=re.MULTILINE)
    assert int(imported[1] if imported else 0) == VOLUNTEERS[study]


def test_rules_of_a_cohort_and_their_functions_agree(listing):
    rules = called(listing("cohort"))
    assert {"check_cohort", "answer_hearts", "summarise_cohort", "make_cohort_page"} <= set(rules)
    assert disagreements(rules) == []


def test_resources_double_with_each_attempt(listing):
    needs = {name: attempts for name, *attempts in printed(listing("smoke"), "NEEDS")}
    assert needs["simulate_inputs"] == needs["simulate_batch"]
    assert needs["train_on_inputs"][0] == [6000, 240]
    for (memory, minutes), again in needs.values():
        assert again == [2 * memory, 2 * minutes]


def test_every_batch_of_a_cohort_reads_the_files_of_its_hearts(listing):
    """So that an edit of one makes its batch again, and no other; after the check, which is a
    checkpoint: Snakemake does not look at what depends on the pending output of another rule."""
    batches = printed(listing("cohort"), "READS")
    assert "check_cohort" in [name for name, _ in printed(listing("cohort"), "CHECKPOINT")]
    assert sorted(name for names, _ in batches for name in names) == sorted(NAMES)
    for names, files in batches:
        read = {Path(file).parent.name for file in files if file.endswith("measured.csv")}
        assert read == set(names)


def test_random_numbers_of_rules_are_those_of_the_library(listing):
    """Noise of synthetic subjects, each its own, as a session draws it; and of noisy sets alone."""
    (seeds,), (noise,) = printed(listing("quick"), "SEEDS"), printed(listing("smoke"), "NOISE")
    assert len(seeds) > 1
    assert seeds == {name: derive(2026, "subject", name) for name in seeds}
    assert noise["test"] is noise["local_3_0"] is None
    assert noise["local_3_0-noisy"]["circumferential"] > 0


SHOWS = """
include: "{root}/Snakefile"

import json

files = TABULATED.get("paper_comparison", {{}}).get("input", {{}}).get("volunteer", [])
seen = [name for name in PLOTS if name in ("roc", "bullseye_local", "bullseye_baseline")]
print("SHOWS", json.dumps([seen, sorted({{Path(file).parent.name for file in files}})]))
"""


@pytest.mark.parametrize(
    ("zones", "figures", "volunteer"),
    [
        ("paper", ["bullseye_local", "bullseye_baseline", "roc"], ["as_published"]),
        # Of the paper's names, over other segments: no comparison.
        (
            ZONES["paper"] | {"anterior": [1, 7, 13], "apical": [14, 15, 16, 17]},
            ["bullseye_local", "bullseye_baseline", "roc"],
            [],
        ),
        # No zone is left at baseline.
        ("whole", ["bullseye_local"], []),
    ],
)
def test_figures_and_comparison_are_those_that_a_study_can_have(
    root, tmp_path, zones, figures, volunteer
):
    """The paper's volunteer is not that of one frame."""
    of = {"source": "published_volunteer"}
    subjects = {"early": of | {"frame": 1}, "as_published": of}
    given = {"study": "mine", "parameters": {"zones": zones}, "subjects": subjects}
    (tmp_path / "mine.yaml").write_text(json.dumps(given))
    done = listed(tmp_path, SHOWS.format(root=root), "--configfile", tmp_path / "mine.yaml")
    assert printed(done.stdout.splitlines(), "SHOWS") == [[figures, volunteer]], done.stderr


def test_a_shortlist_that_is_missing_is_made_again(listing):
    """Snakemake asks for the first output of a checkpoint, in place of what waits for it."""
    assert printed(listing("smoke"), "CHECKPOINT") == [
        ["rank_emulators", Layout.of("smoke").shortlist]
    ]


BY_THE_COMMAND_LINE = {"claimed_by", "cut", "fast"}
"""What no rule makes."""


def named_paths(files) -> Iterator[str]:
    """All paths that a layout names, with a wildcard for each argument."""
    for name in sorted({*vars(files), *vars(type(files))} - {"folder", "of"} - BY_THE_COMMAND_LINE):
        if name.startswith("_"):
            continue
        found = getattr(files, name)
        if callable(found):
            found = found(*(f"{{{argument}}}" for argument in inspect.signature(found).parameters))
        if isinstance(found, str):
            yield found
        else:
            yield from named_paths(found)


def test_rules_make_every_file_that_the_layout_names(listing):
    outputs = {
        Path("/", *Path(output).parts[2:]).as_posix()  # below results/<study>
        for study in ("smoke", "published_heart", "cohort")
        for made in printed(listing(study), "OUTPUTS")
        for output in made
    }
    paths = [*named_paths(Layout(""))]
    assert len(paths) > 40
    for path in paths:
        pattern = re.compile(re.sub(r"\\{\w+\\}", ".*", re.escape(path)))
        in_folder = any(path.startswith(f"{output}/") for output in outputs)
        assert in_folder or any(map(pattern.fullmatch, outputs)), path
