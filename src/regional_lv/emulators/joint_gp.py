"""The gradient-enhanced process over all inputs, on the scale on which effects add up."""

import copy
from collections.abc import Sequence

import numpy as np
import torch

from regional_lv.emulators.base import Emulator, Prediction, TrainingSet
from regional_lv.emulators.gradient_gp import GradientGP
from regional_lv.emulators.output_scale import OutputScale
from regional_lv.errors import InputError


class JointGP(Emulator):
    """A `GradientGP` of log volume and log stretch (`OutputScale`), with the settings of that.

    Its errors are those of the process times the slope of the scale, correlated between outputs.

    `processes` add up on the scale, and so do their errors, which are independent: the first is
    that of the simulations that it was fitted to, a second one what a finer mesh changes
    (`finer.corrected`).
    """

    name = "joint_gp"
    learns_from_sensitivities = True
    processes: tuple[GradientGP, ...]

    def _fit(self, training: TrainingSet, seed: int) -> None:
        self.scale = OutputScale.of(self.outputs, self.coordinates)
        theta = self._unstandardise(training.x)
        y = self.output_mean + self.output_sd * training.y
        assert training.slopes is not None  # it learns from sensitivities
        slopes = training.slopes * self.output_sd[:, None]
        slopes = slopes * self.standardise_slope(theta)[:, None, :]
        given = (each.numpy() for each in (theta, *self.on_scale(theta, y, slopes)))
        process = GradientGP(**self.settings).fit(
            *given, parameters=self.parameters, outputs=self.outputs, seed=seed
        )
        self.processes, self.info = (process,), process.info

    def on_scale(
        self, theta: torch.Tensor, y: torch.Tensor, sensitivities: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Outputs (N, D) and sensitivities (N, D, P) of simulations at theta (N, P) on the scale.

        Raises InputError for what no volume or strain can be.
        """
        v = self.scale.of_outputs(y, theta)
        bad = ~torch.isfinite(v)
        if bad.any():
            row, column = bad.nonzero()[0].tolist()
            raise InputError(
                f"training set: {self.outputs[column]} has values that no volume, or no strain of "
                f"its exponent, can have (row {row}: {y[row, column]:g}); check the outputs' units"
            )
        return v, self.scale.to_scale(sensitivities, v, theta)

    def with_process(self, process: GradientGP) -> "JointGP":
        """This emulator with a further process, of the same inputs, that adds to it on the
        scale."""
        added = copy.copy(self)
        added.processes = (*self.processes, process.select(self.outputs))
        return added

    def condition(
        self,
        theta: np.ndarray,
        y: np.ndarray,
        sensitivities: np.ndarray,
        about: Sequence[int] | None = None,
    ) -> "JointGP":
        """This emulator given further simulations of the study's mesh as well, which its training
        set did not have: seconds instead of another training; hyperparameters and calibration stay.

        theta (m, P), y (m, D), sensitivities d(y)/d(theta) (m, D, P), natural units, of this
        emulator's outputs. about: places of the inputs whose sensitivities are known; None: of
        all. See `GradientGP.condition`.

        Raises InputError for shapes that do not fit, numbers that are not finite, and what no
        volume or strain can be.
        """
        theta, y, slopes = self._checked(theta, y, sensitivities)
        v, slopes = self.on_scale(theta, y, slopes)
        first, *others = self.processes
        given = copy.copy(self)
        given.processes = (first.condition(theta, v, slopes, about), *others)
        given.inputs = given.processes[0].inputs
        return given

    def at_fixed(self, theta: torch.Tensor, mask: torch.Tensor) -> "JointGP":
        """As `GradientGP.at_fixed`."""
        given = copy.copy(self)
        given.processes = tuple(process.at_fixed(theta, mask) for process in self.processes)
        return given

    @property
    def of_study_mesh(self) -> "JointGP":
        """Without what a finer mesh changes."""
        plain = copy.copy(self)
        plain.processes = self.processes[:1]
        return plain

    @torch.no_grad()
    def errors_of(self, theta: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        """Simulated outputs y (n, D) at theta (n, P) less the emulated ones, in stated sds,
        (n, D)."""
        found = self.predict(torch.as_tensor(theta))
        return (torch.as_tensor(y) - found.mean) / found.sd

    def _predict(self, theta):
        found = [process.predict(theta) for process in self.processes]
        v = sum(each.mean for each in found)
        by_v, _ = self.scale.slopes(v, theta)
        # A posterior over many inputs knows no directions along which errors are larger.
        covariance = sum(
            process.jacobian_factor * each.covariance
            for process, each in zip(self.processes, found, strict=True)
        )
        covariance = by_v[..., :, None] * covariance * by_v[..., None, :]
        return Prediction(self.scale.outputs(v, theta), covariance)

    def predict_mean(self, theta):
        v = sum(process.predict_mean(theta) for process in self.processes)
        return self.scale.outputs(v, theta)

    def linearise(self, theta):
        found = [process.linearise(theta) for process in self.processes]
        v, slopes = (sum(parts) for parts in zip(*found, strict=True))
        return self.scale.outputs(v, theta), self.scale.from_scale(slopes, v, theta)

    def jacobian(self, theta):
        return self.linearise(theta)[1], None

    def _select(self, index):
        names = [self.processes[0].outputs[i] for i in index]
        self.processes = tuple(process.select(names) for process in self.processes)
        self.scale = self.scale.select(index)

    def _state(self):
        return {"processes": [process.content() for process in self.processes]}

    def _restore(self, state):
        self.processes = tuple(
            GradientGP.from_content(content, "this emulator") for content in state["processes"]
        )
        self.scale = OutputScale.of(self.outputs, self.coordinates)
