"""Single ventricles, simulated in full at any values of a study's inputs."""

from functools import cached_property
from pathlib import Path

import numpy as np
import torch

from regional_lv.channels import Channels
from regional_lv.geometry.mesh import Mesh, read_mesh
from regional_lv.inputs.evaluation import AllInputs
from regional_lv.inputs.space import Inputs
from regional_lv.mechanics.continuation import Effort, NotConverged, Runner, Solver
from regional_lv.mechanics.predictor import load_predictors
from regional_lv.mechanics.problem import Problem


class Ventricles:
    """Simulates ventricles, each by the full simulator.

    Attributes: `inputs`, K of them, closed forms among them; `channels`, D of them.

    Parameters
    ----------
    mesh: or its file; of the ventricle of the study, as fine as may be.
    predictor: of that mesh and the simulated inputs (`mechanics.predictor`); None inflates every
        ventricle from the unloaded state, by load stepping.
    """

    def __init__(
        self, mesh: str | Path | Mesh, inputs: Inputs, predictor: str | Path | None = None
    ):
        self._mesh = mesh if isinstance(mesh, Mesh) else read_mesh(mesh)
        self._predictor, self.inputs = predictor, inputs
        self.channels = Channels.from_config(inputs.base)
        self._outputs = AllInputs(inputs, self.channels)

    def altered(self, inputs: Inputs) -> "Ventricles":
        """The same with other inputs, or of another model; fields are predicted where these are of
        the same inputs."""
        known = inputs.simulated.names == self.inputs.simulated.names
        return Ventricles(self._mesh, inputs, self._predictor if known else None)

    def outputs(self, x: np.ndarray) -> np.ndarray:
        """The channels' values (D,), without noise, at values x (K,).

        Raises ArithmeticError, with the reason, for a ventricle that cannot be inflated.
        """
        values = torch.as_tensor(np.asarray(x, dtype=float))[None]
        found = self._outputs.values(
            lambda at: torch.as_tensor(self._run(at[0].numpy()))[None], values
        )
        return found[0].numpy()

    @cached_property
    def _solver(self) -> Solver:
        problem = Problem(self._mesh, self.inputs.simulated)
        return Solver(problem, self.inputs.base["solver"])

    @cached_property
    def _runner(self) -> Runner | None:
        if self._predictor is None:
            return None
        guesses = load_predictors(self._predictor, self.inputs.simulated.coordinates)
        return Runner(self._solver, guesses, sensitivities=False)

    def _run(self, values: np.ndarray) -> np.ndarray:
        """Outputs (D,) at values of the simulated inputs."""
        if self._runner is None:
            return self._inflated(values)
        result = self._runner.run(values)
        if result.status != "converged":
            raise NotConverged(result.reason)
        return result.observables

    def _inflated(self, values: np.ndarray) -> np.ndarray:
        simulator, effort = self._solver.simulator, Effort()
        found = np.empty(len(self.channels))
        for load in self.channels.load_fractions:
            state = self._solver.inflate(values, load * simulator.full_pressure, effort)
            found[simulator.places_of(load)] = simulator.observables(state.w, fraction=load)[0]
        return found
