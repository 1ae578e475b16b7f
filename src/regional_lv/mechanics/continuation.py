"""How an equilibrium is reached: Newton's method, from nothing or from a guessed field.

A simulation never raises for want of convergence: it returns what happened (status, reason, last
converged pressure), because a configuration that cannot be solved is a result of the study.
"""

import time
from dataclasses import dataclass, field

import numpy as np

from regional_lv import aha
from regional_lv.mechanics.equilibrium import LinearSolveError
from regional_lv.mechanics.simulator import Simulator, State

# How far the residual may grow in a step, and the smallest share of a step that is tried.
MOST_GROWTH = 2.0
LEAST_SHARE = 1 / 16

# A kept factorisation: how many steps are mixed, and after how many without a gain it is given up.
# A step costs a thirtieth of a factorisation.
MIXED_STEPS, MOST_KEPT, PATIENCE, GAIN = 12, 60, 8, 0.7


class NotConverged(ArithmeticError):
    """Newton's method stopped without a solution; the message says how."""


@dataclass
class Effort:
    """Newton steps with a new tangent (one assembly and factorisation each) spent so far."""

    newton_steps: int = 0


@dataclass
class Simulation:
    """One finished run: `observables` (52,), `sensitivity` (52, 10) and what it took.

    `frames` holds the observables at the asked load fractions, `last_pressure` (mmHg) how far the
    inflation got, `reason` why it failed (empty if it converged), `state` the solution with its
    `tangents` (10, size), d(w)/d(log theta).
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
    state: State | None = field(default=None, repr=False)
    tangents: np.ndarray | None = field(default=None, repr=False)


class Mixing:
    """Anderson's mixing of fixed-point steps; `dofs` are those whose steps are made small."""

    def __init__(self, dofs: np.ndarray):
        self._dofs = dofs
        self._last = None
        self._moves, self._changes = [], []

    def mixed(self, w: np.ndarray, step: np.ndarray) -> np.ndarray:
        """The step to take from `w` in place of `step`; the first one is left as it is."""
        last, self._last = self._last, (w, step)
        if last is None:
            return step
        before, its_step = last
        self._moves = [*self._moves, w - before][-MIXED_STEPS:]
        self._changes = [*self._changes, step - its_step][-MIXED_STEPS:]
        changes = np.stack([change[self._dofs] for change in self._changes], axis=1)
        weights = np.linalg.lstsq(changes, step[self._dofs], rcond=1e-10)[0]
        for weight, move, change in zip(weights, self._moves, self._changes, strict=True):
            step = step - weight * (move + change)
        return step


