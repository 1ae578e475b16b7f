"""Batches of simulations: from rows of a design to a table of observables and sensitivities."""

import json
import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.geometry.mesh import Mesh, read_mesh
from regional_lv.geometry.thickness import thickened
from regional_lv.inputs.space import SECTION, Inputs
from regional_lv.mechanics.continuation import (
    Effort,
    GrowingRunner,
    NotConverged,
    Runner,
    Simulation,
    Solution,
    Solver,
)
from regional_lv.mechanics.predictor import Known, load_predictors
from regional_lv.mechanics.problem import Problem
from regional_lv.mechanics.simulator import Simulator, State
from regional_lv.study.progress import Progress

log = logging.getLogger(__name__)


def make_simulator(mesh: str | Path | Mesh, physics: Mapping) -> Simulator:
    """The simulator of a mesh (or its file): of all inputs that `physics` describes
    (`inputs.space.sections_of`), or of the parameters alone, `physics` then as for `Simulator` and
    with the section `geometry`, for the wall's thickness."""
    mesh = mesh if isinstance(mesh, Mesh) else read_mesh(mesh)
    if SECTION in physics:
        return Problem(mesh, Inputs.from_config(physics).simulated)
    scale = physics["geometry"]["wall_thickness_scale"]
    return Simulator(thickened(mesh, scale), physics)


def solve_baseline(mesh: str | Path, physics: dict, start: str | Path, summary: str | Path) -> None:
    """Inflate from nothing at the middle of the box, to every load that is observed.

    The middle is the geometric mean of the bounds of every parameter. All anchors start from
    `start` (npz): theta (P,), and by load `w@<load>` (size,) and its `tangents@<load>` (P, size).
    summary (JSON): unknowns, Newton steps, mean dilation and the observables at theta = 1.

    Raises InputError for a ventricle that cannot be inflated: all simulations would fail.
    """
    simulator = make_simulator(mesh, physics)
    solver, effort = Solver(simulator, physics["solver"]), Effort()
    theta = simulator.middle
    try:
        solutions = solver.inflate_all(theta, effort)
        reference = Runner(solver, known_from(solutions, simulator)).run(simulator.reference)
        if reference.state is None:
            raise NotConverged(f"at theta = 1: {reference.reason}")
    except NotConverged as error:
        raise InputError(
            f"{mesh}: this ventricle cannot be inflated ({error}); check the units of its geometry "
            "and `loading.pressure_mmhg`, or try a coarser `mesh`"
        ) from error
    arrays = {"theta": theta}
    for load, found in solutions.items():
        assert found.tangents is not None
        arrays |= {f"w@{load:g}": found.state.w, f"tangents@{load:g}": found.tangents}
    np.savez_compressed(start, **arrays)
    values = dict(zip(simulator.channels.names, reference.observables.tolist(), strict=True))
    content = {
        "unknowns": simulator.size,
        "newton_steps_cold": effort.newton_steps,
        "mean_dilation": simulator.dilation(reference.state.w),
        "observables_theta_1": values,
    }
    Path(summary).write_text(json.dumps(content, indent=2) + "\n")
    log.info("%s", content)


def known_from(solutions: Mapping[float, Solution], simulator: Simulator) -> dict[float, Known]:
    """By load fraction, the guesses that solutions with tangents at these loads give."""
    guesses = {}
    for load, found in solutions.items():
        guesses[load] = Known(simulator.size, simulator.coordinates)
        assert found.tangents is not None
        guesses[load].add(found.state.theta, found.state.w, found.tangents)
    return guesses


