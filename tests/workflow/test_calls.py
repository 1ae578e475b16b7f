"""Every rule calls a function that there is, with the names of its arguments; and the numbers that
rules see are those of the configuration."""

import inspect
import json
import os
import subprocess
import sys

import pytest

from regional_lv.study.jobs import NOT_PASSED, arguments_of, function_of
from tests.hearts.folders import write_cohort

LISTED = """
include: "{root}/Snakefile"

import json

from regional_lv.study.jobs import calls_of
from snakemake.io import is_flagged

for step in workflow.rules:
    if step.script is not None:
        calls = calls_of(step.params)
        given = [name for part in (step.input, step.output, step.params) for name in part.keys()]
        # What an input function unpacks has its names only when a job is made.
        unpacks = any(is_flagged(item, "unpack") for item in step.input)
        code = "code" in step.params.keys()
        seen = step.name, calls, given, list(step.wildcard_names), unpacks, code
        print("RULE", json.dumps(seen))
"""


def listed(tmp_path, snakefile: str, *arguments) -> subprocess.CompletedProcess:
    """Snakemake that lists the rules of `snakefile`, which may print."""
    (tmp_path / "Snakefile").write_text(snakefile)
    return subprocess.run(
        [
            *(sys.executable, "-m", "snakemake", "--dry-run", "--list-rules"),
            *("--snakefile", tmp_path / "Snakefile", "--directory", tmp_path, *arguments),
        ],
        capture_output=True,
        text=True,
        timeout=300,
        # Spares asking the network for the published volunteer.
        env=os.environ | {"REGIONAL_LV_REPOSITORY_ANSWERS": "yes"},
    )


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
        *("--configfile", *files, *given),
    )
    assert all(text in done.stdout + done.stderr for text in expected), done
    assert "Traceback" not in done.stdout + done.stderr


def listed_rules(root, folder, *files) -> dict:
    """By rule: calls, names given, wildcards, whether it unpacks, whether it knows its code."""
    done = listed(folder, LISTED.format(root=root), "--configfile", *files)
    assert done.returncode == 0, done.stdout + done.stderr
    lines = [line for line in done.stdout.splitlines() if line.startswith("RULE ")]
    return {name: rest for name, *rest in (json.loads(line[5:]) for line in lines)}


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


@pytest.mark.parametrize("study", ["smoke", "published", "published_heart", "smoke examples/roles"])
def test_rules_and_functions_agree(root, tmp_path, study):
    files = [root / "config" / f"{name}.yaml" for name in study.split()]
    rules = listed_rules(root, tmp_path, *files)
    assert len(rules) > 30 and ("criticise_subject" in rules) == (study != "published")
    # Scripts of their own are for what a function cannot take from its rule.
    assert [name for name, (calls, *_) in rules.items() if not calls] == ["fetch_published"]
    assert disagreements(rules) == []


def test_rules_of_a_cohort_and_their_functions_agree(root, tmp_path):
    write_cohort(tmp_path / "group")
    rules = listed_rules(root, tmp_path, tmp_path / "group" / "config.yaml")
    assert {"check_cohort", "answer_hearts", "summarise_cohort", "make_cohort_page"} <= set(rules)
    assert disagreements(rules) == []
