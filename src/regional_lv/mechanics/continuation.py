"""How an equilibrium is reached: Newton's method, load stepping, and steps in log theta.

A simulation never raises for want of convergence: it returns what happened (status, reason, last
converged pressure), because a configuration that cannot be solved is a result of the study.
"""

import time
from dataclasses import dataclass, field

import numpy as np

from regional_lv.mechanics.equilibrium import LinearSolveError
from regional_lv.mechanics.simulator import Simulator, State

# A kept factorisation is given up when its steps shrink by less than this factor.
KEPT_RATE = 0.5
# How far the residual may grow in a step, and the smallest share of a step that is tried.
MOST_GROWTH = 2.0
LEAST_SHARE = 1 / 16


class NotConverged(ArithmeticError):
    """Newton's method stopped without a solution; the message says how."""


@dataclass
class Effort:
    """What was spent so far.

    `newton_steps` counts tangents (one assembly and factorisation each), `kept_steps` steps taken
    with an earlier factorisation.
    """

    newton_steps: int = 0
    kept_steps: int = 0


@dataclass
class Simulation:
    """One finished run: `observables` (52,), `sensitivity` (52, 10) and what it took.

    `frames` holds the observables at the asked load fractions, `last_pressure` (mmHg) how far the
    inflation got, `reason` why it failed (empty if it converged).
    """

    theta: np.ndarray
    status: str
    reason: str = ""
    last_pressure: float = 0.0
    newton_steps: int = 0
    cpu_s: float = 0.0
    observables: np.ndarray = field(default_factory=lambda: np.full(52, np.nan))
    sensitivity: np.ndarray | None = None
    frames: dict[float, np.ndarray] = field(default_factory=dict)


