"""No step of the criticism reads a truth, but for those that score the benchmark."""

import os
import re
import subprocess
import sys

import pytest

ALLOWED = {"sample_true_models", "score_benchmark"}
JOB = re.compile(r"^(?:local)?rule (\w+):\n((?:    .*\n)+)", flags=re.MULTILINE)


@pytest.fixture(scope="module")
def jobs(root, tmp_path_factory):
    """(rule, inputs, outputs) of every job that the pages and the benchmark need."""
    environment = os.environ | {"PYTHONPATH": str(root / "src")}
    folder = tmp_path_factory.mktemp("dry")
    command = (sys.executable, "-m", "snakemake", "--dry-run", "--forceall", "--cores", "1")
    done = subprocess.run(
        [
            *command,
            *("--snakefile", str(root / "Snakefile"), "--directory", str(root), "--nolock"),
            *("criticism", "hidden_effects", "--configfile", str(root / "config/smoke.yaml")),
        ],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    found = []
    for name, body in JOB.findall(done.stdout + done.stderr):
        files = {}
        for kind in ("input", "output"):
            line = re.search(rf"^    {kind}: (.*)$", body, flags=re.MULTILINE)
            files[kind] = [f.strip() for f in line.group(1).split(",")] if line else []
        found.append((name, files["input"], files["output"]))
    return found


def test_the_walk_sees_what_it_should(jobs):
    rules = {name for name, _, _ in jobs}
    assert {"criticise_subject", "criticise_hearts"} <= rules
    assert any("/truth/" in f for _, _, outputs in jobs for f in outputs)


def test_only_the_score_reads_a_truth(jobs):
    readers = {name for name, inputs, _ in jobs if any("/truth/" in f for f in inputs)}
    assert readers == ALLOWED


def test_hearts_are_simulated_on_a_finer_mesh_than_they_are_criticised_on(jobs):
    """Or the criticism would rest on errors of discretisation that both share."""
    meshes = {
        rule: {f for name, inputs, _ in jobs if name == rule for f in inputs if "mesh" in f}
        for rule in ("inject_hearts", "criticise_hearts")
    }
    assert all(meshes.values()) and not set.intersection(*meshes.values()), meshes


def test_nothing_upstream_of_findings_reads_a_truth(jobs):
    made_by = {f: (name, inputs) for name, inputs, outputs in jobs for f in outputs}
    waiting = [f for f in made_by if "findings" in f]
    assert waiting
    seen = set()
    while waiting:
        name, inputs = made_by[waiting.pop()]
        for file in inputs:
            assert "/truth/" not in file, f"{name} reads {file}"
            if file in made_by and file not in seen:
                seen.add(file)
                waiting.append(file)
