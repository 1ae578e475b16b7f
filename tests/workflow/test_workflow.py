"""The workflow, run as users run it: the smoke study from mesh to report, then edits and reruns.

One copy of the project is run with two cores, killed on its way and finished; it serves all tests.
`tests/faults` compares a killed run with an undisturbed one, table by table.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import pandas as pd
import pytest
import yaml

from regional_lv import data
from regional_lv.manifest import checksum
from tests.workflow.lint import findings
from tests.workflow.project import copy_project, run, start
from tests.workflow.same import assert_same, tables

BATCHES = "results/smoke/simulations/train"

REMADE = {
    "criticism/synthetic_lateral/findings.json": ["criticism/synthetic_lateral/**/*"],
    "posteriors/final/local_3_0-noisy/auc.csv": ["posteriors/final/local_3_0-noisy/*"],
    "posteriors/final/subjects/synthetic_lateral.csv": [
        "posteriors/final/subjects/synthetic_lateral*"
    ],
    "emulators/exact_gp/test_errors.csv": ["emulators/exact_gp.pt", "emulators/exact_gp/*"],
    "screening/test.parquet": ["simulations/test/*", "screening/test*"],
}
"""What is made again with one core: the target, and what is removed for it. From the end of the
study to its beginning, so that nothing else is out of date."""


def planned(project: Path) -> set[str]:
    """Rules that a dry run would run."""
    output = run(project, "--cores", "1", "--dry-run")
    return set(re.findall(r"^(?:local)?(?:rule|checkpoint) (\w+):", output, flags=re.MULTILINE))


def edit_config(project: Path, change) -> None:
    path = project / "config" / "smoke.yaml"
    config = yaml.safe_load(path.read_text())
    change(config)
    path.write_text(yaml.safe_dump(config))


class Killed(NamedTuple):
    """A copy whose study was killed; a batch of simulations that it had finished, and when."""

    project: Path
    batch: Path
    finished_ns: int


@pytest.fixture(scope="module")
def killed(root, tmp_path_factory) -> Killed:
    """A copy in which the smoke study was started with two cores and killed."""
    project = copy_project(root, tmp_path_factory.mktemp("study") / "project")
    process = start(project, "--cores", "2")
    deadline = time.monotonic() + 600
    while len(written := list((project / BATCHES).glob("*.parquet"))) < 3:
        assert time.monotonic() < deadline and process.poll() is None, f"{BATCHES}: {written}"
        time.sleep(0.2)
    # With two jobs at a time, that of the first batch has ended when the third is written.
    first = min(written, key=lambda p: p.stat().st_mtime_ns)
    finished_ns = first.stat().st_mtime_ns
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    return Killed(project, first, finished_ns)


@pytest.fixture(scope="module")
def study(killed) -> Path:
    """The same copy, finished with two cores."""
    run(killed.project, "--cores", "2")
    return killed.project


@pytest.fixture
def editable(study):
    """The same copy; what a test edits is put back."""
    kept = {
        p: p.read_bytes()
        for d in ("config", "src")
        for p in (study / d).rglob("*.*")
        if p.is_file() and "__pycache__" not in p.parts
    }
    yield study
    for path, content in kept.items():
        if path.read_bytes() != content:
            path.write_bytes(content)


SIMULATING = {
    "make_mesh",
    "solve_baseline",
    "make_design",
    "solve_anchors",
    "fit_predictor",
    "simulate_batch",
    "simulate_subject",
}


# Some draws of the posteriors go through the simulator again.
UNTOUCHED_BY_POSTERIORS = (SIMULATING - {"simulate_batch"}) | {"train_emulator", "fit_reduction"}


def test_everything_is_made(study):
    results = study / "results" / "smoke"
    config = yaml.safe_load((study / "config" / "smoke.yaml").read_text())
    for figure in (
        *("zones", "strain_field", "design", "explained_variance", "parity", "recovery"),
        *("uncertainty", "emulator_traces", "emulator_traces_all", "sbc", "resimulation"),
        *("bullseye_local", "bullseye_baseline-noisy", "map_errors", "roc", "hpd_widths"),
        *("zone_correlations", "correlations/local_3_0-noisy"),
    ):
        assert (results / "figures" / f"{figure}.png").stat().st_size > 10_000
        assert (results / "figures" / f"{figure}.csv").stat().st_size > 0
    kept = pd.read_parquet(results / "screening" / "train.parquet")
    assert len(kept) == config["design"]["natural"] + config["design"]["log"]
    assert kept["sensitivity"].map(len).eq(520).all()
    truth = json.loads((results / "truth" / "synthetic_lateral.json").read_text())
    assert truth["theta"]["C_a_lateral"] == 2.0
    measured = pd.read_csv(results / "measured" / "synthetic_lateral.csv")
    assert measured["source"].str.contains("synthetic").all()
    assert list(results.glob("posteriors/final/subjects/synthetic_lateral.nc"))
    assert list((results / "logs").rglob("*.log"))
    compared = pd.read_csv(results / "tables" / "paper_comparison.csv")
    assert set(compared["quantity"][compared["ours"].notna()]) >= {
        *("simulations_kept", "parameter_mse", "output_mse", "rhat", "ess", "zone_correlation")
    }
    page = (results / "tables" / "paper_comparison.md").read_text()
    assert all(f"## Table S{number}\n" in page for number in range(1, 7))
    best = json.loads((results / "estimates" / "shortlist.json").read_text())["shortlist"]
    sampled = pd.read_csv(results / "figures" / "uncertainty.csv")["emulator"]
    assert set(sampled) == {*best, "dnn"} and len(best) == 1
    costs = pd.read_csv(results / "benchmarks" / "costs.csv").set_index("step")
    assert costs.loc["simulations/train", "jobs"] == len(list(results.glob("simulations/train/*")))
    assert costs.loc["all", "wall_s"] == pytest.approx(costs["wall_s"][:-1].sum(), abs=1)


def test_manifest_agrees_with_the_results(study):
    verify = [sys.executable, "-c", "from regional_lv.cli import main; main()", "verify"]
    done = subprocess.run(
        [*verify, "results/smoke"], cwd=study, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_report_is_one_page(study):
    run(study, "--report", "report.html")
    page = (study / "report.html").read_text()
    assert "bullseye" in page and len(page) > 500_000


def test_unedited_study_has_nothing_to_do(study):
    assert planned(study) == set()


def test_draws_rerun_posteriors_only(editable):
    edit_config(editable, lambda c: c["nuts"].update(draws=160))
    rules = planned(editable)
    assert {"sample_posteriors", "sample_subject", "plot_traces"} <= rules
    assert not rules & UNTOUCHED_BY_POSTERIORS


def test_inference_module_reruns_posteriors_only(editable):
    module = editable / "src" / "regional_lv" / "inference" / "nuts.py"
    module.write_text(module.read_text() + "\n# edited\n")
    rules = planned(editable)
    assert {"sample_posteriors", "sample_subject"} <= rules
    assert not rules & UNTOUCHED_BY_POSTERIORS


def test_mesh_reruns_everything_after_it(editable):
    edit_config(editable, lambda c: c["mesh"].update(apex=2))
    rules = planned(editable)
    assert {
        "make_mesh",
        "solve_baseline",
        "solve_anchors",
        "fit_predictor",
        "simulate_batch",
        "screen_simulations",
        "fit_reduction",
        "train_emulator",
        "sample_posteriors",
        "simulate_subject",
        "plot_zones",
    } <= rules
    assert "make_design" not in rules


def test_mesh_of_hypotheses_reruns_the_criticism_only(editable):
    """Their own mesh, its anchors and what is concluded; no posterior rests on it."""
    elements = {
        folder: json.loads((editable / f"results/smoke/geometry/{folder}summary.json").read_text())
        for folder in ("", "extensions/")
    }
    assert elements["extensions/"]["elements"] > elements[""]["elements"]
    edit_config(editable, lambda c: c["criticism"]["mesh"].update(mid=3))
    rules = planned(editable)
    assert {"make_mesh", "solve_anchors", "simulate_extension", "train_extension"} <= rules
    assert "conclude_criticism" in rules
    assert not rules & {"fit_predictor", "simulate_batch", "train_emulator", "sample_subject"}


def test_figure_module_reruns_that_figure_only(editable):
    module = editable / "src" / "regional_lv" / "plots" / "parity.py"
    module.write_text(module.read_text() + "\n# edited\n")
    assert planned(editable) - {"all"} == {*("plot_parity", "tabulate_costs", "write_manifest")}


def test_bounds_rerun_what_they_bound_but_not_the_mesh(editable):
    edit_config(editable, lambda c: c.update(parameters={"bounds": {"C_a": [0.2, 5.0]}}))
    rules = planned(editable)
    assert {"make_design", "solve_baseline", "simulate_batch", "train_emulator"} <= rules
    assert "make_mesh" not in rules


def test_plugin_counts_as_code_of_every_step(editable):
    plugin = editable / "config" / "mine.py"
    plugin.write_text("ANSWER = 42\n")
    edit_config(editable, lambda c: c.update(plugins=["config/mine.py"]))
    assert SIMULATING <= planned(editable)
    plugin.write_text("nonsense()\n")
    output = run(editable, "--cores", "1", "--dry-run", check=False)
    assert "mine.py fails" in output and "Traceback" not in output
    plugin.unlink()


def test_typo_in_the_config_names_key_and_remedy(editable):
    edit_config(editable, lambda c: c["nuts"].update(drwas=10))
    output = run(editable, "--cores", "1", "--dry-run", check=False)
    assert "drwas" in output and "draws" in output
    assert "Traceback" not in output


def test_bad_geometry_table_stops_before_anything_runs(editable):
    table = pd.read_csv(data.path("volunteer_segments.csv"))
    table["wall_thickness_mm"] /= 10
    table.to_csv(editable / "in_cm.csv", index=False)
    edit_config(editable, lambda c: c.update(geometry={"segments": "in_cm.csv"}))
    output = run(editable, "--cores", "1", "--dry-run", check=False)
    assert "in_cm.csv" in output and "cm" in output
    assert "wall_thickness_mm" in output


def test_bad_measured_file_stops_before_anything_runs(editable):
    path = editable / "patient.csv"
    path.write_text(
        "quantity,segment,value,unit\nvolume,,150,mL\ncircumferential,1,-0.16,1\n"
        "circumferential,1,-0.17,1\n"
    )
    edit_config(
        editable,
        lambda c: c.update(subjects={"patient": {"source": "file", "measured": "patient.csv"}}),
    )
    output = run(editable, "--cores", "1", "--dry-run", check=False)
    assert "patient.csv" in output and "4" in output


def test_what_a_killed_run_had_finished_is_kept(study, killed):
    assert killed.batch.stat().st_mtime_ns == killed.finished_ns, f"{killed.batch} was made again"


@pytest.mark.parametrize("target", REMADE)
def test_one_core_gives_the_same_files(study, tmp_path, target):
    """Bit by bit, figures and pages too; the manifest names apart what also holds times."""
    results, kept = study / "results/smoke", tmp_path / "kept"
    made = json.loads((results / "manifest.json").read_text())["files"]
    for path in [path for pattern in REMADE[target] for path in results.glob(pattern)]:
        if path.is_file():
            own = kept / path.relative_to(results)
            own.parent.mkdir(parents=True, exist_ok=True)
            shutil.move(path, own)
    run(study, "--cores", "1", f"results/smoke/{target}")
    moved = (path.relative_to(kept) for path in kept.rglob("*"))
    again = {name for name in moved if (results / name).is_file()}
    assert Path(target) in again
    for name in tables(kept) & again:
        assert_same(kept / name, results / name)
    for name in again & set(map(Path, made)):
        assert checksum(results / name) == made[str(name)], name


def test_lint(root, tmp_path):
    assert findings("config/smoke.yaml")[0] == []
    # What is found elsewhere is not accepted: a rule without a log.
    copy_project(root, tmp_path / "project")
    rules = tmp_path / "project/workflow/rules/reduction.smk"
    rules.write_text(re.sub(r"    log:\n.*\n", "", rules.read_text()))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path / "project")
        assert any("log" in text for text in findings("config/smoke.yaml")[0])
