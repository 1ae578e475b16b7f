"""How an equilibrium is reached: Newton's method, from nothing or from a guessed field.

A simulation never raises for want of convergence: it returns what happened (status, reason, last
converged pressure), because a configuration that cannot be solved is a result of the study.
"""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.inputs.coordinates import Coordinates
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.mechanics.equilibrium import Equilibrium, LinearSolveError
from regional_lv.mechanics.simulator import Simulator, State

# How far the residual may grow in a step, and the smallest share of a step that is tried.
MOST_GROWTH = 2.0
LEAST_STEP = 1 / 16  # on the way from one solution to another
DIFFERENCE = 1e-4  # share of that way
LEAST_SHARE = 1 / 16

# A kept factorisation: how many steps are mixed, and after how many without a gain it is given up.
# A step costs a thirtieth of a factorisation.
MIXED_STEPS, MOST_KEPT, PATIENCE, GAIN = 12, 60, 8, 0.7


AnyEquilibrium = TypeVar("AnyEquilibrium", bound=Equilibrium)


class NotConverged(ArithmeticError):
    """Newton's method stopped without a solution; the message says how.

    `last_pressure` (mmHg): how far the inflation got.
    """

    last_pressure = 0.0


@contextmanager
def failure_is_not_converged(reached: float = 0.0) -> Iterator[None]:
    """A shape without a smooth wall, and a system without a finite solution, is `NotConverged`;
    derivatives ask for shapes beside a smooth one, too. reached: its `last_pressure`."""
    try:
        yield
    except (InputError, LinearSolveError) as error:
        failure = NotConverged(str(error))
        failure.last_pressure = reached
        raise failure from error


@dataclass
class Effort:
    """Newton steps with a new tangent (one assembly and factorisation each) spent so far."""

    newton_steps: int = 0


@dataclass(frozen=True)
class Solution:
    """The state at one load, and its `tangents` (P, size), the derivatives of the field with
    respect to the scaled coordinates of theta, if wanted."""

    state: State
    tangents: np.ndarray | None = None


@dataclass
class Simulation:
    """One finished run: `observables` (D,), `sensitivity` (D, P) and what it took.

    `last_pressure` (mmHg) how far the inflation got, `reason` why it failed (empty if it
    converged), `solutions` by load fraction. Of a failed run all observables are NaN.
    """

    theta: np.ndarray
    status: str
    observables: np.ndarray
    reason: str = ""
    last_pressure: float = 0.0
    newton_steps: int = 0
    cpu_s: float = 0.0
    sensitivity: np.ndarray | None = None
    solutions: dict[float, Solution] = field(default_factory=dict, repr=False)

    @property
    def state(self) -> State | None:
        """The end-diastolic one, None if the run failed."""
        return self.solutions[1.0].state if self.status == "converged" else None


class Mixing:
    """Anderson's mixing of fixed-point steps; dofs: entries over which the least squares is
    taken."""

    def __init__(self, dofs: np.ndarray):
        self._dofs = dofs
        self._last: tuple[np.ndarray, np.ndarray] | None = None
        self._moves: list[np.ndarray] = []
        self._changes: list[np.ndarray] = []

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