class Solver:
    """Reaches equilibria of a `Simulator`.

    Parameters
    ----------
    simulator: the discretised problem.
    settings: config section `solver`.
    kept: whether a factorisation is kept for further steps; if not, every step has its own.
    """

    def __init__(self, simulator: Simulator, settings: dict, kept: bool = True):
        self.simulator = simulator
        self.settings = settings
        self.most_kept = MOST_KEPT if kept else 0

    # ------------------------------------------------------------------- Newton

    def newton(
        self,
        w: np.ndarray,
        theta: np.ndarray,
        pressure: float,
        effort: Effort,
        on_the_way: bool = False,
        tangent: bool = True,
    ) -> State:
        """Solve at (theta, pressure) from the field `w`; the factor of the last step stays ready.

        Steps are shortened until the residual grows no more than `MOST_GROWTH`-fold: of a predicted
        field it may grow once, but where the exponential law overshoots, every further step would
        bring it down by Euler's number only. States `on_the_way` to another are solved less
        sharply, `way_tolerance_mm`. The others end, if their `tangent` is wanted, with a
        factorisation within `tangent_tolerance_mm` of the solution.
        """
        simulator, settings = self.simulator, self.settings
        simulator.set(theta, pressure)
        tolerance = settings["way_tolerance_mm" if on_the_way else "increment_tolerance_mm"]
        near = settings["tangent_tolerance_mm"] if tangent and not on_the_way else np.inf
        w = simulator.retract(w)
        for _ in range(settings["max_newton_steps"]):
            effort.newton_steps += 1
            try:
                simulator.factorise(w)
                w, solved = self._kept_steps(w, tolerance, near)
            except LinearSolveError as error:
                raise NotConverged(str(error)) from error
            if solved:
                return State(w, np.asarray(theta, dtype=float), pressure)
        raise NotConverged(f"no convergence in {settings['max_newton_steps']} Newton steps")

    def _kept_steps(
        self, start: np.ndarray, tolerance: float, near: float
    ) -> tuple[np.ndarray, bool]:
        """Steps with the factorisation of `start` while they pay; the field, and whether solved.

        Solved it is by a first step below `tolerance`, or by a later one below a tenth of it, as
        these converge linearly, no further than `near` from the start. Anderson's mixing of the
        last steps (Walker and Ni 2011, doi 10.1137/10078356X) learns what has become of the
        tangent, which changes most where fibres pass from slack to taut.
        """
        simulator, dofs = self.simulator, self.simulator.displacement_dofs
        limit = self.settings["max_increment_mm"]
        mixing = Mixing(dofs.ravel())
        residual = simulator.residual(start)
        step = -simulator.solve(residual)
        size = np.abs(step[dofs]).max()
        if not size < limit:
            raise NotConverged(f"a Newton step of {size:.3g} mm")
        # The first step is taken in any case, those after it only while they shrink.
        w, residual, share = self._shortened(start, step, residual)
        if share < 1 or size < tolerance:
            return w, share == 1
        mixing.mixed(start, step)
        best, least, without_gain = w, np.inf, 0
        for _ in range(self.most_kept):
            step = -simulator.solve(residual)
            size = np.abs(step[dofs]).max()
            without_gain = without_gain + 1 if size > GAIN * least else 0
            if size < least:
                best, least = w, size
            if without_gain > PATIENCE or not size < limit:
                break
            step = mixing.mixed(w, step)
            there = simulator.retract(w + step)
            moved = np.abs((there - start)[dofs]).max()
            enough = (tolerance if moved < near else near) / 10
            if max(size, np.abs(step[dofs]).max()) < enough:
                return there, moved < near
            w, residual = there, simulator.residual(there)
            if not np.isfinite(residual).all():
                break
        return best, False

    def _shortened(self, w, step, residual):
        """Field and residual after as much of `step` as the residual bears, and that share."""
        bearable = MOST_GROWTH * np.linalg.norm(residual)
        share = 1.0
        while True:
            there = self.simulator.retract(w + share * step)
            after = self.simulator.residual(there)
            if np.linalg.norm(after) < bearable or share <= LEAST_SHARE:
                return there, after, share
            share /= 2

    # ---------------------------------------------------------------- cold start

    def inflate(self, theta: np.ndarray, pressure: float, effort: Effort) -> State:
        """Load stepping from the reference state with secant prediction.

        Raises `NotConverged` whose `last_pressure` attribute says how far it came.
        """
        theta = np.asarray(theta, dtype=float)
        settings = self.settings
        here = State(np.zeros(self.simulator.size), theta, 0.0)
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


