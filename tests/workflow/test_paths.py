"""Folders with any names, and modules of the user's in them."""

import os
import shutil
import subprocess

import pytest
import yaml

from tests.unit.test_surroundings import SHADOWS
from tests.workflow.project import command, copy_project

ODD = "a{b} {{c}} 'q\" [x] ü #%* $(d)"
"""Braces are wildcards of Snakemake, the rest means something in a shell, a pattern or YAML."""


DEEP = pytest.mark.test_all("the same from a folder above")


@pytest.mark.parametrize("inside", [True, pytest.param(False, marks=DEEP)])
def test_any_folder_can_hold_hearts_and_the_project(inside, root, tmp_path):
    """Planned and begun from a folder below such a one, and from above it."""
    project = copy_project(root, tmp_path / ODD / "{project}")
    shutil.copy(root / "LIMITATIONS.md", project)
    hearts = tmp_path / ODD / "{hearts}"
    hearts.mkdir()
    geometry = {"segments": "{wall} 1.csv"}
    subjects = {"patient": {"source": "file", "measured": "{patient}.csv"}}
    own = {"study": "odd", "geometry": geometry, "subjects": subjects}
    (hearts / "{anna}.yaml").write_text(yaml.safe_dump(own))
    packaged = root / "src" / "regional_lv" / "data"
    shutil.copy(packaged / "volunteer_segments.csv", hearts / geometry["segments"])
    shutil.copy(packaged / "measured_template.csv", hearts / "{patient}.csv")
    folder = hearts if inside else tmp_path
    for name in SHADOWS:
        (folder / f"{name}.py").write_text("raise SystemExit('a file of the user is imported')\n")

    def snakemake(*arguments):
        files = [project / "config" / "smoke.yaml", hearts / "{anna}.yaml"]
        files = [os.path.relpath(file, folder) for file in files]
        called = command("--snakefile", str(project / "Snakefile"), "--cores", "1", *arguments)
        called[called.index("--configfile") + 1 : called.index("--configfile") + 2] = files
        return subprocess.run(
            [called[0], "-P", *called[1:]],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=600,
            env=os.environ | {"PYTHONPATH": str(project / "src")},
        )

    made = ["results/odd/geometry/mesh.vtu", "results/odd/measured/patient.csv"]
    for arguments in (["--dry-run"], ["--", *made]):
        done = snakemake(*arguments)
        assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]
    assert all((folder / file).is_file() for file in made)
