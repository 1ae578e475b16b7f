"""One heart the fast way: from its files to the page, without the simulator."""

import json
import subprocess
import sys

import pytest
import xarray as xr

from regional_lv.criticism.contract import read_findings
from regional_lv.hearts.fast import answer
from regional_lv.hearts.reach import OutOfReach

FORBIDDEN = """
import sys
from regional_lv import config
from regional_lv.hearts.fast import answer
from regional_lv.hearts.file import read

answer(config.load(sys.argv[1]), sys.argv[2], read(sys.argv[3]))
print([name for name in ("dolfinx", "gmsh", "snakemake") if name in sys.modules])
"""


@pytest.fixture
def answered(heart, file, tmp_path):
    """A folder with the answer, made in a process of its own."""
    heart()
    command = [sys.executable, "-c", FORBIDDEN, *(tmp_path / "config.yaml", tmp_path / "out", file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"
    return tmp_path / "out"


def test_a_heart_the_fast_way(answered):
    findings = read_findings(answered / "findings.json")
    stiffness = {each["name"]: each for each in findings["stiffness"]}
    # It was measured where every factor is 1 at 8 mmHg, and is at 12.
    low, high = stiffness["C_a_free"]["averaged"]["interval95"]
    assert low < 1.5 < high
    low, high = stiffness["C_b_free"]["averaged"]["interval95"]
    assert low < 1.0 < high
    assert not findings["named"]
    posterior = xr.open_dataset(answered / "posterior.nc", group="posterior")
    assert posterior["value"].sel(input="C_a_free").size == 4000
    page = (answered / "page.html").read_text()
    assert "suspected and never named" in page and "C_a is cut to 0.12 to 5" in page
    assert json.loads((answered / "findings.json").read_text())


def test_nothing_is_computed_of_a_heart_out_of_reach(heart, any_heart, tmp_path):
    def thinner(table):
        table.loc[4, "wall_thickness_mm"] = 2.2

    with pytest.raises(OutOfReach, match="wall_thickness_5"):
        answer(heart(thinner), tmp_path / "out", any_heart)
    assert not (tmp_path / "out").exists()
