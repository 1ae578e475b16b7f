"""Every rule calls a function that there is, with the names of its arguments."""

import os
import subprocess
import sys

import pytest

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


@pytest.mark.parametrize("study", ["smoke", "published", "published_heart"])
def test_rules_and_functions_agree(root, tmp_path, study):
    (tmp_path / "Snakefile").write_text(CHECK.format(root=root))
    done = subprocess.run(
        [
            *(sys.executable, "-m", "snakemake", "--dry-run", "--list-rules"),
            *("--snakefile", tmp_path / "Snakefile", "--directory", tmp_path),
            *("--configfile", root / "config" / f"{study}.yaml"),
        ],
        capture_output=True,
        text=True,
        timeout=300,
        # Spares asking the network for the published volunteer.
        env=os.environ | {"REGIONAL_LV_REPOSITORY_ANSWERS": "yes"},
    )
    lines = done.stdout.splitlines()
    assert done.returncode == 0, done.stdout + done.stderr
    assert not [line for line in lines if line.startswith("WRONG")], "\n".join(lines)
    assert sum(line.startswith("CALL") for line in lines) > 30
    # Scripts of their own are for what a function cannot take from its rule.
    assert [line for line in lines if line.startswith("SCRIPT")] == ["SCRIPT fetch_published"]