def anchors_of(design: pd.DataFrame, anchors: int) -> pd.DataFrame:
    """Rows of a design to solve first: the first ones of its Sobol sequences.

    Half of them natural, half logarithmic, as far as there are so many.
    """
    natural, logarithmic = (design[design["scale"] == scale] for scale in ("natural", "log"))
    from_log = min(len(logarithmic), anchors - min(len(natural), anchors // 2))
    return pd.concat([natural.iloc[: anchors - from_log], logarithmic.iloc[:from_log]])


def growing_runner(mesh: str | Path, physics: dict, start: str | Path) -> GrowingRunner:
    """A runner that knows the solution of `solve_baseline` (npz) of that mesh."""
    simulator = make_simulator(mesh, physics)
    with np.load(start) as saved:
        theta = saved["theta"]
        solutions = {
            load: Solution(
                State(saved[f"w@{load:g}"], theta, load * simulator.full_pressure),
                saved[f"tangents@{load:g}"],
            )
            for load in simulator.channels.load_fractions
        }
    return GrowingRunner(Solver(simulator, physics["solver"]), known_from(solutions, simulator))


def solve_anchors(
    mesh: str | Path,
    start: str | Path,
    design: str | Path,
    physics: dict,
    anchors: int,
    batches: int,
    batch: str,
    fields: str | Path,
    simulations: str | Path,
) -> None:
    """Simulate a batch of a design's anchors; write their fields and tangents at every load, and
    the table of `tabulate`.

    A batch takes every n-th of the `anchors`, so that all batches span the box. fields (npz):
    theta (n, P), and by load `fields@<load>` (n, size) and `tangents@<load>` (n, P, size), single
    precision. It has no anchor that failed; the table has all.
    """
    runner = growing_runner(mesh, physics, start)
    rows = anchors_of(pd.read_parquet(design), anchors).iloc[int(batch) :: batches]
    thetas = rows[list(runner.coordinates.names)].to_numpy()
    progress, results = Progress(f"anchors, batch {batch}", len(thetas)), {}
    for row, result in runner.run_all(thetas):
        progress.step(failed=result.state is None)
        results[row] = result
        if result.state is None:
            log.warning("anchor %d failed: %s", row, result.reason)
    solved = [result for result in results.values() if result.state is not None]
    if not solved:
        raise InputError(
            f"{design}: none of the {len(thetas)} anchors of batch {batch} converged (the first: "
            f"{results[0].reason}); check pressure, material and supports, or narrow the design "
            "(design.lower, design.upper)"
        )
    arrays = {"theta": np.stack([r.theta for r in solved])}
    for load in runner.channels.load_fractions:
        found = [r.solutions[load] for r in solved]
        arrays[f"fields@{load:g}"] = np.stack([s.state.w for s in found]).astype(np.float32)
        arrays[f"tangents@{load:g}"] = np.stack([s.tangents for s in found]).astype(np.float32)
    np.savez(fields, cpu_s=sum(r.cpu_s for r in solved), **arrays)
    made = [results[row] for row in range(len(rows))]
    tabulate(rows, made, runner.channels).to_parquet(simulations, index=False)


def make_runner(
    mesh: str | Path | Mesh, physics: Mapping, predictor: str | Path, sensitivities: bool = True
) -> Runner:
    """Runs simulations, with `sensitivities` or without, from the predictor file's fields."""
    simulator = make_simulator(mesh, physics)
    guesses = load_predictors(predictor, simulator.coordinates)
    return Runner(Solver(simulator, physics["solver"]), guesses, sensitivities)


def simulate_batch(
    mesh: str | Path,
    predictor: str | Path,
    design: str | Path,
    physics: dict,
    batch_size: int,
    batch: str,
    set: str,
    simulations: str | Path,
    anchors: Sequence[str | Path] = (),
) -> None:
    """Simulate the rows of batch number `batch` of a design; write the table of `tabulate`.

    Each simulation depends on the predictor and on its own theta, not on the batch. A run that
    does not converge becomes a row with status "failed", reason and last converged pressure; it
    never raises. anchors: tables of `solve_anchors` on this mesh, of the same design; what
    converged there is not solved again.
    """
    first = int(batch) * batch_size
    rows = pd.read_parquet(design).iloc[first : first + batch_size]
    solved = _converged(anchors, rows["sample"])
    waiting = rows[~rows["sample"].isin(solved["sample"])] if len(solved) else rows
    made = []
    if len(waiting):
        runner = make_runner(mesh, physics, predictor)
        thetas = waiting[list(runner.coordinates.names)].to_numpy()
        results = run_all(runner, thetas, f"{set} batch {batch}", waiting["sample"])
        made.append(tabulate(waiting, results, runner.channels))
    table = pd.concat([*made, *([solved] if len(solved) else [])])
    table.sort_values("sample").to_parquet(simulations, index=False)


def _converged(tables: Sequence[str | Path], samples: pd.Series) -> pd.DataFrame:
    """Rows of `tables` that converged and are among `samples`."""
    if not tables:
        return pd.DataFrame()
    found = pd.concat([pd.read_parquet(table) for table in tables])
    return found[found["sample"].isin(samples) & (found["status"] == "converged")]


def run_all(
    runner: Runner, thetas: np.ndarray, name: str, samples: Sequence | None = None
) -> list[Simulation]:
    """Simulations of the rows of `thetas` (n, P), without their fields; logs how far it got."""
    progress, results = Progress(name, len(thetas)), []
    for sample, theta in zip(
        range(len(thetas)) if samples is None else samples, thetas, strict=True
    ):
        result = runner.run(theta)
        failed = result.status != "converged"
        result.solutions = {}  # large, and not tabulated
        results.append(result)
        if failed:
            log.warning("sample %s failed: %s", sample, result.reason)
        progress.step(failed=failed)
    return results


def tabulate(
    design: pd.DataFrame, results: Sequence[Simulation], channels: Channels
) -> pd.DataFrame:
    """One row per simulation: design columns, outcome, the D channels, sensitivities.

    `sensitivity` holds the D P numbers of d(channels)/d(theta), row-major (D, P); none where the
    simulation failed or was run without.
    """
    columns = {
        "status": [r.status for r in results],
        "reason": [r.reason for r in results],
        "last_pressure_mmhg": [r.last_pressure for r in results],
        "newton_steps": [r.newton_steps for r in results],
        "cpu_s": [r.cpu_s for r in results],
    }
    values = np.stack([r.observables for r in results])
    columns |= dict(zip(channels.names, values.T, strict=True))
    columns["sensitivity"] = [
        [] if r.sensitivity is None else r.sensitivity.ravel().tolist() for r in results
    ]
    return pd.concat([design.reset_index(drop=True), pd.DataFrame(columns)], axis=1)
