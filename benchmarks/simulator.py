"""What a simulation costs: from predicted fields, and by cold load stepping, in one run.

    python benchmarks/simulator.py config/config.yaml config/examples/three_loads.yaml

`make bench-simulator` makes the mesh, the anchors and the predictors first, also those of the
further loads that the second file asks for. The last line is JSON.
"""

import json
import resource
import sys
import time
from pathlib import Path

import numpy as np

from regional_lv import config as study_config
from regional_lv.inputs.physics import physics_of
from regional_lv.mechanics.continuation import Effort, NotConverged, Runner, Solver
from regional_lv.mechanics.predictor import load_predictors
from regional_lv.simulation.batches import make_simulator
from regional_lv.simulation.sobol import further_points
from regional_lv.study.layout import Layout

NATURAL, LOG, COLD = 150, 50, 16
EVERY = 5  # of the points, with further load fractions
PAPER_SIMULATIONS = 6181


def clock(call, repeats: int = 7) -> float:
    """Median CPU seconds of `call()`."""
    times = []
    for _ in range(repeats):
        started = time.process_time()
        call()
        times.append(time.process_time() - started)
    return float(np.median(times))


def warm(runner: Runner, thetas: np.ndarray):
    """CPU seconds and Newton steps of each run, (n,) both; failures raise."""
    results = [runner.run(theta) for theta in thetas]
    failed = [r for r in results if r.status != "converged"]
    if failed:
        raise NotConverged(f"{len(failed)} runs failed: {failed[0].reason}")
    return tuple(
        np.array([getattr(r, name) for r in results]) for name in ("cpu_s", "newton_steps")
    )


def cold(solver: Solver, thetas: np.ndarray, pressure: float):
    """The same by load stepping from nothing."""
    seconds, steps = [], []
    for theta in thetas:
        effort, started = Effort(), time.process_time()
        solver.inflate(theta, pressure, effort)
        seconds.append(time.process_time() - started)
        steps.append(effort.newton_steps)
    return np.array(seconds), np.array(steps)


def done(what: str, seconds: np.ndarray) -> None:
    """Say at once what was measured: the table comes after half an hour."""
    print(f"{what}: {len(seconds)} runs, {seconds.mean():.2f} CPU s each", file=sys.stderr)


def main(paths: list[Path]) -> None:
    """Measure and print; later files of the configuration replace sections of earlier ones."""
    merged = {}
    for path in paths:
        merged |= study_config.read(path)
    config = study_config.load(merged)
    files = Layout.of(config["study"])
    framed = physics_of(config)
    frames = framed["loading"]["frames"]
    physics = framed | {"loading": framed["loading"] | {"frames": []}}
    mesh = files.heart().mesh
    simulator = make_simulator(mesh, physics)
    predictor = files.predictor()
    guesses = load_predictors(predictor, simulator.coordinates)
    parameters, pressure = simulator.parameters, simulator.full_pressure
    solver, seed = Solver(simulator, config["solver"]), config["seed"]
    thetas = further_points(parameters, seed, "benchmark", NATURAL, LOG)

    with_s, steps = warm(Runner(solver, guesses), thetas)
    done("predicted, with sensitivities", with_s)
    without_s, _ = warm(Runner(solver, guesses, sensitivities=False), thetas)
    done("predicted, without", without_s)
    at_loads = Runner(Solver(make_simulator(mesh, framed), config["solver"]), guesses)
    framed_s, framed_steps = warm(at_loads, thetas[::EVERY])
    done("at lower loads, too", framed_s)
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    share = further_points(parameters, seed, "benchmark", 3 * COLD // 4, COLD // 4)
    plain, plain_steps = cold(Solver(simulator, config["solver"], kept=False), share, pressure)
    done("cold, a tangent for every step", plain)
    kept, kept_steps = cold(solver, share, pressure)
    done("cold, tangents kept", kept)

    one = np.ones(len(parameters))
    state = solver.newton(guesses[1.0].field(one), one, pressure, Effort())
    residual = simulator.residual(state.w)
    seconds = {
        "assembly": clock(lambda: simulator.assemble(state.w)),
        "factorisation": clock(lambda: simulator.factorise(state.w)),
        "solve": clock(lambda: simulator.solve(residual)),
        "residual": clock(lambda: simulator.residual(state.w)),
    }
    seconds["factorisation"] -= seconds["assembly"]
    step = seconds["assembly"] + seconds["factorisation"] + seconds["solve"]
    anchors = 0.0
    for file in sorted(Path().glob(files.anchors("*", "npz"))):
        with np.load(file) as saved:
            anchors += float(saved["cpu_s"])
    anchors /= PAPER_SIMULATIONS
    cpu = with_s.mean() + anchors

    print(f"{simulator.size} unknowns, {NATURAL} natural- and {LOG} log-scale points")
    print("Newton step, CPU s: " + ", ".join(f"{k} {v:.4f}" for k, v in seconds.items()))
    print(f"  floor, two assemblies and factorisations: {2 * (step - seconds['solve']):.3f} s")
    print(f"{'':34}{'CPU s':>8}{'steps':>8}{'median':>8}{'p95':>8}")
    for label, cost, count in (
        ("predicted, with sensitivities", with_s, steps),
        ("predicted, without", without_s, None),
        (f"of every {EVERY}th: the full load", with_s[::EVERY], steps[::EVERY]),
        (f"and at {', '.join(f'{f:g}' for f in frames)} of it", framed_s, framed_steps),
        ("cold, a tangent for every step", plain, plain_steps),
        ("cold, tangents kept", kept, kept_steps),
    ):
        line = f"{label:34}{cost.mean():8.3f}{cost.mean() / step:8.2f}"
        if count is not None:
            line += f"{np.median(count):8.1f}{np.percentile(count, 95):8.1f}"
        print(line)
    print(f"anchors, spread over {PAPER_SIMULATIONS} simulations: {anchors:.3f} s each")
    print("(steps: CPU time in units of a Newton step; median, p95: tangents factorised)")
    summary = {
        "step_equivalents": cpu / step,
        "ratio_cold": plain.mean() / cpu,
        "ratio_loads": framed_s.mean() / with_s[::EVERY].mean(),
        "cpu_s": cpu,
        "newton_steps_median": float(np.median(steps)),
        "newton_steps_p95": float(np.percentile(steps, 95)),
        "peak_mb": peak_mb,
    }
    print(json.dumps({key: round(value, 3) for key, value in summary.items()}))


if __name__ == "__main__":
    main([Path(path) for path in sys.argv[1:]])