class Solver(Generic[AnyEquilibrium]):
    """Reaches equilibria of a `Simulator`, or of another `Equilibrium`.

    Parameters
    ----------
    simulator: the discretised problem.
    settings: config section `solver`.
    kept: whether a factorisation is kept for further steps; if not, every step has its own.
    """

    def __init__(self, simulator: AnyEquilibrium, settings: dict, kept: bool = True):
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
        factorisation within `tangent_tolerance_mm` of the solution. Raises `NotConverged`, also
        for a theta with a shape that has no smooth wall.
        """
        simulator, settings = self.simulator, self.settings
        with failure_is_not_converged():  # on the way between two shapes lies one that is none
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
            with np.errstate(over="ignore"):  # of a step much too far, which is halved
                bears = np.linalg.norm(after) < bearable
            if bears or share <= LEAST_SHARE:
                return there, after, share
            share /= 2

    def change_along(self: "Solver[Simulator]", state: State, direction: np.ndarray) -> np.ndarray:
        """Derivative (size,) of a solution's field along a `direction` (P,) of the scaled inputs,
        with the factor of its last step.

        By a difference of the residual, which costs a fraction of the derivatives with respect to
        all inputs: ahead, where every input stays in its range. Raises `NotConverged` next to a
        shape that has no smooth wall, and where nothing finite is found."""
        simulator, scales = self.simulator, self.simulator.coordinates
        beside = scales.natural(scales.scaled(state.theta) + DIFFERENCE * direction)
        with failure_is_not_converged():
            simulator.set(beside, state.pressure)
            there = simulator.residual(state.w)
            simulator.set(state.theta, state.pressure)
            return -simulator.solve((there - simulator.residual(state.w)) / DIFFERENCE)

    # ---------------------------------------------------------------- cold start

    def inflate(self, theta: np.ndarray, pressure: float, effort: Effort) -> State:
        """Load stepping from the reference state with secant prediction.

        Raises `NotConverged` whose `last_pressure` attribute says how far it came.
        """
        theta = np.asarray(theta, dtype=float)
        settings = self.settings
        with failure_is_not_converged():  # smaller loads would not help
            self.simulator.set(theta, 0.0)
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

    def inflate_all(
        self: "Solver[Simulator]", theta: np.ndarray, effort: Effort
    ) -> dict[float, Solution]:
        """Solutions with tangents at every observed load, by load fraction, each from nothing.

        Raises `NotConverged`.
        """
        simulator, found = self.simulator, {}
        for load in simulator.channels.load_fractions:
            state = self.inflate(theta, load * simulator.full_pressure, effort)
            with failure_is_not_converged(state.pressure):
                found[load] = Solution(state, simulator.tangents(state))
        return found


class Runner:
    """Runs simulations one by one, each from guessed fields.

    `guesses` has, by load fraction, an object with a method `field(theta)`, as `Known` and
    `Predictor` in `predictor` have; a load without one is guessed from the full load's.
    `sensitivities` tells whether derivatives are wanted.
    """

    def __init__(self, solver: Solver[Simulator], guesses: Mapping, sensitivities: bool = True):
        self.solver, self.guesses = solver, guesses
        self.sensitivities = sensitivities

    @property
    def parameters(self) -> StiffnessInputs:
        return self.solver.simulator.parameters

    @property
    def coordinates(self) -> Coordinates:
        """Of theta."""
        return self.solver.simulator.coordinates

    @property
    def channels(self) -> Channels:
        return self.solver.simulator.channels

    def run(self, theta: np.ndarray) -> Simulation:
        """Simulate `theta` (P,), whatever comes of it."""
        theta = np.asarray(theta, dtype=float)
        started, effort = time.process_time(), Effort()
        result = Simulation(theta, "converged", np.full(len(self.channels), np.nan))
        pressure = self.solver.simulator.full_pressure
        if self.sensitivities:
            result.sensitivity = np.full((len(self.channels), len(theta)), np.nan)
        try:
            for fraction in self.channels.load_fractions:
                state = self._reach(theta, fraction, effort, result.solutions)
                result.solutions[fraction] = self._observe(state, fraction, result)
        except NotConverged as error:
            result.status = "failed"
            result.reason = str(error) if not result.solutions else f"load {fraction:g}: {error}"
            result.last_pressure = error.last_pressure
            result.observables[:] = np.nan
            result.sensitivity = None
        else:
            result.last_pressure = pressure
        result.newton_steps = effort.newton_steps
        result.cpu_s = time.process_time() - started
        return result

    def _reach(self, theta, fraction: float, effort: Effort, known: dict) -> State:
        """The state at a load; `known` holds the solutions at larger ones."""
        pressure = fraction * self.solver.simulator.full_pressure
        try:
            guess = self._guess(theta, fraction, known)
            return self.solver.newton(guess, theta, pressure, effort, tangent=self.sensitivities)
        except NotConverged:
            pass
        try:
            if fraction == 1.0:
                return self._walk(theta, effort)
        except NotConverged:
            pass
        return self.solver.inflate(theta, pressure, effort)

    def _walk(self, theta: np.ndarray, effort: Effort) -> State:
        """The end-diastolic state by way of others, from the nearest solution that is known, each
        predicted from the one before. Raises `NotConverged`."""
        solver, scales, known = self.solver, self.coordinates, self.guesses[1.0]
        pressure, start = solver.simulator.full_pressure, known.nearest(theta)
        first, last = scales.scaled(start), scales.scaled(theta)
        state = solver.newton(known.field(start), start, pressure, effort, on_the_way=True)
        ahead = solver.change_along(state, last - first)
        share, step = 0.0, 0.5
        while share < 1:
            there = min(1.0, share + step)
            on_the_way = there < 1
            goal = scales.natural(first + there * (last - first)) if on_the_way else theta
            guess = state.w + (there - share) * ahead
            try:
                state = solver.newton(
                    guess, goal, pressure, effort, on_the_way, tangent=self.sensitivities
                )
            except NotConverged:
                step /= 2
                if step < LEAST_STEP:
                    raise
                continue
            share, step = there, 2 * step
            if share < 1:
                ahead = solver.change_along(state, last - first)
        return state

    def _guess(self, theta: np.ndarray, fraction: float, known: dict) -> np.ndarray:
        """Guessed field, with what the guess at the next larger load missed, as much smaller."""
        guess = self._guess_alone(theta, fraction)
        if not known:
            return guess
        above = min(known)
        missed = known[above].state.w - self._guess_alone(theta, above)
        return guess + fraction / above * missed

    def _guess_alone(self, theta: np.ndarray, fraction: float) -> np.ndarray:
        """The field at a load, from the guesses for that load or else for the full one: stresses
        are proportional to one factor of the law, so that the displacement is that of a wall as
        many times stiffer at the full load, and the pressures in the wall are as many times
        smaller. Springs make it a worse guess only."""
        if fraction in self.guesses:
            return self.guesses[fraction].field(theta)
        guess = self.guesses[1.0].field(self.solver.simulator.stiffer(theta, 1 / fraction))
        guess *= fraction
        guess[self.solver.simulator.displacement_dofs] /= fraction
        return guess

    def _observe(self, state: State, fraction: float, result: Simulation) -> Solution:
        simulator = self.solver.simulator
        at, tangents = simulator.places_of(fraction), None
        if result.sensitivity is None:
            result.observables[at] = simulator.observables(state.w, fraction=fraction)[0]
        else:
            with failure_is_not_converged(state.pressure):
                values, slopes, tangents = simulator.differentiated(state, fraction)
            result.observables[at] = values
            by_theta = slopes / self.coordinates.slope(state.theta)[:, None]
            result.sensitivity[at] = by_theta.T
        return Solution(state, tangents)


class GrowingRunner(Runner):
    """A runner whose guesses, a `predictor.Known` with a solution for every load, learn from every
    run."""

    def run(self, theta: np.ndarray) -> Simulation:
        """Simulate `theta` (P,), whatever comes of it, and make it known."""
        result = super().run(theta)
        for fraction, found in result.solutions.items():
            self.guesses[fraction].add(result.theta, found.state.w, found.tangents)
        return result

    def run_all(self, thetas: np.ndarray):
        """Simulate the rows of `thetas` (n, P); yield (row, Simulation).

        Always the row closest to what is known comes next: the solved region grows in
        short steps.
        """
        waiting, known = list(range(len(thetas))), self.guesses[1.0]
        while waiting:
            row = waiting.pop(int(np.argmin(known.distance(thetas[waiting]))))
            yield row, self.run(thetas[row])
