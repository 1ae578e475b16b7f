"""The gradient-enhanced process over all inputs, on the scale on which effects add up."""

import copy
from dataclasses import replace

import numpy as np
import torch

from regional_lv.emulators.base import Emulator, Prediction, TrainingSet
from regional_lv.emulators.gradient_gp import GradientGP
from regional_lv.emulators.output_scale import OutputScale
from regional_lv.emulators.segment_network import SegmentNetworks, out_of_fold
from regional_lv.emulators.shared_kernel import subset
from regional_lv.errors import InputError
from regional_lv.seeds import derive


class NetworkErrors(GradientGP):
    """The process of the errors of networks, from what others, which did not learn from a
    simulation, left of it.

    Those that learnt from all of them leave next to nothing there: its mean is zero, and what is
    known of a simulation is that.
    """

    def _fit(self, training: TrainingSet, seed: int) -> None:
        super()._fit(training, seed)
        for each in (self.mean, self.weights, self.output_mean):
            each.zero_()
        self._clear_cached("_by_simulation")

    def _leave_one_out(self, precision, targets):
        _, variances = super()._leave_one_out(precision, targets)
        return targets[: len(variances)] + self.output_mean / self.output_sd, variances


class JointGP(Emulator):
    """A `GradientGP` of log volume and log stretch (`OutputScale`), with the settings of that.

    Its errors are those of the process times the slope of the scale, correlated between outputs.

    `trend`, if its networks are trained (`network_passes`), is what is known of every wall
    (`segment_network`): the process is then that of its errors.

    `processes` add up on the scale, and so do their errors, which are independent: the first is
    that of the simulations that it was fitted to, a second one what a finer mesh changes
    (`finer.corrected`). With `errors_known` the errors on the study's mesh do not count: what is
    simulated there tells them (`with_known_errors`).
    """

    name = "joint_gp"
    learns_from_sensitivities = True
    processes: tuple[GradientGP, ...]
    trend: SegmentNetworks | None = None
    errors_known = False

    def _fit(self, training: TrainingSet, seed: int) -> None:
        self.scale = OutputScale.of(self.outputs, self.coordinates)
        self._kept = torch.arange(len(self.outputs))
        theta = self._unstandardise(training.x)
        y = self.output_mean + self.output_sd * training.y
        assert training.slopes is not None  # it learns from sensitivities
        slopes = training.slopes * self.output_sd[:, None]
        slopes = slopes * self.standardise_slope(theta)[:, None, :]
        v, slopes = self.on_scale(theta, y, slopes)
        own = {k: value for k, value in self.settings.items() if not k.startswith("network_")}
        process = GradientGP(**own)
        if self.settings["network_passes"]:
            v, slopes = self._learn_trend(theta, v, slopes, seed)
            process = NetworkErrors(**own)
            # Each simulation here costs time wherever it is asked how large errors are.
            rows = subset(len(theta), own["max_observations"], derive(seed, "errors of networks"))
            theta, v, slopes = theta[rows], v[rows], slopes[rows]
        given = (each.numpy() for each in (theta, v, slopes))
        process.fit(*given, parameters=self.parameters, outputs=self.outputs, seed=seed)
        self.processes, self.info = (process,), process.info

    def _learn_trend(self, theta, v, slopes, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Set `trend`; return what is left (N, D) of v, and (N, D, P) of its slopes."""
        passes, folds, width, layers, members = (
            self.settings[f"network_{key}"]
            for key in ("passes", "folds", "width", "layers", "members")
        )
        rate = self.coordinates.slope(theta)[:, None]
        given = self.coordinates.scaled(theta), v, slopes * rate

        def make(members: int = 1) -> SegmentNetworks:
            return SegmentNetworks(self.coordinates, self.outputs, width, layers, members)

        self.trend = make(members).fit(*given, passes, derive(seed, "networks"))
        v, slopes = out_of_fold(make, *given, passes, folds, derive(seed, "folds of networks"))
        return v, slopes / rate

    def _trend(self, theta: torch.Tensor) -> torch.Tensor | float:
        """(..., D) at theta (..., P), on the scale."""
        if self.trend is None:
            return 0.0
        return self.trend(self.coordinates.scaled(theta))[..., self._kept]

    def _trend_slopes(self, trend: SegmentNetworks, theta: torch.Tensor):
        """The same, and its derivatives (..., D, P) about theta."""
        v, slopes = trend.with_slopes(self.coordinates.scaled(theta))
        rate = self.coordinates.slope(theta)[..., None, :]
        return v[..., self._kept], slopes[..., self._kept, :] / rate

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

    def condition(self, theta: np.ndarray, y: np.ndarray, sensitivities: np.ndarray) -> "JointGP":
        """This emulator given further simulations of the study's mesh as well, which its training
        set did not have: seconds instead of another training; hyperparameters and calibration stay.

        theta (m, P), y (m, D), sensitivities d(y)/d(theta) (m, D, P), natural units, of this
        emulator's outputs. See `GradientGP.condition`.

        Raises InputError for shapes that do not fit, numbers that are not finite, and what no
        volume or strain can be.
        """
        theta, y, slopes = self._checked(theta, y, sensitivities)
        v, slopes = self.on_scale(theta, y, slopes)
        if self.trend is not None:
            known, its_slopes = self._trend_slopes(self.trend, theta)
            v, slopes = v - known, slopes - its_slopes
        first, *others = self.processes
        given = copy.copy(self)
        given.processes = (first.condition(theta, v, slopes), *others)
        given.inputs = torch.cat([self.inputs, self.standardise(theta)])
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

    @property
    def with_known_errors(self) -> "JointGP":
        """Without its errors on the study's mesh: what a finer mesh changes keeps its own."""
        known = copy.copy(self)
        known.errors_known = True
        return known

    def rescaled(self, factor: float) -> "JointGP":
        """With errors on the study's mesh that are stated `factor` times as large."""
        changed, first = copy.copy(self), copy.copy(self.processes[0])
        calibration = first.calibration
        first.calibration = replace(calibration, factor=factor**2 * calibration.factor)
        changed.processes = (first, *self.processes[1:])
        return changed

    @torch.no_grad()
    def errors_of(self, theta: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        """Simulated outputs y (n, D) at theta (n, P) less the emulated ones, in stated sds,
        (n, D)."""
        found = self.predict(torch.as_tensor(theta))
        return (torch.as_tensor(y) - found.mean) / found.sd

    def _predict(self, theta):
        known = self.processes[:1] if self.errors_known else ()
        others = self.processes[len(known) :]
        found = [process.predict(theta) for process in others]
        v = self._trend(theta) + sum(process.predict_mean(theta) for process in known)
        v = v + sum(each.mean for each in found)
        by_v, _ = self.scale.slopes(v, theta)
        # A posterior over many inputs knows no directions along which errors are larger.
        covariance = v.new_zeros(*v.shape, v.shape[-1])
        for process, each in zip(others, found, strict=True):
            covariance = covariance + process.jacobian_factor * each.covariance
        covariance = by_v[..., :, None] * covariance * by_v[..., None, :]
        return Prediction(self.scale.outputs(v, theta), covariance)

    def predict_mean(self, theta):
        v = self._trend(theta) + sum(process.predict_mean(theta) for process in self.processes)
        return self.scale.outputs(v, theta)

    def linearise(self, theta):
        found = [process.linearise(theta) for process in self.processes]
        if self.trend is not None:
            found.append(self._trend_slopes(self.trend, theta))
        v, slopes = (sum(parts) for parts in zip(*found, strict=True))
        return self.scale.outputs(v, theta), self.scale.from_scale(slopes, v, theta)

    def jacobian(self, theta):
        return self.linearise(theta)[1], None

    def _select(self, index):
        self._kept = self._kept[index]
        names = [self.processes[0].outputs[i] for i in index]
        self.processes = tuple(process.select(names) for process in self.processes)
        self.scale = self.scale.select(index)

    def _state(self):
        return {
            "processes": [process.content() for process in self.processes],
            "trend": None if self.trend is None else self.trend.content(),
            "kept": self._kept,
        }

    def _restore(self, state):
        self.processes = tuple(
            GradientGP.from_content(content, "this emulator") for content in state["processes"]
        )
        if state["trend"] is not None:
            self.trend = SegmentNetworks.from_content(state["trend"], self.coordinates)
        self._kept = state["kept"]
        self.scale = OutputScale.of(self.outputs, self.coordinates)