class Runner:
    """Runs simulations one by one, each from a guessed field.

    `guess` has a method `field(theta)`, as `Known` and `Predictor` in `predictor` have; `pressure`
    (mmHg) is the end-diastolic one, `frames` the further load fractions to observe;
    `sensitivities` tells whether derivatives are wanted.
    """

    def __init__(self, solver: Solver, guess, pressure: float, frames=(), sensitivities=True):
        self.solver = solver
        self.guess = guess
        self.pressure = pressure
        self.frames = sorted(frames, reverse=True)
        self.sensitivities = sensitivities

    def run(self, theta: np.ndarray) -> Simulation:
        """Simulate `theta` (10,), whatever comes of it."""
        theta = np.asarray(theta, dtype=float)
        started, effort = time.process_time(), Effort()
        result = Simulation(theta, "converged", last_pressure=self.pressure)
        try:
            result.state = self._reach(theta, effort)
        except NotConverged as error:
            result.status, result.reason = "failed", str(error)
            result.last_pressure = getattr(error, "last_pressure", 0.0)
        else:
            self._observe(result, effort)
        result.newton_steps = effort.newton_steps
        result.cpu_s = time.process_time() - started
        return result

    def _reach(self, theta: np.ndarray, effort: Effort) -> State:
        try:
            return self._try(theta, effort)
        except NotConverged:
            return self.solver.inflate(theta, self.pressure, effort)

    def _try(self, theta: np.ndarray, effort: Effort) -> State:
        guess = self.guess.field(theta)
        return self.solver.newton(guess, theta, self.pressure, effort, tangent=self.sensitivities)

    def _observe(self, result: Simulation, effort: Effort) -> None:
        simulator, state = self.solver.simulator, result.state
        result.observables = simulator.observables(state.w)
        if self.sensitivities:
            result.tangents = simulator.field_sensitivities(state.w)
            per_log = simulator.directional_derivatives(state.w, result.tangents)
            result.sensitivity = (per_log / state.theta[:, None]).T
        if self.frames:
            self._lower(state, result, effort)

    def _lower(self, state: State, result: Simulation, effort: Effort) -> None:
        """Observables at the load fractions, each from a guess as the full load's was."""
        here = state
        for fraction in self.frames:
            target = fraction * self.pressure
            missed = here.w - self._guess_at(state.theta, here.pressure / self.pressure)
            guess = self._guess_at(state.theta, fraction) + target / here.pressure * missed
            try:
                here = self.solver.newton(guess, state.theta, target, effort, tangent=False)
            except NotConverged:
                try:
                    here = self.solver.inflate(state.theta, target, effort)
                except NotConverged:
                    return
            result.frames[fraction] = self.solver.simulator.observables(here.w)

    def _guess_at(self, theta: np.ndarray, fraction: float) -> np.ndarray:
        """Guessed field at a `fraction` of the load: stresses are proportional to C_a, so that the
        displacement is that of a wall as many times stiffer at the full load, and the pressures in
        the wall are as many times smaller. Springs and other loads make it a worse guess only."""
        stiffer = np.where(aha.IS_C_A, theta / fraction, theta)
        guess = fraction * self.guess.field(stiffer)
        guess[self.solver.simulator.displacement_dofs] /= fraction
        return guess


class GrowingRunner(Runner):
    """A runner whose guess, a `predictor.Known` with a solution at least, learns from every run."""

    def run(self, theta: np.ndarray) -> Simulation:
        """Simulate `theta` (10,), whatever comes of it, and make it known."""
        result = super().run(theta)
        if result.state is not None:
            self.guess.add(result.theta, result.state.w, result.tangents)
        return result

    def run_all(self, thetas: np.ndarray):
        """Simulate the rows of `thetas` (n, 10); yield (row, Simulation).

        Always the row closest in log theta to what is known comes next: the solved region grows in
        short steps.
        """
        waiting = list(range(len(thetas)))
        while waiting:
            row = waiting.pop(int(np.argmin(self.guess.distance(thetas[waiting]))))
            yield row, self.run(thetas[row])

    def _reach(self, theta: np.ndarray, effort: Effort, halvings: int = 3) -> State:
        if not halvings:
            return super()._reach(theta, effort)
        try:
            return self._try(theta, effort)
        except NotConverged:
            halfway = np.sqrt(theta * self.guess.nearest(theta))
        state = self._reach(halfway, effort, halvings - 1)
        self.guess.add(halfway, state.w, self.solver.simulator.field_sensitivities(state.w))
        return self._reach(theta, effort, halvings - 1)
