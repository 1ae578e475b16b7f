"""Batches of simulations: from rows of a design to a table of observables and sensitivities."""

import logging
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.geometry.mesh import read_mesh
from regional_lv.geometry.thickness import thickened
from regional_lv.mechanics.continuation import (
    Effort,
    GrowingRunner,
    Runner,
    Simulation,
    Solver,
)
from regional_lv.mechanics.predictor import Known, Predictor
from regional_lv.mechanics.simulator import Simulator
from regional_lv.progress import Progress

log = logging.getLogger(__name__)


def make_simulator(mesh: Path, physics: dict, extended: bool = False) -> Simulator:
    """The simulator of a mesh file; `physics` holds the config sections that describe it.

    extended: as for `Simulator`.
    """
    thickness = physics["geometry"].get("wall_thickness_scale", 1.0)
    return Simulator(thickened(read_mesh(mesh), thickness), physics, extended)


def frame_column(output: str, fraction: float) -> str:
    """Column name of an output at a load fraction, such as `volume_ml@0.5`."""
    return f"{output}@{fraction:g}"


def solve_baseline(mesh: Path, physics: dict, bounds: tuple[float, float], start: Path) -> dict:
    """Inflate from nothing at the middle of the box; write the solution with its tangents (npz).

    The middle is the geometric mean of `bounds` in every parameter. All anchors start from this
    file. Returns a summary: unknowns, Newton steps, mean dilation and the observables at theta = 1.
    """
    simulator = make_simulator(mesh, physics)
    solver, effort = Solver(simulator, physics["solver"]), Effort()
    pressure = physics["loading"]["pressure_mmhg"]
    centre = np.full(len(aha.PARAMETERS), np.sqrt(bounds[0] * bounds[1]))
    state = solver.inflate(centre, pressure, effort)
    cold_steps = effort.newton_steps
    tangents = simulator.field_sensitivities(state.w)
    np.savez_compressed(start, w=state.w, theta=state.theta, pressure=pressure, tangents=tangents)
    known = Known(simulator.size)
    known.add(centre, state.w, tangents)
    reference = Runner(solver, known, pressure).run(np.ones(len(centre)))
    return {
        "unknowns": simulator.size,
        "newton_steps_cold": cold_steps,
        "mean_dilation": simulator.dilation(reference.state.w),
        "observables_theta_1": dict(zip(aha.OUTPUTS, reference.observables.tolist(), strict=True)),
    }


def anchors_of(design: pd.DataFrame, anchors: int) -> np.ndarray:
    """Points (n, 10) of a design to solve first: the first ones of its Sobol sequences.

    Half of them natural, half logarithmic, as far as there are so many.
    """
    natural, logarithmic = (
        design.loc[design["scale"] == scale, list(aha.PARAMETERS)].to_numpy()
        for scale in ("natural", "log")
    )
    from_log = min(len(logarithmic), anchors - min(len(natural), anchors // 2))
    return np.concatenate([natural[: anchors - from_log], logarithmic[:from_log]])


def solve_anchors(
    mesh: Path, physics: dict, start: Path, thetas: np.ndarray, path: Path, name: str
) -> None:
    """Solve the rows of `thetas` (n, 10); write fields and tangents (npz, single precision).

    A row that fails is left out.
    """
    with np.load(start) as saved:
        known = Known(len(saved["w"]))
        known.add(saved["theta"], saved["w"], saved["tangents"])
    solver = Solver(make_simulator(mesh, physics), physics["solver"])
    runner = GrowingRunner(solver, known, physics["loading"]["pressure_mmhg"])
    progress, solved = Progress(name, len(thetas)), []
    for row, result in runner.run_all(thetas):
        progress.step(failed=result.state is None)
        if result.state is None:
            log.warning("anchor %d failed: %s", row, result.reason)
        else:
            solved.append(result)
    np.savez(
        path,
        theta=np.stack([r.theta for r in solved]),
        fields=np.stack([r.state.w for r in solved]).astype(np.float32),
        tangents=np.stack([r.tangents for r in solved]).astype(np.float32),
        cpu_s=sum(r.cpu_s for r in solved),
    )


def make_runner(mesh: Path, physics: dict, predictor: Path, sensitivities: bool = True) -> Runner:
    """Runs simulations, with `sensitivities` or without, from the predictor file's fields."""
    loading = physics["loading"]
    return Runner(
        Solver(make_simulator(mesh, physics), physics["solver"]),
        Predictor.load(predictor),
        loading["pressure_mmhg"],
        loading["frames"],
        sensitivities,
    )


def simulate_batch(
    mesh: Path, physics: dict, predictor: Path, design: pd.DataFrame, name: str
) -> pd.DataFrame:
    """Simulate the rows of a design; return the table described in the README, in design order.

    Each simulation depends on the predictor and on its own theta, not on the batch. A run that
    does not converge becomes a row with status "failed", reason and last converged pressure; it
    never raises.
    """
    runner = make_runner(mesh, physics, predictor)
    progress = Progress(name, len(design))
    results = []
    for sample, theta in zip(
        design["sample"], design[list(aha.PARAMETERS)].to_numpy(), strict=True
    ):
        result = runner.run(theta)
        result.state = result.tangents = None  # large, and not tabulated
        results.append(result)
        if result.status != "converged":
            log.warning("sample %s failed: %s", sample, result.reason)
        progress.step(failed=result.status != "converged")
    return tabulate(design, results, runner.frames)


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
