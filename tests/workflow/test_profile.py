"""The profile for SLURM: what it says of rules is of rules that there are."""

import re

import yaml


def test_resources_are_of_rules_and_double_with_each_attempt(root):
    profile = yaml.safe_load((root / "profiles" / "slurm" / "config.yaml").read_text())
    files = (root / "workflow" / "rules").glob("*.smk")
    parts = [
        re.split(
            r"^ *(?:use rule \w+ as|rule|checkpoint) (?=\w+(?: with)?:)", f.read_text(), flags=re.M
        )
        for f in files
    ]
    rules = {re.match(r"\w+", rule)[0]: rule for _, *of_file in parts for rule in of_file}
    # Those that run where Snakemake runs are submitted nowhere.
    local = {name for name, rule in rules.items() if "localrule: True" in rule}
    assert {"write_manifest", "fetch_published"} <= local
    assert set(profile["set-resources"]) <= rules.keys() - local
    assert profile["retries"] > 0
    for resources in (profile["default-resources"], *profile["set-resources"].values()):
        assert set(resources) <= {"mem_mb", "runtime"}
        for expression in resources.values():
            first, second = (eval(expression, {"attempt": attempt}) for attempt in (1, 2))
            assert second == 2 * first >= 60