class Solver:
    """Reaches equilibria of a `Simulator`.

    Parameters
    ----------
    simulator: the discretised problem.
    settings: config section `solver`: `increment_tolerance_mm` (a Newton step below it ends the
        iteration: convergence is quadratic, the error left is far smaller), `way_tolerance_mm`
        (the same for states that are only passed through), `max_increment_mm` (a larger step
        ends the attempt), `max_newton_steps` per attempt, `first_load_fraction` and
        `min_load_fraction` of cold load stepping, `min_log_step` of the way in log theta.
    """

    def __init__(self, simulator: Simulator, settings: dict):
        self.simulator = simulator
        self.settings = settings

    # ------------------------------------------------------------------- Newton

    def newton(
        self,
        w: np.ndarray,
        theta: np.ndarray,
        pressure: float,
        effort: Effort,
        on_the_way: bool = False,
        offset: np.ndarray | float = 0.0,
    ) -> State:
        """Solve at (theta, pressure) from the field `w`; the factor of the last step stays ready.

        The residual is brought to `offset` (size,), zero in equilibrium.

        A factorisation is kept while it pays: a step with a kept one costs a residual and a
        substitution, a fortieth of a new one. Steps are shortened until the residual grows no
        more than `MOST_GROWTH`-fold: of a predicted field it may grow once, but where the
        exponential law overshoots, every further step would bring it down by Euler's number only.
        States `on_the_way` to another are solved less sharply, `way_tolerance_mm`. The others end
        with a factorisation within `tangent_tolerance_mm` of the solution, for sensitivities.
        """
        simulator, settings = self.simulator, self.settings
        simulator.set(theta, pressure)
        dofs = simulator.displacement_dofs
        tolerance = settings["way_tolerance_mm" if on_the_way else "increment_tolerance_mm"]
        near = np.inf if on_the_way else settings["tangent_tolerance_mm"]
        w = simulator.retract(w)
        residual = simulator.residual(w) - offset
        for _ in range(settings["max_newton_steps"]):
            factorised_at, size, share = w, np.inf, 1.0
            effort.newton_steps += 1
            try:
                simulator.factorise(w)
                while True:
                    before = size
                    step = simulator.solve(residual)
                    size = np.abs(step[dofs]).max()
                    # The first step with a new factorisation is taken in any case.
                    if before < np.inf and size > KEPT_RATE * before:
                        break
                    if not size < settings["max_increment_mm"]:
                        raise NotConverged(f"a Newton step of {size:.3g} mm")
                    w, residual, share = self._shortened(w, step, residual, offset)
                    moved = np.abs((w - factorised_at)[dofs]).max()
                    if size < tolerance and moved < near:
                        return State(w, np.asarray(theta, dtype=float), pressure)
                    if share < 1 or size < near < moved:
                        break
                    effort.kept_steps += 1
            except LinearSolveError as error:
                raise NotConverged(str(error)) from error
        raise NotConverged(f"no convergence in {settings['max_newton_steps']} Newton steps")

    def _shortened(self, w, step, residual, offset):
        """Field and residual after as much of `step` as the residual bears, and that share."""
        bearable = MOST_GROWTH * np.linalg.norm(residual)
        share = 1.0
        while True:
            there = self.simulator.retract(w - share * step)
            after = self.simulator.residual(there) - offset
            if np.linalg.norm(after) < bearable or share <= LEAST_SHARE:
                return there, after, share
            share /= 2

    def settle(self, w: np.ndarray, theta: np.ndarray, pressure: float, effort: Effort) -> State:
        """Solve at (theta, pressure) from a field `w` that Newton's method alone may not bear.

        If it does not, the forces that would hold `w` in equilibrium are taken away in steps.
        """
        try:
            return self.newton(w, theta, pressure, effort)
        except NotConverged:
            forces = self.simulator.residual(w)
        left, share = 1.0, 0.5
        while left > 0:
            rest = 0.0 if share == 1.0 else left * (1 - share)
            try:
                w = self.newton(w, theta, pressure, effort, rest > 0, rest * forces).w
            except NotConverged:
                share /= 2
                if left * share < self.settings["min_release"]:
                    raise
                continue
            left, share = rest, min(1.0, 2 * share)
        return State(w, np.asarray(theta, dtype=float), pressure)

    # ---------------------------------------------------------------- cold start

    def inflate(
        self, theta: np.ndarray, pressure: float, effort: Effort, start: State | None = None
    ) -> State:
        """Load stepping from the reference state (or `start`) with secant prediction.

        Raises `NotConverged` whose `last_pressure` attribute says how far it came.
        """
        theta = np.asarray(theta, dtype=float)
        settings = self.settings
        here = start or State(np.zeros(self.simulator.size), theta, 0.0)
        before = None
        step = settings["first_load_fraction"] * pressure
        while here.pressure != pressure:
            target = here.pressure + step
            if target > pressure - 1e-3 * step:
                target = pressure
            guess = here.w
            if before is not None:
                ratio = (target - here.pressure) / (here.pressure - before.pressure)
                guess = here.w + ratio * (here.w - before.w)
            steps_before = effort.newton_steps
            try:
                found = self.newton(guess, theta, target, effort, on_the_way=target != pressure)
            except NotConverged as error:
                step = (target - here.pressure) / 3
                if step < settings["min_load_fraction"] * pressure:
                    failure = NotConverged(f"at {here.pressure:.3f} mmHg: {error}")
                    failure.last_pressure = here.pressure
                    raise failure from error
                continue
            before, here = here, found
            spent = effort.newton_steps - steps_before
            step = (here.pressure - before.pressure) * (2.0 if spent <= 4 else 1.3)
        return here

    # ----------------------------------------------------------------- warm start

    def follow(
        self, start: State, tangents: np.ndarray, theta: np.ndarray, effort: Effort
    ) -> State:
        """Go from a solved `start` to `theta` at the same pressure, in steps of log theta.

        `tangents` (10, size) is d(w)/d(log theta) at the start. The whole way is tried first,
        shorter ones after a failure, each predicted along the tangents.
        """
        goal = np.log(theta)
        here, slope = start, tangents
        fraction = 1.0
        while True:
            way = goal - np.log(here.theta)
            # Of no length too: the factor that sensitivities need is that of the last Newton step.
            length = np.abs(way).max()
            share = min(1.0, fraction)
            target = theta if share == 1.0 else np.exp(np.log(here.theta) + share * way)
            try:
                guess = here.w + (share * way) @ slope
                found = self.newton(guess, target, here.pressure, effort, on_the_way=share < 1)
            except NotConverged:
                fraction = share / 2
                if fraction * length < self.settings["min_log_step"]:
                    raise
                continue
            if share == 1.0:
                return found
            here = found
            slope = self.simulator.field_sensitivities(here.w)
            fraction = 2 * share / (1 - share)


