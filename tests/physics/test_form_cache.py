"""The cache of compiled forms, which outlives the processes that fill it."""

import fcntl
import os
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from regional_lv.geometry.mesh import read_mesh

INTEGRAL = """
import numpy as np
import ufl
from regional_lv.mechanics import dolfinx_api as api

square = [(0, 0), (1, 0), (1, 1), (0, 1)]
corners = np.array([[*corner, z] for z in (0, 1) for corner in square], dtype=float)
mesh, _ = api.hexahedral_mesh(corners, np.arange(8)[None])
x = ufl.SpatialCoordinate(mesh)
print(api.fem.assemble_scalar(api.compile_form(x[0] * x[1] * x[2] * ufl.dx)))
"""

FORMS = """
import pickle
import sys
from regional_lv.mechanics import dolfinx_api as api
from regional_lv.mechanics.simulator import Simulator

compile_form = api.compile_form

def told(form):
    print("form", len(form.constants()), form.signature())
    return compile_form(form)

api.compile_form = told
for given in pickle.load(sys.stdin.buffer):
    print("simulator")
    simulator = Simulator(*given)
    simulator.residual(simulator.w.x.array.copy())
"""


def run(program, environment, given=b""):
    """What a process of its own prints."""
    done = subprocess.run(
        [sys.executable, "-c", program],
        input=given,
        capture_output=True,
        env={**os.environ, **environment},
    )
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout.decode()


def integral(folder):
    """Integral of xyz over the unit cube, compiled into the cache of `folder`."""
    return float(run(INTEGRAL, {"XDG_CACHE_HOME": str(folder)}))


def test_compilers_print_nothing(tmp_path):
    """Nor do they change the log of the process."""
    log = "[logging.root.level, *logging.root.handlers]"
    made, compiled = INTEGRAL.split("\nprint")
    program = f"import logging\n{made}\nbefore = {log}\nprint{compiled}print(before == {log})"
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "CFLAGS": "-Wall -Wextra -v"}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, env=environment)
    integral, unchanged = done.stdout.decode().splitlines()
    assert float(integral) == pytest.approx(1 / 8) and unchanged == "True" and not done.stderr


BROKEN = {
    "nonesuch -O1": "CC=nonesuch -O1: there is no such C compiler; correct CC, or unset it",
    "gcc '": "CC=gcc ': there is no such C compiler; correct CC, or unset it",
    " ": "CC= : there is no such C compiler; correct CC, or unset it",
    "false": "the C compiler `false` failed (",
}
"""Compilers that do not work, and what is said of them."""


def test_a_compiler_that_does_not_work_is_one_line(tmp_path):
    program = f"""
import os
from regional_lv.errors import InputError
for os.environ["CC"] in {list(BROKEN)}:
    try:
        exec({INTEGRAL!r})
    except InputError as error:
        print(error)
"""
    said = run(program, {"XDG_CACHE_HOME": str(tmp_path)}).splitlines()
    for line, expected in zip(said, BROKEN.values(), strict=True):
        assert line.startswith(expected)


def test_what_a_killed_process_left_half_made_is_made_again(tmp_path):
    assert integral(tmp_path) == pytest.approx(1 / 8)
    finished = sorted(tmp_path.glob("regional_lv/*.c.cached"))
    assert finished
    for path in finished:
        path.unlink()  # the source is there, the word that it is compiled is not
    assert integral(tmp_path) == pytest.approx(1 / 8)
    assert sorted(tmp_path.glob("regional_lv/*.c.cached")) == finished


def test_processes_that_start_together_share_the_work(tmp_path):
    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(integral, [tmp_path, tmp_path])) == pytest.approx([1 / 8, 1 / 8])


def test_who_waits_for_another_process_says_so(tmp_path):
    (tmp_path / "regional_lv").mkdir()
    program = "import logging; logging.basicConfig(level='INFO', stream=sys.stdout)\n"
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    with open(tmp_path / "regional_lv" / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        waiting = subprocess.Popen(
            [sys.executable, "-c", f"import sys; {program}{INTEGRAL}"],
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert str(tmp_path / "regional_lv" / "lock") in waiting.stdout.readline()
    assert float(waiting.communicate()[0].splitlines()[-1]) == pytest.approx(1 / 8)


def test_a_form_is_the_same_after_another_was_compiled_and_after_it_was_found(tmp_path):
    program = INTEGRAL + "print((x[0] * ufl.dx).signature())"
    compiled, found = (run(program, {"XDG_CACHE_HOME": str(tmp_path)}) for _ in range(2))
    assert compiled == found


def test_no_value_compiles_a_form(small_mesh, physics):
    """All numbers are constants of the forms: another material, another angle, another size of what
    is there already compile nothing; a load and a spring are forms of their own."""

    turned = physics | {"fibres": physics["fibres"] | {"rotation_deg": 5.0}}
    constants = {"a_f_kpa": 7.0, "b": 3.0}
    other = turned | {"material": physics["material"] | {"constants": constants}}
    loaded = physics | {"loading": physics["loading"] | {"septal_pressure_mmhg": 2.0}}
    more = loaded | {"supports": physics["supports"] | {"epicardium_kpa_per_mm": 0.1}}
    given = [(each, False) for each in (physics, other, loaded, more)] + [(physics, True)]
    # Seeded, as by the workflow: else the order of a form's terms differs by process.
    told = pickle.dumps([(read_mesh(small_mesh), *each) for each in given])
    _, *printed = run(FORMS, {"PYTHONHASHSEED": "0"}, told).split("simulator\n")
    base, others, load, spring, off = (
        [line.split()[1:] for line in text.splitlines() if line.startswith("form ")]
        for text in printed
    )
    assert others == base
    *same, load = load
    assert same == base
    *same, spring, again = spring
    assert same == base and again == load != spring
    assert off[: len(base)] == base and load not in off and spring not in off


def test_a_cache_that_cannot_be_locked_is_said(tmp_path):
    program = f"""
import errno, fcntl, os
from regional_lv.errors import InputError

def flock(file, how):
    raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

fcntl.flock = flock
try:
    exec({INTEGRAL!r})
except InputError as error:
    print(error)
"""
    said = run(program, {"XDG_CACHE_HOME": str(tmp_path)})
    assert "cannot be locked" in said and "set XDG_CACHE_HOME" in said
