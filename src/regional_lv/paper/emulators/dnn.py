"""DNN: a feed-forward network with one scale for all its errors (the paper's error model)."""

import copy

import torch

from regional_lv.emulators.base import SeparablePrediction
from regional_lv.emulators.reduced import ReducedEmulator
from regional_lv.paper.emulators import networks


class DNN(ReducedEmulator):
    """Network from the inputs to the reduced outputs, on their own scale (not of unit variance).

    Its error model is the paper's: independent between the reduced outputs, with one standard
    deviation for all of them and everywhere; here that of the errors on held-out simulations
    (`info["error_sd"]`). Posteriors of simulated cases sample its scale together with theta
    (`error_prior_scale`), as the paper does.
    Settings: hidden (widths), epochs, learning_rate, error_prior_scale.
    """

    name = "dnn"
    _KEYS = ("error_sd",)

    def _fit_scores(self, x, z, seed):
        s = self.settings
        self.model, errors = networks.train(
            x, z * self.score_sd, s["hidden"], s["epochs"], s["learning_rate"], seed
        )
        self.error_sd = float(errors.square().mean().sqrt())
        self.info["error_sd"] = self.error_sd

    def _build(self, weights):
        sizes = [self.inputs.shape[1], *self.settings["hidden"], len(self.score_sd)]
        return networks.build(sizes).double()

    def without_error(self) -> "DNN":
        """This network with no error but what the reduction leaves out, which is one and the same
        covariance everywhere."""
        bare = copy.copy(self)
        bare.error_sd = 0.0
        return bare

    def _predict(self, theta):
        if self.error_sd:
            return super()._predict(theta)
        mean = self.predict_mean(theta)
        left_out = self.output_sd[:, None] * self.left_out * self.output_sd
        return SeparablePrediction(mean, torch.ones_like(mean[..., 0]), left_out)

    def jacobian(self, theta):
        by_theta, _ = super().jacobian(theta)
        return by_theta, None if self.error_sd else torch.zeros_like(theta)

    def _mean(self, x):
        return self.model(x) / self.score_sd

    def _covariance(self, x):
        # The same everywhere, but differentiable about x like that of the others.
        return (self.error_sd / self.score_sd).square() + 0.0 * x[:, :1]