@dataclass
class Solved:
    """A solution kept as a start for others, with its tangents d(w)/d(log theta)."""

    state: State
    tangents: np.ndarray


class WarmStarts:
    """Solves one theta after another, each from the nearest solution already found."""

    def __init__(self, solver: Solver, pressure: float, frames=()):
        self.solver = solver
        self.pressure = pressure
        self.frames = sorted(frames, reverse=True)
        self.pool: list[Solved] = []

    def run_all(self, thetas: np.ndarray):
        """Simulate the rows of `thetas` (n, 10); yield (row, Simulation) as they finish.

        Always the row closest in log theta to what is already solved comes next: the solved
        region grows outwards in short steps. The order depends on the rows alone.
        """
        waiting = list(range(len(thetas)))
        logs = np.log(thetas)
        distance = np.full(len(thetas), np.inf)
        seen = 0
        while waiting:
            for solved in self.pool[seen:]:
                gap = np.sum((logs - np.log(solved.state.theta)) ** 2, axis=1)
                distance = np.minimum(distance, gap)
            seen = len(self.pool)
            row = waiting.pop(int(np.argmin(distance[waiting])))
            yield row, self.run(thetas[row])

    def run(self, theta: np.ndarray) -> Simulation:
        """Simulate `theta` (10,), whatever comes of it."""
        theta = np.asarray(theta, dtype=float)
        started, effort = time.process_time(), Effort()
        result = Simulation(theta, "converged", last_pressure=self.pressure)
        try:
            state = self._reach(theta, effort)
        except NotConverged as error:
            result.status, result.reason = "failed", str(error)
            result.last_pressure = getattr(error, "last_pressure", 0.0)
        else:
            self._observe(state, result, effort)
        result.newton_steps = effort.newton_steps
        result.cpu_s = time.process_time() - started
        return result

    def _reach(self, theta: np.ndarray, effort: Effort) -> State:
        solver = self.solver
        if self.pool:
            distance = [np.sum((np.log(theta) - np.log(s.state.theta)) ** 2) for s in self.pool]
            nearest = self.pool[int(np.argmin(distance))]
            try:
                return solver.follow(nearest.state, nearest.tangents, theta, effort)
            except NotConverged:
                pass
        return solver.inflate(theta, self.pressure, effort)

    def _observe(self, state: State, result: Simulation, effort: Effort) -> None:
        simulator = self.solver.simulator
        tangents = simulator.field_sensitivities(state.w)
        self.pool.append(Solved(state, tangents))
        result.observables = simulator.observables(state.w)
        per_log = simulator.directional_derivatives(state.w, tangents)
        result.sensitivity = (per_log / state.theta[:, None]).T
        if self.frames:
            self._deflate(state, result, effort)

    def _deflate(self, state: State, result: Simulation, effort: Effort) -> None:
        """Observables at the load fractions, by unloading from the end-diastolic state."""
        solver, simulator = self.solver, self.solver.simulator
        here, slope = state, simulator.pressure_sensitivity(state.w)
        for fraction in self.frames:
            target = fraction * self.pressure
            while here.pressure != target:
                step = target - here.pressure
                while True:
                    try:
                        goal = target if here.pressure + step == target else here.pressure + step
                        found = solver.newton(here.w + step * slope, state.theta, goal, effort)
                        break
                    except NotConverged:
                        step /= 2
                        if abs(step) < solver.settings["min_load_fraction"] * self.pressure:
                            return
                here, slope = found, simulator.pressure_sensitivity(found.w)
            result.frames[fraction] = simulator.observables(here.w)
