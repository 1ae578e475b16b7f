"""A study on finished simulations: what is planned, and what stops it."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from regional_lv.channels import Channels
from regional_lv.inputs.stiffness import StiffnessInputs
from tests.workflow.project import copy_project

MECHANICS = {
    *("make_mesh", "solve_baseline", "make_design", "solve_anchors", "fit_predictor"),
    *("simulate_batch", "simulate_estimates", "simulate_subject"),
}


@pytest.fixture
def study(root, tmp_path) -> Path:
    """A copy of the project with a config for random simulations in two CSV files."""
    project = copy_project(root, tmp_path / "project")
    rng = np.random.default_rng(1)
    tables = {
        "inputs": pd.DataFrame(
            rng.uniform(0.1, 5, (40, 10)), columns=list(StiffnessInputs().names)
        ),
        "outputs": pd.DataFrame(rng.normal(size=(40, 52)), columns=list(Channels.of().names)),
    }
    for name, table in tables.items():
        table.to_csv(project / f"{name}.csv", index=False)
    paths = {name: f"{name}.csv" for name in tables}
    config = {
        "study": "tables",
        "simulations": {"source": "table", "tables": {"train": paths}, "holdout": 6},
        "emulators": {"names": ["exact_gp", "dnn"], "shortlist": {"names": ["exact_gp"]}},
        "estimates": {"both_transforms": True},
        "subjects": {},
        "synthetic_subjects": {},
    }
    (project / "tables.yaml").write_text(yaml.safe_dump(config))
    return project


def plan(study: Path) -> tuple[int, str]:
    """Exit status and output of a dry run."""
    command = [sys.executable, "-m", "snakemake", "--cores", "1", "--dry-run"]
    done = subprocess.run(
        [*command, "--configfile", "tables.yaml"],
        cwd=study,
        capture_output=True,
        text=True,
        timeout=300,
    )
    return done.returncode, done.stdout + done.stderr


def test_no_rule_needs_the_simulator(study):
    status, output = plan(study)
    assert status == 0, output[-3000:]
    rules = set(re.findall(r"^(?:local)?(?:rule|checkpoint) (\w+):", output, flags=re.MULTILINE))
    assert {"import_simulations", "judge_emulator", "rank_emulators"} <= rules
    assert {"fit_reference", "sample_posteriors", "compare_transforms"} <= rules
    assert not rules & MECHANICS
    for emulator in ("dnn", "dnn-identity"):
        assert f"results/tables/estimates/{emulator}/test.parquet" in output


def test_rows_held_out_beside_a_test_table_are_scored_and_nothing_else(study):
    config = yaml.safe_load((study / "tables.yaml").read_text())
    config["simulations"]["tables"]["test"] = config["simulations"]["tables"]["train"]
    (study / "tables.yaml").write_text(yaml.safe_dump(config))
    status, output = plan(study)
    assert status == 0, output[-3000:]
    users = set(
        re.findall(
            r"^(?:local)?(?:rule|checkpoint) (\w+):\n    input: [^\n]*screening/holdout\.parquet",
            output,
            flags=re.MULTILINE,
        )
    )
    assert users == {"judge_emulator", "fit_reference", "rank_emulators_on_holdout"}
    assert "results/tables/estimates/dnn/holdout_checked.parquet" in output
    assert "results/tables/posteriors/final/holdout" not in output
    config["simulations"]["holdout"] = 0
    (study / "tables.yaml").write_text(yaml.safe_dump(config))
    status, output = plan(study)
    assert status == 0 and "holdout" not in output.replace("simulations.holdout", "")


def test_a_bad_table_stops_before_anything_runs(study):
    table = pd.read_csv(study / "outputs.csv")
    table.loc[3, "radial_02"] = np.nan
    table.to_csv(study / "outputs.csv", index=False)
    status, output = plan(study)
    assert status != 0
    assert "outputs.csv: row 4, column radial_02" in output and "Traceback" not in output
