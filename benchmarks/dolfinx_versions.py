"""The same simulations with two versions of dolfinx: what they cost and how far they differ.

    python benchmarks/dolfinx_versions.py run results/quick/geometry/mesh.vtu old.npz
    python benchmarks/dolfinx_versions.py compare old.npz new.npz

Run the first line once in each environment, on the same mesh.
"""

import sys
import time
from pathlib import Path

import numpy as np

from regional_lv import config as study_config
from regional_lv.inputs.physics import physics_of
from regional_lv.mechanics import dolfinx_api
from regional_lv.mechanics.continuation import Effort, Runner, Solver
from regional_lv.simulation.batches import known_from, make_simulator
from regional_lv.simulation.sobol import further_points

NATURAL, LOG = 16, 8


def run(mesh: Path, out: Path) -> None:
    """Simulate with sensitivities, each from the state in the middle of the box."""
    config = study_config.load({"study": "quick"})
    started = time.process_time()
    simulator = make_simulator(mesh, physics_of(config))
    made = time.process_time() - started
    solver, effort = Solver(simulator, config["solver"]), Effort()
    known = known_from(solver.inflate_all(simulator.parameters.middle, effort), simulator)
    thetas = further_points(simulator.parameters, config["seed"], "benchmark", NATURAL, LOG)
    results = [Runner(solver, known).run(theta) for theta in thetas]
    np.savez(
        out,
        version=dolfinx_api.dolfinx.__version__,
        made_s=made,
        unknowns=simulator.size,
        cold_steps=effort.newton_steps,
        failed=sum(r.status != "converged" for r in results),
        cpu_s=[r.cpu_s for r in results],
        newton_steps=[r.newton_steps for r in results],
        observables=[r.observables for r in results],
        sensitivities=[r.sensitivity for r in results],
    )


def compare(*paths: Path) -> None:
    """Print a line for each file and the largest differences between the two."""
    both = [np.load(path) for path in paths]
    for one in both:
        print(
            f"dolfinx {one['version']}: {one['unknowns']} unknowns, {one['failed']} failed, "
            f"median {np.median(one['cpu_s']):.2f} CPU s, {one['newton_steps'].sum()} Newton steps "
            f"in all, {one['cpu_s'].sum() / one['newton_steps'].sum():.3f} CPU s each, "
            f"{one['cold_steps']} for the cold start, simulator made in {one['made_s']:.1f} CPU s"
        )
    differences = [np.abs(both[0][k] - both[1][k]) for k in ("observables", "sensitivities")]
    print("largest difference of each simulation (mL, strains): observables, sensitivities")
    for rows in zip(*differences, strict=True):
        print("  " + ", ".join(f"{values.max():.1e}" for values in rows))


if __name__ == "__main__":
    {"run": run, "compare": compare}[sys.argv[1]](*map(Path, sys.argv[2:]))
