"""Simulations of an extended model: at the anchors of the study, for each value of psi."""

import logging
import time
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.criticism.hypotheses.base import SimulatorHypothesis
from regional_lv.criticism.polynomial import lagrange
from regional_lv.mechanics import effects
from regional_lv.mechanics.continuation import Effort, NotConverged, Simulation, Solver
from regional_lv.mechanics.predictor import read_anchors
from regional_lv.mechanics.simulator import Simulator, State
from regional_lv.progress import Progress
from regional_lv.simulations import make_simulator, tabulate

log = logging.getLogger(__name__)

HALVINGS = 3
"""How often a step in psi that fails is halved."""

SLOPE_STEP = 1e-5
"""Of the range of psi: half the step of the central difference of residual and observables."""


class Extended:
    """The simulators of one hypothesis and component, for any psi.

    Parameters
    ----------
    mesh, physics: the study's.
    base: solver at the base value, which all components of a hypothesis share.
    """

    def __init__(
        self,
        mesh: Path,
        physics: dict,
        hypothesis: SimulatorHypothesis,
        component: str = "",
        base: Solver | None = None,
    ):
        self.hypothesis, self.component = hypothesis, component
        self.pressure = physics["loading"]["pressure_mmhg"]
        self._mesh, self._physics = mesh, physics
        # One set of forms from the base value on, or the tangent of one is not that of the other.
        self._in_the_form = (hypothesis.section, hypothesis.key) in effects.BASE
        self._solvers = {} if base is None else {hypothesis.base: base}

    def solver(self, psi: float) -> Solver:
        """The solver at `psi`, made when it is first asked for."""
        if psi not in self._solvers:
            physics = self.hypothesis.extend(self._physics, psi, self.component)
            simulator = make_simulator(self._mesh, physics, self._in_the_form)
            self._solvers[psi] = Solver(simulator, physics["solver"])
        return self._solvers[psi]

    def simulator(self, psi: float) -> Simulator:
        return self.solver(psi).simulator

    def solve(self, w: np.ndarray, theta: np.ndarray, psi: float, effort: Effort) -> State:
        """Equilibrium at (theta, psi) from the field `w`. Raises `NotConverged`."""
        return self.solver(psi).newton(w, theta, self.pressure, effort)

    def slope(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """d(w)/d(psi) (size,) and d(outputs)/d(psi) (52,) at the base value, exactly.

        `state` is the base model's, whose factorised tangent is at hand: -K^-1 dR/dpsi, with the
        residual's change by central difference, and what the outputs change by themselves. Where
        psi moves the circles on which nodes of the base stay, the field moves with them.
        """
        base, h = self.hypothesis, SLOPE_STEP * (self.hypothesis.high - self.hypothesis.low)
        sides = []
        for psi in (base.base + h, base.base - h):
            simulator = self.simulator(psi)
            simulator.set(state.theta, state.pressure)
            w = simulator.retract(state.w)
            sides.append((w, simulator.residual(w), simulator.observables(w)))
        carried, residual, outputs = ((a - b) / (2 * h) for a, b in zip(*sides, strict=True))
        simulator = self.simulator(base.base)
        field = -simulator.solve(residual)
        along = simulator.directional_derivatives(state.w, field[None])[0]
        return field + carried, along + outputs

    def nodes(self, start: State, along: np.ndarray | None, tangents: np.ndarray, effort: Effort):
        """Yield (psi, Simulation) at every node, from the base model's state.

        `along` (size,) is its d(w)/d(psi), if there is one, `tangents` its d(w)/d(log theta).
        """
        if not self.hypothesis.needs_solving:
            for psi in self.hypothesis.nodes:
                yield psi, self.observed(start, psi, tangents)
            return
        for psi, found in self.follow(start, along, effort):
            if isinstance(found, NotConverged):
                yield psi, Simulation(start.theta, "failed", str(found))
            else:
                tangents = self.simulator(psi).field_sensitivities(found.w)
                yield psi, self.observed(found, psi, tangents)

    def observed(self, state: State, psi: float, tangents: np.ndarray) -> Simulation:
        simulator = self.simulator(psi)
        result = Simulation(state.theta, "converged", last_pressure=state.pressure)
        result.observables = simulator.observables(state.w)
        per_log = simulator.directional_derivatives(state.w, tangents)
        result.sensitivity = (per_log / state.theta[:, None]).T
        return result

    def follow(self, start: State, along: np.ndarray | None, effort: Effort):
        """Yield (psi, State or the error) for every node, outwards from the base on either side.

        A step that fails is halved; beyond a node that cannot be reached nothing is tried.
        """
        h = self.hypothesis
        for side in (-1, 1):
            nodes = sorted((n for n in h.nodes if side * (n - h.base) > 0), key=lambda n: side * n)
            if not nodes:
                continue
            known, error = [(h.base, start.w)], None
            if along is not None:
                # A state just before the base stands for the slope there.
                back = 0.01 * (nodes[0] - h.base)
                known.insert(0, (h.base - back, start.w - back * along))
            for node in nodes:
                goals, halvings = [node], 0
                while goals and error is None:
                    guess = self._foretell(known[-3:], goals[-1])
                    try:
                        state = self.solve(guess, start.theta, goals[-1], effort)
                    except NotConverged as failure:
                        halvings += 1
                        error = failure if halvings > HALVINGS else None
                        goals.append((known[-1][0] + goals[-1]) / 2)
                    else:
                        known.append((goals.pop(), state.w))
                yield node, state if error is None else error

    def _foretell(self, known: list, goal: float) -> np.ndarray:
        """Field at psi = `goal` from fields known at others, by the polynomial through them."""
        z = [self.hypothesis.coordinate(psi) for psi, _ in known]
        weights = lagrange(z, self.hypothesis.coordinate(goal))
        return sum(weight * w for weight, (_, w) in zip(weights, known, strict=True))


def simulate_extension(
    mesh: Path,
    physics: dict,
    anchors: Path,
    hypothesis: SimulatorHypothesis,
    most: int | None,
    name: str,
) -> pd.DataFrame:
    """Simulate the anchors of one file at every node of a hypothesis, and at the base.

    most: how many of the anchors, spread over the file; None takes all. Returns one row per
    component, anchor and psi: `component`, `anchor` (file and row), `psi`, theta, what
    `simulations.tabulate` gives of a simulation, and `slope`: in rows at the base, the 52
    derivatives d(outputs)/d(psi) from the tangent; empty elsewhere, and where the effect has none.
    A simulation that fails is a row with its reason; it never raises.
    """
    theta, fields, _ = read_anchors([anchors])
    count = len(theta) if most is None else min(most, len(theta))
    rows = np.unique(np.linspace(0, len(theta) - 1, count).round().astype(int))
    progress = Progress(name, len(rows) * len(hypothesis.components))
    every = [Extended(mesh, physics, hypothesis, hypothesis.components[0])]
    base = every[0].solver(hypothesis.base)
    every += [Extended(mesh, physics, hypothesis, c, base) for c in hypothesis.components[1:]]
    table = _Table()
    for row in rows:
        anchor = {"anchor": f"{Path(anchors).stem}/{row}"}
        anchor |= dict(zip(aha.PARAMETERS, theta[row], strict=True))
        effort = Effort()
        table.start(effort)
        try:
            start = every[0].solve(fields[row], theta[row], hypothesis.base, effort)
        except NotConverged as error:
            log.warning("%s: no start at anchor %d: %s", name, row, error)
            for extended in every:
                for psi in (hypothesis.base, *hypothesis.nodes):
                    at = {"component": extended.component, "psi": psi, "slope": []} | anchor
                    table.add(at, Simulation(theta[row], "failed", str(error)))
            progress.step(failed=True, count=len(every))
            continue
        tangents = base.simulator.field_sensitivities(start.w)
        for extended in every:
            along, slope = extended.slope(start) if hypothesis.slope_at_base else (None, ())
            at = {"component": extended.component} | anchor
            result = extended.observed(start, hypothesis.base, tangents)
            table.add(at | {"psi": hypothesis.base, "slope": list(slope)}, result)
            failed = False
            for psi, result in extended.nodes(start, along, tangents, effort):
                table.add(at | {"psi": psi, "slope": []}, result)
                if result.status != "converged":
                    failed = True
                    log.warning("%s: psi %g at anchor %d failed: %s", name, psi, row, result.reason)
            progress.step(failed=failed)
    return table.finished()


class _Table:
    """Rows of results, each with the effort since the one before."""

    def __init__(self):
        self._design, self._results = [], []

    def start(self, effort: Effort) -> None:
        self._effort, self._steps, self._since = effort, 0, time.process_time()

    def add(self, design: dict, result: Simulation) -> None:
        result.newton_steps = self._effort.newton_steps - self._steps
        result.cpu_s = time.process_time() - self._since
        self._steps, self._since = self._effort.newton_steps, time.process_time()
        self._design.append(design)
        self._results.append(result)

    def finished(self) -> pd.DataFrame:
        return tabulate(pd.DataFrame(self._design), self._results)
