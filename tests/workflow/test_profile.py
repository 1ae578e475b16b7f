"""The profile for SLURM, and what rules state of their jobs for it."""

import re

import yaml


def test_default_resources_double_with_each_attempt(root):
    profile = yaml.safe_load((root / "profiles" / "slurm" / "config.yaml").read_text())
    assert profile["retries"] > 0 and set(profile["default-resources"]) == {"mem_mb", "runtime"}
    for expression in profile["default-resources"].values():
        first, second = (eval(expression, {"attempt": attempt}) for attempt in (1, 2))
        assert second == 2 * first >= 60
    assert "set-resources" not in profile  # rules state their own


def test_rules_that_run_where_snakemake_runs_state_no_resources(root):
    """They are submitted nowhere."""
    parts = [
        re.split(r"^ *(?:use rule \w+ as|rule|checkpoint) (?=\w+(?: with)?:)", text, flags=re.M)
        for text in (f.read_text() for f in (root / "workflow" / "rules").glob("*.smk"))
    ]
    rules = {re.match(r"\w+", rule)[0]: rule for _, *of_file in parts for rule in of_file}
    local = {name for name, rule in rules.items() if "localrule: True" in rule}
    stating = {name for name, rule in rules.items() if "**needs(" in rule}
    assert {"write_manifest", "fetch_published"} <= local and "criticise_subject" in stating
    assert not stating & local
