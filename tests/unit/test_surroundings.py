"""What a user's machine has set changes neither meshes nor figures, and stops nothing."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import matplotlib
import numpy as np
import pytest
import yaml

from regional_lv import data
from regional_lv.geometry.make import make_mesh
from regional_lv.geometry.mesh import read_mesh
from regional_lv.plots import style

SHADOWS = ("calendar", "signal", "yaml", "numpy", "queue", "platform", "resource", "secrets")


def started(program, environment, folder):
    """A program as a process of its own, in a folder that it does not look for modules in: nor does
    the console script."""
    here = {"PYTHONPATH": str(Path(__file__).parents[2] / "src"), "PYTHONSAFEPATH": "1"}
    here |= {"PATH": os.environ["PATH"]}
    return subprocess.run(
        [sys.executable, "-c", program],
        cwd=folder,
        env=here | environment,
        capture_output=True,
        text=True,
    )


# --- one check of a heart in a machine that has everything set -----------------------------------


@pytest.fixture(scope="module")
def heart(tmp_path_factory, smoke_config):
    folder = tmp_path_factory.mktemp("hearts")
    config = {
        "study": "anna",
        "loading": {"pressure_mmhg": 8},
        "geometry": {"segments": "segments.csv"},
        "mesh": smoke_config["mesh"],
        "subjects": {"patient": {"source": "file", "measured": "measured.csv"}},
    }
    (folder / "anna").mkdir()
    (folder / "anna" / "config.yaml").write_text(yaml.safe_dump(config))
    shutil.copy(data.segment_table(data.VOLUNTEER), folder / "anna" / "segments.csv")
    template = data.path("measured_template.csv").read_text()
    (folder / "anna" / "measured.csv").write_text(template)
    return folder


def checked(heart, environment):
    """What `regional-lv check` says, and its picture."""
    program = "from regional_lv.cli import main; main(['check', 'anna'])"
    done = started(program, environment, heart)
    assert done.returncode == 0, done.stderr
    return done.stdout, (heart / "anna" / "check.png").read_bytes(), done.stderr


@pytest.fixture(scope="module")
def plain(heart, tmp_path_factory):
    return checked(heart, {"HOME": str(tmp_path_factory.mktemp("home"))})


def test_nothing_that_a_user_has_set_changes_a_check(heart, plain, tmp_path):
    (tmp_path / ".gmsh-options").write_text("Mesh.SubdivisionAlgorithm = 2;\n")
    (tmp_path / ".config" / "matplotlib").mkdir(parents=True)
    rc = tmp_path / ".config" / "matplotlib" / "matplotlibrc"
    rc.write_text("text.usetex: True\naxes.grid: True\nsavefig.bbox: tight\n")
    for name in SHADOWS:
        (heart / f"{name}.py").write_text("raise SystemExit('a file of the user is imported')\n")
    environment = {
        **{"HOME": str(tmp_path), "MPLBACKEND": "module://no_notebook.backend_inline"},
        **{"LC_ALL": "tr_TR.UTF-8", "TZ": "Pacific/Auckland"},
    }
    try:
        assert checked(heart, environment)[:2] == plain[:2]
    finally:
        for name in SHADOWS:
            (heart / f"{name}.py").unlink()


def test_a_check_without_a_home(heart, plain, tmp_path):
    (tmp_path / "file").write_text("")
    environment = {"HOME": str(tmp_path / "file"), "TMPDIR": str(tmp_path), "LC_ALL": "C"}
    said, picture, errors = checked(heart, environment)
    assert (said, picture) == plain[:2]
    folder = tmp_path / f"regional-lv-{os.getuid()}"
    # Matplotlib may say that it looks for fonts.
    assert errors.startswith(f"note: there is no home folder; caches go to {folder}\n")
    assert "Traceback" not in errors and "ArviZ" not in errors


# --- gmsh and matplotlib -------------------------------------------------------------------------


OPTIONS = """
Mesh.SubdivisionAlgorithm = 2;
Mesh.MshFileVersion = 2.2;
Geometry.Tolerance = 0.1;
Mesh.SecondOrderIncomplete = 1;
Mesh.SaveParametric = 1;
Mesh.ElementOrder = 1;
"""


@pytest.mark.parametrize("file", [".gmsh-options", ".gmshrc"])
def test_options_of_gmsh_do_not_change_the_mesh(
    file, small_mesh, smoke_config, tmp_path, monkeypatch
):
    (tmp_path / file).write_text(OPTIONS)
    monkeypatch.setenv("HOME", str(tmp_path))
    geometry = smoke_config["geometry"]
    apices = geometry["endo_apex_z_mm"], geometry["epi_apex_z_mm"]
    files = [tmp_path / name for name in ("mesh.msh", "mesh.vtu", "table.csv", "summary.json")]
    settings = smoke_config["mesh"], smoke_config["fibres"]
    make_mesh(geometry["segments"], *apices, *settings, *files)
    mine, other = (read_mesh(path) for path in (files[1], small_mesh))
    np.testing.assert_array_equal(mine.points, other.points)
    np.testing.assert_array_equal(mine.cells, other.cells)


def test_figures_have_matplotlibs_style_and_the_projects_own():
    used = style.context(lambda: dict(matplotlib.rcParams))
    mine = {"text.usetex": True, "axes.grid": True, "savefig.bbox": "tight", "figure.dpi": 30}
    plain = used()
    with matplotlib.rc_context(mine):
        assert used() == plain
        assert matplotlib.rcParams["text.usetex"]  # the user's own is as before
    assert plain["font.family"] == ["DejaVu Sans"] and not plain["axes.grid"]


@pytest.mark.parametrize(
    "backend, then",
    [
        ("module://no_notebook.backend_inline", "agg"),
        ("module://matplotlib.backends.backend_svg", "module://matplotlib.backends.backend_svg"),
        ("svg", "svg"),
    ],
)
def test_the_library_replaces_only_a_backend_that_is_not_there(backend, then, tmp_path):
    program = "import regional_lv, os; print(os.environ['MPLBACKEND'])"
    assert started(program, {"MPLBACKEND": backend}, tmp_path).stdout == f"{then}\n"


# --- folders -------------------------------------------------------------------------------------

SETTLE = """
import os, sys
from regional_lv.study.surroundings import settle
settle()
print(*(os.environ.get(name, "") for name in sys.argv[1:] or {names}), sep="\\n")
"""
NAMES = ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "MPLCONFIGDIR")


@pytest.mark.parametrize(
    "given, moved",
    [
        ({"HOME": "home"}, []),
        ({"HOME": "home", "XDG_CACHE_HOME": "new/cache"}, []),
        ({"HOME": "none"}, ["HOME"]),
        ({"HOME": "file"}, ["HOME"]),
        ({"HOME": "full"}, ["XDG_CACHE_HOME", "XDG_CONFIG_HOME"]),
        ({"HOME": "home", "XDG_CACHE_HOME": "file"}, ["XDG_CACHE_HOME"]),
        ({"HOME": "home", "XDG_CONFIG_HOME": "file/config"}, ["XDG_CONFIG_HOME"]),
        ({"HOME": "home", "MPLCONFIGDIR": "file"}, ["MPLCONFIGDIR"]),
    ],
)
def test_caches_move_where_they_cannot_be_written(given, moved, tmp_path):
    (tmp_path / "file").write_text("")
    for folder in ("home", "full", "tmp"):
        (tmp_path / folder).mkdir()
    for name in (".cache", ".config"):
        (tmp_path / "full" / name).write_text("")
    given = {name: str(tmp_path / place) for name, place in given.items()}
    program = SETTLE.format(names=NAMES)
    done = started(program, given | {"TMPDIR": str(tmp_path / "tmp")}, tmp_path)
    found = dict(zip(NAMES, done.stdout.splitlines(), strict=True))
    other = tmp_path / "tmp" / f"regional-lv-{os.getuid()}"
    assert [name for name in NAMES if found[name].startswith(str(other))] == moved
    assert {n: p for n, p in found.items() if n not in moved and p} == {
        name: place for name, place in given.items() if name not in moved
    }
    assert done.stderr.count("\n") == len(moved) == done.stderr.count(f"; caches go to {other}")


def test_a_folder_that_others_can_write_is_not_used(tmp_path):
    open_to_all = tmp_path / f"regional-lv-{os.getuid()}"
    open_to_all.mkdir()
    open_to_all.chmod(0o777)
    environment = {"HOME": str(tmp_path / "none"), "TMPDIR": str(tmp_path)}
    home = started(SETTLE.format(names=NAMES), environment, tmp_path).stdout.splitlines()[0]
    assert home.startswith(str(tmp_path)) and home != str(open_to_all)


@pytest.mark.parametrize("entry", ["", ".", "lib"])
def test_modules_of_the_working_folder_are_not_found(entry, tmp_path, root):
    (tmp_path / "lib").mkdir()
    for folder in (tmp_path, tmp_path / "lib"):
        (folder / "of_the_user.py").write_text("print('imported')\n")
    path = os.pathsep.join([entry, str(root / "src")])
    find = "import subprocess, importlib.util as u; print(u.find_spec('of_the_user'), flush=True)\n"
    program = SETTLE.format(names=[]) + find + f"subprocess.run([sys.executable, '-c', {find!r}])"
    done = started(program, {"PYTHONPATH": path, "HOME": str(tmp_path)}, tmp_path)
    assert done.stdout.split() == ["None", "None"], done


def test_the_package_is_found_in_the_working_folder(root):
    """As one that is not installed, in the processes that a study starts, too."""
    path = str(root / "src")
    program = SETTLE.format(names=["PYTHONPATH"]) + "print(*sys.path, sep='\\n')"
    done = started(program, {"PYTHONPATH": "src"}, root)
    first, *others = done.stdout.splitlines()
    assert first == path and path in others


@pytest.mark.parametrize(("given", "then"), [({}, 1), ({"OMP_NUM_THREADS": "2"}, 2)])
def test_libraries_compute_on_one_core_unless_the_user_says_otherwise(given, then, tmp_path):
    program = (
        "from click.testing import CliRunner; from regional_lv.cli import main;"
        "CliRunner().invoke(main, ['new', 'anna']);"
        "import torch; print(torch.get_num_threads())"
    )
    assert started(program, given, tmp_path).stdout == f"{then}\n"
