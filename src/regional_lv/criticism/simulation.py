"""Simulations of an extended model: at the anchors of the study, for each value of psi."""

import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.criticism.hypotheses.base import REGISTRY, SimulatorHypothesis
from regional_lv.criticism.polynomial import lagrange
from regional_lv.mechanics.continuation import Effort, NotConverged, Simulation, Solver
from regional_lv.mechanics.dolfinx_api import release_unused
from regional_lv.mechanics.predictor import read_anchors
from regional_lv.mechanics.simulator import Simulator, State
from regional_lv.progress import Progress
from regional_lv.simulations import make_simulator, tabulate

log = logging.getLogger(__name__)

HALVINGS = 3
"""How often a step in psi that fails is halved."""

SLOPE_STEP = 1e-5
"""Of the range of psi: the step on either side of the base value, as far as the range goes, between
which residual and observables are compared."""


class Extended:
    """The simulators of one hypothesis and component, for any psi.

    Parameters
    ----------
    mesh, physics: the study's.
    base: solver at the base value, which all components of a hypothesis share.
    """

    def __init__(
        self,
        mesh: str | Path,
        physics: Mapping,
        hypothesis: SimulatorHypothesis,
        component: str = "",
        base: Solver | None = None,
    ):
        self.hypothesis, self.component = hypothesis, component
        self._mesh, self._physics = mesh, physics
        self._solvers = {} if base is None else {hypothesis.base: base}

    def solver(self, psi: float) -> Solver:
        """The solver at `psi`, made when it is first asked for."""
        if psi not in self._solvers:
            physics = self.hypothesis.extend(self._physics, psi, self.component)
            # One set of forms from the base value on, or the tangent of one is not that of the
            # other.
            simulator = make_simulator(self._mesh, physics, self.hypothesis.in_the_form)
            self._solvers[psi] = Solver(simulator, physics["solver"])
        return self._solvers[psi]

    def simulator(self, psi: float) -> Simulator:
        return self.solver(psi).simulator

    def close(self) -> None:
        """Drop all solvers but the one at the base: together they take hundreds of MB."""
        self._solvers = {psi: s for psi, s in self._solvers.items() if psi == self.hypothesis.base}
        release_unused()

    def solve(self, w: np.ndarray, theta: np.ndarray, psi: float, fraction: float, effort: Effort):
        """Equilibrium (`State`) at (theta, psi) and a load fraction from the field `w`.

        Raises `NotConverged`.
        """
        solver = self.solver(psi)
        return solver.newton(w, theta, fraction * solver.simulator.full_pressure, effort)

    def slope(self, state: State, fraction: float) -> tuple[np.ndarray, np.ndarray]:
        """d(w)/d(psi) (size,) and d(outputs)/d(psi) (d,) at the base value, of one load's channels.

        `state` is the base model's, whose factorised tangent is at hand: -K^-1 dR/dpsi, with the
        residual's change by difference, and what the outputs change by themselves. Where psi moves
        the circles on which nodes of the base stay, the field moves with them.
        """
        h = self.hypothesis
        step = SLOPE_STEP * (h.high - h.low)
        ahead, behind = min(h.base + step, h.high), max(h.base - step, h.low)
        sides = []
        for psi in (ahead, behind):
            simulator = self.simulator(psi)
            simulator.set(state.theta, state.pressure)
            w = simulator.retract(state.w)
            sides.append((w, simulator.residual(w), simulator.observables(w, None, fraction)[0]))
        carried, residual, outputs = (
            (a - b) / (ahead - behind) for a, b in zip(*sides, strict=True)
        )
        simulator = self.simulator(h.base)
        field = -simulator.solve(residual)
        _, along = simulator.observables(state.w, field[None], fraction)
        assert along is not None
        return field + carried, along[0] + outputs

    def nodes(
        self,
        start: State,
        along: np.ndarray | None,
        tangents: np.ndarray | None,
        fraction: float,
        effort: Effort,
    ):
        """Yield (psi, values (d,) and sensitivities (d, P) of one load's channels, or the error) at
        every node, from the base model's state at that load.

        `along` (size,) is its d(w)/d(psi), if there is one, `tangents` its d(w)/d(log theta), of
        hypotheses that need no solving.
        """
        if not self.hypothesis.needs_solving:
            assert tangents is not None
            for psi in self.hypothesis.nodes:
                yield psi, self.observed(start, psi, tangents, fraction)
            return
        for psi, found in self.follow(start, along, fraction, effort):
            if not isinstance(found, NotConverged):
                tangents = self.simulator(psi).field_sensitivities(found.w)
                found = self.observed(found, psi, tangents, fraction)
            yield psi, found

    def observed(self, state: State, psi: float, tangents: np.ndarray, fraction: float):
        """Values (d,) and d(values)/d(theta) (d, P) of the channels at one load."""
        values, per_log = self.simulator(psi).observables(state.w, tangents, fraction)
        return values, (per_log / state.theta[:, None]).T

    def follow(self, start: State, along: np.ndarray | None, fraction: float, effort: Effort):
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
                        state = self.solve(guess, start.theta, goals[-1], fraction, effort)
                    except NotConverged as failure:
                        halvings += 1
                        error = failure if halvings > HALVINGS else None
                        ends = known[-1][0], goals[-1]
                        goals.append(h.scale.inverse(sum(map(h.scale, ends)) / 2))
                    else:
                        known.append((goals.pop(), state.w))
                yield node, state if error is None else error

    def _foretell(self, known: list, goal: float) -> np.ndarray:
        """Field at psi = `goal` from fields known at others, by the polynomial through them."""
        scale = self.hypothesis.scale
        weights = lagrange([scale(psi) for psi, _ in known], scale(goal))
        return sum(weight * w for weight, (_, w) in zip(weights, known, strict=True))


