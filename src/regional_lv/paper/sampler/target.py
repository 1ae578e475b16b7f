"""The posterior of one case as a potential in a space without bounds."""

import numpy as np
import torch

from regional_lv.emulators.base import Prediction
from regional_lv.paper.sampler.likelihood import Likelihood
from regional_lv.paper.sampler.transform import POWER, ThetaTransform

WEAKEST_CURVATURE = 0.3
"""Where the data say nothing, a parameter has about this curvature from its soft bounds; flatter
directions are taken to have it."""


class Target:
    """-log posterior density of positions (..., P + G): theta by `transform`, then log sigma."""

    def __init__(self, likelihood: Likelihood, transform: ThetaTransform):
        self.likelihood, self.transform = likelihood, transform
        self.inputs = likelihood.inputs

    @classmethod
    def near(cls, likelihood: Likelihood, theta: torch.Tensor, log_sigma: torch.Tensor) -> "Target":
        """With soft bounds as wide as the posterior around `theta` (P,), `log_sigma` (G,) is."""
        emulator = likelihood.emulator
        information = likelihood.information(theta, log_sigma)
        # A parameter of which the data say nothing has the variance of its range; a scale of the
        # noise has about as wide a prior.
        span = np.log((emulator.upper / emulator.lower).numpy())
        spans = np.concatenate([span, np.full(len(log_sigma), span.max())])
        covariance = torch.linalg.inv(information + torch.diag(torch.as_tensor(12 / spans**2)))
        width = covariance.diagonal()[: len(theta)].sqrt() * theta**POWER
        return cls(likelihood, ThetaTransform(emulator.lower, emulator.upper, width))

    def unconstrain(self, theta: torch.Tensor, log_sigma: torch.Tensor) -> torch.Tensor:
        """Position (..., P + G)."""
        return torch.cat([self.transform.unconstrain(theta), log_sigma], dim=-1)

    def constrain(self, position: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Theta (..., P) and log sigma (..., G)."""
        return self.transform.constrain(position[..., : self.inputs]), position[..., self.inputs :]

    def potential(
        self, position: torch.Tensor, variance: torch.Tensor | None = None
    ) -> torch.Tensor:
        """-log posterior density (...) of positions (..., P + G), with the Jacobian of the map.

        variance: (...), in place of the emulator's own if its covariance is separable.
        """
        if variance is None:
            return self.evaluate(position)[0]
        return self._value(
            position, lambda theta: self.likelihood.emulator.with_variance(theta, variance)
        )[0]

    def evaluate(self, position: torch.Tensor) -> tuple[torch.Tensor, Prediction]:
        """The potential (...) and the emulator's prediction at positions (..., P + G)."""
        return self._value(position, self.likelihood.emulator.predict)

    def _value(self, position, predict) -> tuple[torch.Tensor, Prediction]:
        log_sigma = position[..., self.inputs :]
        theta, jacobian = self.transform.constrain_with_log_det(position[..., : self.inputs])
        prediction = predict(theta)
        if log_sigma.shape[-1]:
            jacobian = jacobian + log_sigma.sum(-1) + self.likelihood.noise.log_prior(log_sigma)
        return -(self.likelihood.of_prediction(prediction, log_sigma) + jacobian), prediction

    def gaussian(
        self, theta: torch.Tensor, log_sigma: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Laplace approximation at the maximum of the density of theta: position (P + G,), and M
        with covariance M M', from the expected information and the curvature of the soft bounds."""
        position, p = self.unconstrain(theta, log_sigma), self.inputs
        bounds = -torch.autograd.functional.hessian(
            lambda v: self.transform.constrain_with_log_det(v[:p])[1], position
        )
        slope = torch.autograd.functional.jacobian(
            lambda v: torch.cat([torch.log(self.transform.constrain(v[:p])), v[p:]]), position
        )
        precision = slope.T @ self.likelihood.information(theta, log_sigma) @ slope
        precision = precision + torch.diag(bounds.diagonal().clamp(min=0))
        values, vectors = torch.linalg.eigh(0.5 * (precision + precision.T))
        return position, vectors / values.clamp(min=WEAKEST_CURVATURE).sqrt()
