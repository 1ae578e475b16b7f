"""The cache of compiled forms, which outlives the processes that fill it."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

PROGRAM = """
import numpy as np
import ufl
from regional_lv.mechanics import dolfinx_api as api

square = [(0, 0), (1, 0), (1, 1), (0, 1)]
corners = np.array([[*corner, z] for z in (0, 1) for corner in square], dtype=float)
mesh, _ = api.hexahedral_mesh(corners, np.arange(8)[None])
x = ufl.SpatialCoordinate(mesh)
print(api.fem.assemble_scalar(api.compile_form(x[0] * x[1] * x[2] * ufl.dx)))
"""


def integral(folder):
    """Integral of xyz over the unit cube, from a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        **{"capture_output": True, "text": True, "env": {**os.environ, **folder}},
    )
    assert done.returncode == 0, done.stderr
    return float(done.stdout)


def test_what_a_killed_process_left_half_made_is_made_again(tmp_path):
    cache = {"XDG_CACHE_HOME": str(tmp_path)}
    assert integral(cache) == pytest.approx(1 / 8)
    finished = sorted(tmp_path.glob("regional_lv/*.c.cached"))
    assert finished
    for path in finished:
        path.unlink()  # the source is there, the word that it is compiled is not
    assert integral(cache) == pytest.approx(1 / 8)
    assert sorted(tmp_path.glob("regional_lv/*.c.cached")) == finished


def test_processes_that_start_together_share_the_work(tmp_path):
    with ThreadPoolExecutor(2) as pool:
        cache = {"XDG_CACHE_HOME": str(tmp_path)}
        assert list(pool.map(integral, [cache, cache])) == pytest.approx([1 / 8, 1 / 8])