def simulate_extension(
    mesh: str | Path,
    anchors: str | Path,
    physics: Mapping,
    hypothesis: str,
    batch: str,
    most: int | None,
    simulations: str | Path,
) -> None:
    """Simulate the anchors of one file at every node of a hypothesis, and at the base.

    hypothesis: its name. batch: of the anchors, for messages. most: how many of the anchors, spread
    over the file; None takes all. Writes (Parquet) one row per component, anchor and psi:
    `component`, `anchor` (file and row), `psi`, theta, what `simulations.tabulate` gives of a
    simulation, and `slope`: in rows at the base, the D derivatives d(outputs)/d(psi) from the
    tangent; empty elsewhere, and where the effect has none. A simulation that fails is a row with
    its reason; it never raises.
    """
    asked = REGISTRY[hypothesis].for_study(physics)
    every = [Extended(mesh, physics, asked, asked.components[0])]
    base = every[0].solver(asked.base)
    every += [Extended(mesh, physics, asked, c, base) for c in asked.components[1:]]
    names, channels = base.simulator.parameters.names, base.simulator.channels
    fields = {load: read_anchors([anchors], load)[1] for load in channels.load_fractions}
    thetas = read_anchors([anchors])[0]
    count = len(thetas) if most is None else min(most, len(thetas))
    rows = np.unique(np.linspace(0, len(thetas) - 1, count).round().astype(int))
    at_anchors = [
        _AtAnchor(every, thetas[row], {load: known[row] for load, known in fields.items()})
        for row in rows
    ]
    progress = Progress(f"{hypothesis} batch {batch}", len(rows) * len(every))
    for extended in every:
        for row, at_anchor in zip(rows, at_anchors, strict=True):
            failures = at_anchor.follow(extended)
            for psi, reason in failures.items():
                log.warning("%s: psi %g at anchor %d failed: %s", hypothesis, psi, row, reason)
            progress.step(failed=bool(failures))
        extended.close()
    design, results = [], []
    for row, at_anchor in zip(rows, at_anchors, strict=True):
        at = {"anchor": f"{Path(anchors).stem}/{row}"}
        at |= dict(zip(names, thetas[row], strict=True))
        for (component, psi), result in at_anchor.found.items():
            slope = at_anchor.slope(component) if psi == asked.base else []
            design.append({"component": component, "psi": psi, "slope": slope} | at)
            results.append(result)
    table = tabulate(pd.DataFrame(design), results, channels)
    table.to_parquet(simulations, index=False)


