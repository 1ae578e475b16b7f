"""Every rule calls a function that there is, with the names of its arguments; and the numbers that
rules see are those of the configuration."""

import os
import subprocess
import sys

import pytest

from tests.hearts.folders import write_cohort

CHECK = """
include: "{root}/Snakefile"

import inspect

from regional_lv.jobs import NOT_PASSED, function_of
from snakemake.io import is_flagged

for step in workflow.rules:
    call = step.params.get("call")
    if call is None:
        if step.script is not None:
            print("SCRIPT", step.name)
        continue
    arguments = inspect.signature(function_of(call)).parameters
    parts = (step.input, step.output, step.params)
    given = {{name for part in parts for name in part.keys()}} - NOT_PASSED
    needed = {{name for name, p in arguments.items() if p.default is p.empty}}
    # What an input function unpacks has its names only when a job is made.
    unpacks = any(is_flagged(item, "unpack") for item in step.input)
    missing = set() if unpacks else needed - given - set(step.wildcard_names)
    decorated = hasattr(function_of(call), "__wrapped__")
    unknown = set() if decorated else given - set(arguments)
    print("CALL", step.name)
    if missing or unknown:
        print("WRONG", step.name, call, "missing:", sorted(missing), "unknown:", sorted(unknown))
    if "code" not in step.params.keys():
        print("WRONG", step.name, "does not depend on its code")
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
    ("pressure", "given", "expected"),
    [
        ("012", (), "SEES 12.0 700 2 2026"),
        ("0o14", ("--config", "seed=7", "nuts={chains: 03}"), "SEES 12.0 700 3 7"),
        ("1:30", (), "mine.yaml: loading.pressure_mmhg: '1:30' is not a number; give the number"),
        ("1_0", (), "mine.yaml: loading.pressure_mmhg: '1_0' is not a number; write it as 10,"),
    ],
)
def test_rules_see_numbers_as_they_are_written(root, tmp_path, pressure, given, expected):
    """Snakemake's own parser takes 012 for ten, 1:30 for ninety and 1_0 for ten."""
    text = f"study: mine\nloading: {{pressure_mmhg: {pressure}}}\nnuts: {{draws: 0700}}\n"
    (tmp_path / "mine.yaml").write_text(text)
    keys = (("loading", "pressure_mmhg"), ("nuts", "draws"), ("nuts", "chains"))
    seen = [f'config["{section}"]["{key}"]' for section, key in keys]
    files = (root / "config" / "quick.yaml", tmp_path / "mine.yaml")
    done = listed(
        tmp_path,
        f'include: "{root}/Snakefile"\nprint("SEES", {", ".join(seen)}, config["seed"])\n',
        *("--configfile", *files, *given),
    )
    assert expected in done.stdout + done.stderr
    assert "Traceback" not in done.stdout + done.stderr


@pytest.mark.parametrize("study", ["smoke", "published", "published_heart", "smoke examples/roles"])
def test_rules_and_functions_agree(root, tmp_path, study):
    files = [root / "config" / f"{name}.yaml" for name in study.split()]
    done = listed(tmp_path, CHECK.format(root=root), "--configfile", *files)
    lines = done.stdout.splitlines()
    assert done.returncode == 0, done.stdout + done.stderr
    assert not [line for line in lines if line.startswith("WRONG")], "\n".join(lines)
    assert sum(line.startswith("CALL") for line in lines) > 30
    assert ("CALL conclude_criticism" in lines) == (study != "published")
    # Scripts of their own are for what a function cannot take from its rule.
    assert [line for line in lines if line.startswith("SCRIPT")] == ["SCRIPT fetch_published"]


def test_rules_of_a_cohort_and_their_functions_agree(root, tmp_path):
    write_cohort(tmp_path / "group")
    done = listed(
        tmp_path, CHECK.format(root=root), "--configfile", tmp_path / "group" / "config.yaml"
    )
    lines = done.stdout.splitlines()
    assert done.returncode == 0, done.stdout + done.stderr
    of_cohort = {"check_cohort", "answer_hearts", "summarise_cohort", "make_cohort_page"}
    assert {f"CALL {name}" for name in of_cohort} <= set(lines)
    assert not [line for line in lines if line.startswith("WRONG")], "\n".join(lines)
