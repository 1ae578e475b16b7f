"""The workflow, run as users run it: the smoke study from mesh to report, then edits and reruns.

A copy of the small study, which was killed on its way (`tests/small.py`), is finished with two
cores and serves all tests. `tests/faults` compares a killed run with an undisturbed one, table by
table.
"""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
import yaml

from regional_lv import data
from regional_lv.study.manifest import checksum
from tests.small import Small, edit_config
from tests.workflow.lint import findings
from tests.workflow.project import copy_project, run
from tests.workflow.same import assert_same, tables

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

DEEP = pytest.mark.test_all("the same as for the other stages; half a minute each")


def planned(project: Path) -> set[str]:
    """Rules that a dry run would run."""
    output = run(project, "--cores", "1", "--dry-run")
    return set(re.findall(r"^(?:local)?(?:rule|checkpoint) (\w+):", output, flags=re.MULTILINE))


@pytest.fixture(scope="module")
def killed(small_study, tmp_path_factory) -> Small:
    """A copy of the small study, of which the simulations are there."""
    return small_study.copy(tmp_path_factory.mktemp("study") / "project")


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


SHOWN = {
    "zones": ("segment", 17),
    "strain_field": ("direction", 3),
    "design": ("scale", 2),
    "explained_variance": ("component", 51),
    "parity": ("output", 52),
    "recovery": ("case", 2),
    "uncertainty": ("emulator", 2),
    "emulator_traces": ("parameter", 2),
    "emulator_traces_all": ("parameter", 10),
    "sbc": ("parameter", 11),
    "resimulation": ("case", 2),
    "bullseye_local": ("zone", 5),
    "bullseye_baseline-noisy": ("zone", 5),
    "map_errors": ("noise", 2),
    "roc": ("zone", 6),
    "hpd_widths": ("noise", 2),
    "zone_correlations": ("zone_1", 5),
    "correlations/local_3_0-noisy": ("parameter_2", 10),
}
"""Of figures, a column of the data beside them and how many values it has."""


# Some draws of the posteriors go through the simulator again.
UNTOUCHED_BY_POSTERIORS = (SIMULATING - {"simulate_batch"}) | {"train_emulator", "show_design"}


def test_everything_is_made(study):
    results = study / "results" / "smoke"
    config = yaml.safe_load((study / "config" / "smoke.yaml").read_text())
    for figure, (column, values) in SHOWN.items():
        data = pd.read_csv(results / "figures" / f"{figure}.csv")
        assert data[column].nunique() == values, figure
        picture = matplotlib.image.imread(results / "figures" / f"{figure}.png")
        assert np.ptp(picture[..., :3], axis=(0, 1)).min() > 0.5, f"{figure} is blank"
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
    chosen = json.loads((results / "estimates" / "shortlist.json").read_text())
    sampled = pd.read_csv(results / "figures" / "uncertainty.csv")["emulator"]
    assert set(sampled) == {*chosen["best_of_ranking"], "dnn"} == set(chosen["shortlist"])
    assert len(chosen["best_of_ranking"]) == 1
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
    assert {"sample_posteriors", "sample_subject", "show_subject_as_it_is"} <= rules
    assert not rules & UNTOUCHED_BY_POSTERIORS


def test_a_module_of_the_sampler_reruns_posteriors_only(editable):
    module = editable / "src" / "regional_lv" / "paper" / "sampler" / "nuts.py"
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
        "show_design",
        "train_emulator",
        "sample_posteriors",
        "simulate_subject",
        "show_heart",
    } <= rules
    assert "make_design" not in rules


def test_roles_rerun_what_is_over_all_inputs_only(editable):
    """The paper's emulators and posteriors know nothing of them."""
    edit_config(editable, lambda c: c["inputs"].update(epicardial_support="suspected"))
    rules = planned(editable)
    assert {"solve_inputs_anchors", "simulate_inputs", "train_on_inputs"} <= rules
    assert {"criticise_subject", "show_subject"} <= rules
    assert not rules & {"make_mesh", "simulate_batch", "train_emulator", "sample_subject"}


def test_a_longer_design_fills_its_last_batch_and_leaves_the_full_ones(editable):
    edit_config(editable, lambda c: c["all_inputs"].update(simulations=40, test=6))
    output = run(editable, "--cores", "1", "--dry-run")
    batch = r"^    output: .*all_inputs/simulations/(\w+)/batch-(\d+)"
    made = re.findall(batch, output, flags=re.MULTILINE)
    assert sorted(made) == [("test", "0000"), ("train", "0001")]


def test_figure_module_reruns_the_job_of_that_figure_only(editable):
    module = editable / "src" / "regional_lv" / "paper" / "plots" / "parity.py"
    module.write_text(module.read_text() + "\n# edited\n")
    assert planned(editable) - {"all"} == {"show_test_set", "write_manifest"}


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


def in_cm() -> str:
    table = pd.read_csv(data.path("volunteer_segments.csv"))
    return table.assign(wall_thickness_mm=table["wall_thickness_mm"] / 10).to_csv(index=False)


WRONG = {
    "typo": ({"nuts": {"drwas": 10}}, {}, "nuts.drwas: unknown key; did you mean `nuts.draws`"),
    "centimetres": (
        {"geometry": {"segments": "in_cm.csv"}},
        {"in_cm.csv": in_cm()},
        r"in_cm\.csv: column wall_thickness_mm looks like cm; multiply by 10",
    ),
    "duplicate": (
        {"subjects": {"patient": {"source": "file", "measured": "patient.csv"}}},
        {
            "patient.csv": "quantity,segment,value,unit\nvolume,,150,mL\n"
            "circumferential,1,-0.16,1\ncircumferential,1,-0.17,1\n"
        },
        r"patient\.csv, line 4: circumferential_01 is in line 3 already",
    ),
}
"""A section of the configuration, files beside it, and what is said."""


@pytest.mark.parametrize("wrong", WRONG)
def test_bad_input_stops_before_anything_runs(editable, wrong):
    section, files, says = WRONG[wrong]
    for name, content in files.items():
        (editable / name).write_text(content)
    (name, own), *_ = section.items()
    edit_config(editable, lambda c: c.update({name: c.get(name, {}) | own}))
    output = run(editable, "--cores", "1", "--dry-run", check=False)
    assert re.search(says, output, flags=re.DOTALL) and "Traceback" not in output


def test_what_a_killed_run_had_finished_is_kept(study, killed):
    batch = study / killed.batch
    assert batch.stat().st_mtime_ns == killed.finished_ns, f"{batch} was made again"


@pytest.mark.parametrize(
    "target",
    [
        pytest.param(
            target,
            marks=DEEP if target.endswith(("auc.csv", "errors.csv", "findings.json")) else [],
        )
        for target in REMADE
    ],
)
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


def test_lint_finds_a_rule_without_a_log(root, tmp_path):
    """That there is none in the project is the business of `make lint`."""
    copy_project(root, tmp_path / "project")
    rules = tmp_path / "project/workflow/rules/design.smk"
    rules.write_text(re.sub(r"    log:\n.*\n", "", rules.read_text(), count=1))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path / "project")
        assert any("log" in text for text in findings("config/smoke.yaml")[0])