class _AtAnchor:
    """Simulations of one hypothesis at one anchor: of the base model at once, of each component
    when `follow` is called.

    every: components of the hypothesis, which share the solver at the base. guesses: fields of the
    base model by load fraction. found: (component, psi) -> Simulation.
    """

    def __init__(self, every: list[Extended], theta: np.ndarray, guesses: dict[float, np.ndarray]):
        h = every[0].hypothesis
        base = every[0].simulator(h.base)
        self._places = {fraction: base.places_of(fraction) for fraction in guesses}
        shape = len(base.channels), len(theta)
        self.found = {
            (extended.component, psi): Simulation(
                theta,
                "converged",
                last_pressure=base.full_pressure,
                observables=np.full(shape[0], np.nan),
                sensitivity=np.full(shape, np.nan),
            )
            for extended in every
            for psi in (h.base, *h.nodes)
        }
        self._slopes = {extended.component: np.full(shape[0], np.nan) for extended in every}
        self._starts: dict[float, _Start] = {}
        clock = _Clock()
        for fraction, w in guesses.items():
            at = self._places[fraction]
            try:
                state = every[0].solve(w, theta, h.base, fraction, clock.effort)
            except NotConverged as error:
                for result in self.found.values():
                    clock.charge(result, fraction, at, error)
                break
            tangents = base.field_sensitivities(state.w)
            start = self._starts[fraction] = _Start(state, None if h.needs_solving else tangents)
            for extended in every:
                component = extended.component
                if h.slope_at_base:
                    along, self._slopes[component][at] = extended.slope(state, fraction)
                    start.along[component] = along
                observed = extended.observed(state, h.base, tangents, fraction)
                clock.charge(self.found[component, h.base], fraction, at, observed)

    def follow(self, extended: Extended) -> dict[float, str]:
        """Simulate one component at all nodes; psi -> reason of each failure."""
        component, clock = extended.component, _Clock()
        for fraction, start in self._starts.items():
            along, at = start.along.get(component), self._places[fraction]
            nodes = extended.nodes(start.state, along, start.tangents, fraction, clock.effort)
            for psi, observed in nodes:
                clock.charge(self.found[component, psi], fraction, at, observed)
        of_component = {psi: self.found[c, psi] for c, psi in self.found if c == component}
        return {p: r.reason for p, r in of_component.items() if r.status != "converged"}

    def slope(self, component: str) -> list[float]:
        """d(outputs)/d(psi) at the base; empty where it is not known of every output."""
        slope = self._slopes[component]
        return slope.tolist() if np.isfinite(slope).all() else []


@dataclass
class _Start:
    """The base model at one load: its state, d(w)/d(log theta) (P, size) where no node is solved
    anew, and d(w)/d(psi) (size,) by component where there is one."""

    state: State
    tangents: np.ndarray | None
    along: dict[str, np.ndarray] = field(default_factory=dict)


class _Clock:
    """Gives every result the effort since the one before."""

    def __init__(self):
        self.effort = Effort()
        self._steps, self._since = 0, time.process_time()

    def charge(self, result: Simulation, fraction: float, at: np.ndarray, observed) -> None:
        """Put what was `observed` at one load, or the error, into its places `at` of a result."""
        result.newton_steps += self.effort.newton_steps - self._steps
        result.cpu_s += time.process_time() - self._since
        self._steps, self._since = self.effort.newton_steps, time.process_time()
        if isinstance(observed, NotConverged):
            result.status, result.reason = "failed", f"load {fraction:g}: {observed}"
            result.observables = result.sensitivity = None
        elif result.status == "converged":
            assert result.observables is not None and result.sensitivity is not None
            result.observables[at], result.sensitivity[at] = observed
