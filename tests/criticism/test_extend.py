"""The study with what was named as a part of its model."""

import pytest
import yaml

from regional_lv.criticism.extend import write_extended
from regional_lv.criticism.findings import write_findings
from regional_lv.errors import InputError
from tests.criticism.findings_example import example


def test_named_causes_are_inferred_in_the_range_that_was_searched(tmp_path):
    found = example()
    found["hypotheses"][0]["range"] = [-2.0, 2.0]
    write_findings(found, tmp_path / "findings.json")
    config = {"study": "a", "inputs": {"causes": "suspected"}}
    write_extended(tmp_path / "findings.json", config, tmp_path / "extended.yaml")
    study = yaml.safe_load((tmp_path / "extended.yaml").read_text())
    assert study["study"] == "a_extended"
    assert study["inputs"] == {
        "causes": "suspected",
        "septal_load": {"role": "inferred", "range": [-2.0, 2.0]},
        "focal_scar_7": {"role": "inferred", "range": [0.0, 4.0]},
    }


def test_nothing_named_is_nothing_to_extend(tmp_path):
    write_findings(example(named=[]), tmp_path / "findings.json")
    with pytest.raises(InputError, match="no cause is named"):
        write_extended(tmp_path / "findings.json", {}, tmp_path / "extended.yaml")
