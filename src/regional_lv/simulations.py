"""Batches of simulations: from rows of a design to a table of observables and sensitivities."""

import logging
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.geometry.mesh import read_mesh
from regional_lv.mechanics.continuation import Effort, Simulation, Solved, Solver, WarmStarts
from regional_lv.mechanics.simulator import Simulator, State
from regional_lv.progress import Progress

log = logging.getLogger(__name__)


def make_simulator(mesh: Path, physics: dict) -> Simulator:
    """The simulator of a mesh file; `physics` holds the config sections that describe it."""
    return Simulator(read_mesh(mesh), physics)


def frame_column(output: str, fraction: float) -> str:
    """Column name of an output at a load fraction, such as `volume_ml@0.5`."""
    return f"{output}@{fraction:g}"


def solve_baseline(mesh: Path, physics: dict, bounds: tuple[float, float], start: Path) -> dict:
    """Inflate from nothing at the middle of the box; write the solution with its tangents (npz).

    The middle is the geometric mean of `bounds` in every parameter. Every batch starts from this
    file, so that batches depend on it and on nothing else. Returns a summary: unknowns, Newton
    steps, mean dilation and the observables at theta = 1.
    """
    simulator = make_simulator(mesh, physics)
    solver, effort = Solver(simulator, physics["solver"]), Effort()
    pressure = physics["loading"]["pressure_mmhg"]
    centre = np.full(len(aha.PARAMETERS), np.sqrt(bounds[0] * bounds[1]))
    state = solver.inflate(centre, pressure, effort)
    cold_steps = effort.newton_steps
    tangents = simulator.field_sensitivities(state.w)
    np.savez_compressed(start, w=state.w, theta=state.theta, pressure=pressure, tangents=tangents)
    reference = solver.follow(state, tangents, np.ones(10), effort)
    return {
        "unknowns": simulator.size,
        "newton_steps_cold": cold_steps,
        "mean_dilation": simulator.dilation(reference.w),
        "observables_theta_1": dict(
            zip(aha.OUTPUTS, simulator.observables(reference.w).tolist(), strict=True)
        ),
    }


def warm_starts(mesh: Path, physics: dict, start: Path) -> WarmStarts:
    """A fresh pool of starts that holds the baseline alone."""
    simulator = make_simulator(mesh, physics)
    loading = physics["loading"]
    pool = WarmStarts(
        Solver(simulator, physics["solver"]), loading["pressure_mmhg"], loading["frames"]
    )
    with np.load(start) as saved:
        state = State(saved["w"], saved["theta"], float(saved["pressure"]))
        pool.pool.append(Solved(state, saved["tangents"]))
    return pool


def simulate_batch(
    mesh: Path, physics: dict, start: Path, design: pd.DataFrame, name: str
) -> pd.DataFrame:
    """Simulate the rows of a design; return the table described in the README, in design order.

    A run that does not converge becomes a row with status "failed", reason and last converged
    pressure; it never raises.
    """
    pool = warm_starts(mesh, physics, start)
    thetas = design[list(aha.PARAMETERS)].to_numpy()
    progress = Progress(name, len(design))
    results: dict[int, Simulation] = {}
    for row, result in pool.run_all(thetas):
        results[row] = result
        if result.status != "converged":
            log.warning("sample %s failed: %s", design["sample"].iloc[row], result.reason)
        progress.step(failed=result.status != "converged")
    return tabulate(design, [results[row] for row in range(len(design))], pool.frames)


def tabulate(design: pd.DataFrame, results: list[Simulation], frames=()) -> pd.DataFrame:
    """One row per simulation: design columns, outcome, 52 outputs, frames, sensitivities.

    `sensitivity` holds the 520 numbers of d(outputs)/d(theta), row-major (52, 10).
    """
    columns = {
        "status": [r.status for r in results],
        "reason": [r.reason for r in results],
        "last_pressure_mmhg": [r.last_pressure for r in results],
        "newton_steps": [r.newton_steps for r in results],
        "cpu_s": [r.cpu_s for r in results],
    }
    values = np.stack([r.observables for r in results])
    columns |= dict(zip(aha.OUTPUTS, values.T, strict=True))
    nothing = np.full(len(aha.OUTPUTS), np.nan)
    for fraction in frames:
        values = np.stack([r.frames.get(fraction, nothing) for r in results])
        names = [frame_column(output, fraction) for output in aha.OUTPUTS]
        columns |= dict(zip(names, values.T, strict=True))
    columns["sensitivity"] = [
        [] if r.sensitivity is None else r.sensitivity.ravel().tolist() for r in results
    ]
    return pd.concat([design.reset_index(drop=True), pd.DataFrame(columns)], axis=1)
