"""The gradient-enhanced process over all inputs, on the scale on which effects add up."""

import numpy as np
import torch

from regional_lv.emulators.base import Emulator, Prediction, check_training_set
from regional_lv.emulators.gradient_gp import GradientGP
from regional_lv.emulators.output_scale import OutputScale
from regional_lv.errors import InputError


class JointGP(Emulator):
    """A `GradientGP` of log volume and log stretch (`OutputScale`), with the settings of that.

    Its errors are those of the process times the slope of the scale, correlated between outputs.
    """

    name = "joint_gp"
    learns_from_sensitivities = True

    def fit(self, theta, y, sensitivities=None, *, parameters, outputs, seed=0):
        """As in the base class; also raises InputError for what no volume or strain can be."""
        known = np.asarray(theta), np.asarray(y)
        check_training_set(*known, parameters, outputs, sensitivities is not None)
        self.parameters, self.outputs = parameters, tuple(outputs)
        self.scale = OutputScale.of(outputs, self.coordinates)
        here, found = torch.as_tensor(theta), torch.as_tensor(y)
        v = self.scale.of_outputs(found, here)
        bad = ~torch.isfinite(v).all(0) & torch.isfinite(found).all(0)
        if bad.any():
            which = self.outputs[int(bad.nonzero()[0])]
            raise InputError(
                f"training set: {which} has values that no volume, or no strain of its exponent, "
                "can have; check the outputs' units"
            )
        slopes = sensitivities
        if slopes is not None:
            slopes = self.scale.to_scale(torch.as_tensor(slopes), v, here)
        self.process = GradientGP(**self.settings).fit(
            theta, v, slopes, parameters=parameters, outputs=outputs, seed=seed
        )
        self.output_mean, self.output_sd = found.mean(0), found.std(0)
        for key in ("inputs", "reach", "input_mean", "input_sd", "info"):
            setattr(self, key, getattr(self.process, key))
        return self

    @property
    def jacobian_factor(self) -> float:
        return self.process.jacobian_factor

    def _predict(self, theta):
        on_scale = self.process.predict(theta)
        by_v, _ = self.scale.slopes(on_scale.mean, theta)
        covariance = by_v[..., :, None] * on_scale.covariance * by_v[..., None, :]
        return Prediction(self.scale.outputs(on_scale.mean, theta), covariance)

    def predict_mean(self, theta):
        return self.scale.outputs(self.process.predict_mean(theta), theta)

    def linearise(self, theta):
        v, slopes = self.process.linearise(theta)
        return self.scale.outputs(v, theta), self.scale.from_scale(slopes, v, theta)

    def jacobian(self, theta):
        return self.linearise(theta)[1], None

    def _fit(self, training, seed):
        raise NotImplementedError  # `fit` is its own

    def _select(self, index):
        self.process = self.process.select([self.process.outputs[i] for i in index])
        self.scale = self.scale.select(index)

    def _state(self):
        return {"process": self.process.content()}

    def _restore(self, state):
        self.process = GradientGP.from_content(state["process"], "this emulator")
        self.scale = OutputScale.of(self.outputs, self.coordinates)
