"""The progress line of a whole run."""

import csv
import re
import subprocess
import sys

import pytest

from snakemake_logger_plugin_regional_lv.run import TABLE, UNKNOWN_SECONDS, Run, _rounded, _whole


def test_time_left_follows_the_speed_of_the_run():
    run = Run({"a_rule": 10, "total": 10}, cores=2, now=0.0)
    assert run.left(0.0) == pytest.approx(10 * UNKNOWN_SECONDS / 2)
    for job in range(8):  # each takes three times as long as the table says
        run.start(job, "a_rule", 100.0 * job)
        run.finish(job, 100.0 * job + 3 * UNKNOWN_SECONDS)
        run.count(job + 1, 10)
    slow = run.left(800.0)
    assert 1.5 * UNKNOWN_SECONDS < slow < 3 * UNKNOWN_SECONDS
    run.start(8, "a_rule", 800.0)
    assert run.left(810.0) < slow
    assert run.line(810.0).startswith("[13 min 30 s] 8 of 10 steps done, about ")
    assert run.line(810.0).endswith("left; now: a rule")


def test_a_rule_that_takes_long_does_not_make_the_others_long():
    run = Run({"slow": 6, "quick": 100, "total": 106}, cores=1, now=0.0)
    for job in range(3):
        run.start(job, "slow", 300.0 * job)
        run.finish(job, 300.0 * (job + 1))
    for job in range(3, 53):
        run.start(job, "quick", 900.0 + job)
        run.finish(job, 901.0 + job)
    run.count(53, 106)
    assert run.left(1000.0) == pytest.approx(3 * 300.0 + 50 * 1.0, rel=0.25)


def test_a_job_that_goes_on_is_not_taken_for_a_short_one():
    run = Run({"slow": 4, "total": 4}, cores=1, now=0.0)
    run.start(0, "slow", 0.0)
    left = [run.left(now) for now in (10.0, 200.0, 400.0)]
    assert left[0] < left[1] < left[2]
    assert left[2] > 3 * 400.0 / 2  # the others of its kind take long too


def test_a_checkpoint_adds_steps():
    run = Run({"a_rule": 1, "total": 1}, cores=1, now=0.0)
    run.count(1, 5)
    assert not run.complete
    run.count(5, 5)
    assert run.complete and run.line(60.0) == "[1 min 00 s] 5 of 5 steps done"


def test_a_job_that_failed_is_not_under_way():
    run = Run({"make_mesh": 1, "simulate_batch": 1, "total": 2}, cores=2, now=0.0)
    for job, rule in enumerate(("make_mesh", "simulate_batch")):
        run.start(job, rule, 1.0)
    assert run.line(2.0).endswith("now: geometry, simulations")
    run.fail(0)
    assert run.line(2.0).endswith("now: simulations")


def test_a_job_of_a_cluster_may_end_without_having_been_announced():
    run = Run({"a_rule": 4, "total": 4}, cores=1, now=0.0)
    run.start(0, "a_rule", 0.0)
    for job in range(3):
        run.finish(job, UNKNOWN_SECONDS)
        run.count(job + 1, 4)
    assert run.left(UNKNOWN_SECONDS) == pytest.approx(UNKNOWN_SECONDS)
    assert run.line(UNKNOWN_SECONDS) == "[10 s] 3 of 4 steps done, about 10 s left"


@pytest.mark.parametrize(
    ("seconds", "whole", "rounded"),
    [(7.4, "7 s", "10 s"), (134, "2 min 14 s", "2 min"), (7500, "2 h 05 min", "2 h 05 min")],
)
def test_durations_in_words(seconds, whole, rounded):
    assert (_whole(seconds), _rounded(seconds)) == (whole, rounded)


def test_every_rule_of_the_workflow_has_its_stage():
    listed = subprocess.run(
        [sys.executable, "-m", "snakemake", "--list-rules", "--configfile", "config/study.yaml"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    rules = {line.split()[0] for line in listed.splitlines() if line[:1].isalpha()}
    with TABLE.open(newline="") as file:
        known = {row["rule"] for row in csv.DictReader(file)}
    assert len(rules) > 70 and rules - known == set()


def test_a_run_shows_stages_and_errors(tmp_path):
    (tmp_path / "Snakefile").write_text(
        "rule all:\n    input: 'made', 'never'\n\n"
        "rule make:\n    output: 'made'\n    shell: 'touch {output}'\n\n"
        "rule fail:\n    output: 'never'\n    log: 'fail.log'\n"
        "    shell: 'echo a reason > {log}; exit 1'\n"
    )
    done = subprocess.run(
        [
            *(sys.executable, "-m", "snakemake", "--cores", "1", "--logger", "regional-lv"),
            *("--keep-going", "--show-failed-logs"),
        ],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert re.search(r"^\[\d+ s\] \d of 3 steps done, about \d+ s left; now: ", done.stderr, re.M)
    assert "Error in rule fail" in done.stderr and "a reason" in done.stderr
    assert "resources: tmpdir" not in done.stderr
