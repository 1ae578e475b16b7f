"""What a script depends on is what it imports, followed to the end."""

import ast
import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from regional_lv.study import dependencies
from regional_lv.study.jobs import function_of

LOADED = """
import sys
import regional_lv.{module}
print(*(m.__file__ for name, m in sys.modules.items() if name.startswith("regional_lv.")))
"""


def names(root, *modules, **options):
    found = dependencies.files(root / "src", modules, **options)
    return {path.split("regional_lv/")[-1] for path in found}


@pytest.mark.parametrize("module", ["config", "plots.explained_variance"])
def test_all_that_the_interpreter_loads_is_found(root, module):
    """What is missing here could be edited without a rerun."""
    done = subprocess.run(
        [sys.executable, "-c", LOADED.format(module=module)],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONPATH": str(root / "src")},
    )
    paths = [Path(path) for path in done.stdout.split() if not path.endswith("__init__.py")]
    loaded = {path.relative_to(root / "src" / "regional_lv").as_posix() for path in paths}
    # The package itself imports one that has no effect on results.
    assert len(loaded) > 5 and loaded - names(root, module) == {"study/surroundings.py"}


def test_what_a_registry_imports_later_is_found(root):
    """An edit of an emulator trains anew, whatever room it is in."""
    found = names(root, "emulators.training")
    assert {"emulators/exact_gp.py", "paper/emulators/dgp.py"} <= found


def test_of_the_configuration_an_emulator_depends_on_its_settings_alone(root):
    """What is said of other keys could be edited without training again."""
    found = {name for name in names(root, "emulators.exact_gp") if name.startswith("config/")}
    assert found == {"config/section.py", "config/sections/settings.py"}


def test_nothing_else_is_found(root):
    """Modules that the simulator does without, so that their edits cost no simulation."""
    found, there = names(root, "simulation.batches"), root / "src" / "regional_lv"
    without = {"geometry/meshing.py", "measured/tables.py", "plots/zones.py", "inference/sets.py"}
    assert all((there / path).is_file() for path in without)
    assert not without & found
    assert {
        "simulation/batches.py",
        "mechanics/simulator.py",
        "mechanics/materials/base.py",
    } <= found


@pytest.fixture(scope="module")
def imports(root):
    """Dotted names of modules, and of what is in them, that each file of the package imports."""
    package, found = root / "src" / "regional_lv", {}
    for file in package.rglob("*.py"):
        names = found[file.relative_to(package).as_posix()] = []
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                names += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names += [f"{node.module}.{alias.name}" for alias in node.names]
    return found


def test_nothing_depends_on_the_room_of_the_paper(imports):
    """The workflow calls it, and the registry of emulators has the name of its list."""
    room = "regional_lv.paper"
    users = {
        file
        for file, names in imports.items()
        if any(name == room or name.startswith(f"{room}.") for name in names)
    }
    # What looks for them finds some: modules of the room import one another.
    assert users and all(file.startswith("paper/") for file in users)


DRAWING = {
    "cli/check.py": {"inputs"},
    "hearts/fast.py": {
        *("bullseye_posterior", "criticism", "measured_strains", "posterior_predictive"),
    },
    "page/heart3d.py": {"heart", "style"},
    "page/page.py": {"style"},
}
"""What draws beside the workflow; `style` has names and colours of all that is shown."""


def test_no_figure_is_a_source_of_data(imports):
    """Readers lie below tables, pages and figures, so that none needs another for its data."""
    plots = re.compile(r"regional_lv\.(?:paper\.)?plots\.(\w+)")
    users = {
        file: {found[1] for name in names if (found := plots.match(name))}
        for file, names in imports.items()
        if not file.startswith(("plots/", "paper/plots/"))
    }
    assert {file: modules for file, modules in users.items() if modules} == DRAWING


def test_posteriors_are_read_by_one_module(root):
    """Only after a job has failed are its files read in another way."""
    package = root / "src" / "regional_lv"
    users = {
        file.relative_to(package).as_posix()
        for file in package.rglob("*.py")
        if re.search(r"\b(from_netcdf|(open|load)_(datatree|dataset))\b", file.read_text())
    }
    assert users == {"inference/posteriors.py", "study/faults.py"}


def test_modules_can_be_left_out(root):
    assert "study/progress.py" not in names(root, "simulation.batches", without={"study.progress"})


def test_unknown_module_is_named(root):
    with pytest.raises(ValueError, match=r"regional_lv\.nonsense"):
        names(root, "nonsense")


def test_digest_changes_with_any_file(tmp_path):
    """Not with its time: files of a fresh clone are as good as those of the old one."""
    paths = [tmp_path / "a.py", tmp_path / "b.py"]
    for path in paths:
        path.write_text("x = 1\n")

    def digest():
        dependencies._checksum.cache_clear()
        return dependencies.digest(paths)

    before = digest()
    os.utime(paths[0], (1, 1))
    assert digest() == before == dependencies.digest(paths) and len(before) == 16
    for path in paths:
        path.write_text("x = 2\n")
        assert digest() != before
        path.write_text("x = 1\n")
    assert digest() == before and dependencies.digest(paths[:1]) != before


def test_what_a_call_requires_is_in_its_signature(root):
    """Read without importing the module: planning would take seconds longer."""
    call = "simulation.screening:screen_simulations"
    signature = inspect.signature(function_of(call)).parameters.values()
    needed = [p.name for p in signature if p.default is p.empty]
    assert dependencies.required(root / "src", call) == needed
    assert "steepest" not in needed and "channels" in needed
    with pytest.raises(ValueError, match=r"screening:nothing does not exist"):
        dependencies.required(root / "src", "simulation.screening:nothing")
