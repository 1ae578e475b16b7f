"""Exact Gaussian process that learns from sensitivities as well as from outputs."""

import torch

from regional_lv import gradient_gp, kernel
from regional_lv.emulators.base import Architecture, TrainingSet
from regional_lv.emulators.exact_gp import ExactGP
from regional_lv.emulators.shared_kernel import subset
from regional_lv.seeds import derive


class GradientGP(ExactGP):
    """The exact GP with a rational quadratic kernel on values and derivatives.

    Derivatives are further observations (`regional_lv.kernel`), ten per simulation: values of
    all simulations come first, then derivatives of as many of them (at random) as fit into
    `max_observations`. Sensitivities become derivatives about the standardised inputs by the chain
    rule. Settings: max_observations; hyperparameter_rows, the simulations that the hyperparameters
    are fitted to; iterations; calibration as for the exact GP.
    """

    name = "gradient_gp"
    architecture = Architecture("Gradient GP", "GP", "global", "multi-output")
    learns_from_sensitivities = True

    def _learn_hyperparameters(self, training: TrainingSet, seed: int) -> dict:
        rows = subset(len(training.x), self.settings["hyperparameter_rows"], seed)
        y = training.y[rows]
        h = gradient_gp.fit(
            training.x[rows].numpy(),
            (y - y.mean(0)).numpy(),
            training.slopes[rows].mT.numpy(),
            iterations=self.settings["iterations"],
        )
        self.length_scales, self.alpha = torch.as_tensor(h.lengthscales), h.alpha
        self.nugget, self.gradient_nugget = h.value_nugget, h.gradient_nugget
        n, p = training.x.shape
        room = max(0, (self.settings["max_observations"] - n) // p)
        self.sloped = subset(n, min(n, room), derive(seed, "sloped"))
        return {"hyperparameter_rows": len(rows), "rows_with_derivatives": len(self.sloped)}

    def _targets(self, training):
        slopes = training.slopes[self.sloped]
        return torch.cat([training.y, slopes.permute(2, 0, 1).reshape(-1, slopes.shape[1])])

    def _training_covariance(self):
        x, sloped = self.inputs, self.inputs[self.sloped]
        n = len(x)
        upper = self._covariances(x, values_only=True)
        lower = self._covariances(sloped)[len(sloped) :]
        noise = (self.gradient_nugget - self.nugget * self.length_scales**2).clamp(min=0.0)
        matrix = torch.cat([upper, lower])
        matrix.diagonal()[n:].add_((noise / self.length_scales**2).repeat_interleave(len(sloped)))
        constant = torch.zeros(len(matrix), 1, dtype=x.dtype)
        constant[:n] = 1.0
        return matrix, constant

    def _covariances(self, x, values_only: bool = False) -> torch.Tensor:
        """Covariance ((1 + 10) M, n) of the value and the derivatives at `x` (M, 10), or (M, n) of
        the value alone, with the observations."""
        common = (self.length_scales, self.alpha)
        sloped = self.inputs[self.sloped]
        if not values_only:
            return torch.cat(
                [
                    kernel.covariance_with_values(x, self.inputs, *common),
                    kernel.covariance_with_gradients(x, sloped, *common),
                ],
                dim=1,
            )
        gap = (x[:, None, :] - self.inputs) / self.length_scales
        value = kernel.rational_quadratic(gap.square().sum(-1), self.alpha)[0]
        # Covariance of a value with a derivative: that of the derivative with the value, turned.
        slopes = kernel.covariance_with_values(sloped, x, *common)[len(sloped) :]
        return torch.cat([value, slopes.T], dim=1)

    def _rows(self, x):
        return self._covariances(x, values_only=True), (x,)

    def _slopes(self, x) -> torch.Tensor:
        """d(k)/dx, (10, M, n)."""
        return self._covariances(x)[len(x) :].reshape(x.shape[1], len(x), -1)

    def _pull_back(self, by_k, x):
        return (self._slopes(x) * by_k).sum(-1).T

    def _mean_slopes(self, x):
        return (self._slopes(x) @ self.weights).permute(1, 2, 0)

    def _leave_one_out(self, precision, targets):
        """Without a simulation's derivatives, too: blocks of the projected precision.

        The errors of the block are Q_ii^-1 [Q y]_i, their covariance Q_ii^-1.
        """
        n, p = self.inputs.shape
        errors, variances = super()._leave_one_out(precision, targets)
        errors, variances = errors[:n], variances[:n]
        count = len(self.sloped)
        own = torch.cat([self.sloped[None], n + torch.arange(p * count).reshape(p, count)]).T
        blocks = torch.linalg.inv(precision[own[:, :, None], own[:, None, :]])
        errors[self.sloped] = (blocks @ (precision @ targets)[own])[:, 0]
        variances[self.sloped] = blocks[:, 0, 0]
        return errors, variances

    def _state(self):
        return super()._state() | {k: getattr(self, k) for k in ("gradient_nugget", "sloped")}

    def _restore(self, state):
        for key in ("gradient_nugget", "sloped"):
            setattr(self, key, state.pop(key))
        super()._restore(state)
