"""Exact Gaussian process that learns from sensitivities as well as from outputs."""

import math

import gpytorch
import torch
from gpytorch.constraints import GreaterThan

from regional_lv.derivative_kernel import covariance_with_gradients, covariance_with_values
from regional_lv.emulators.base import TrainingSet
from regional_lv.emulators.exact_gp import ExactGP
from regional_lv.emulators.kernels import BlockRQKernel, BlockRQKernelGrad
from regional_lv.emulators.optimise import fit
from regional_lv.emulators.shared_kernel import subset
from regional_lv.parameters import Parameterisation
from regional_lv.seeds import derive

LEAST_NUGGET = 1e-8

BOUNDS = {
    "raw_lengthscale": (math.log(0.05), math.log(100.0)),
    "raw_alpha": (math.log(0.1), math.log(100.0)),
    "raw_noise": (math.log(1e-12), 0.0),
    "raw_gradient_noise": (math.log(1e-10), 0.0),
}
"""Of the logarithms of the model's parameters."""


class GradientModel(gpytorch.models.ExactGP):
    """Values and derivatives of every output, each output with its own variance (profiled out).

    Noise is relative to the process's variance: that of the values is the likelihood's, that of the
    derivatives `gradient_noise`, for inputs scaled by their length scale.

    x: (n, P), y: (n + P n, D), values of mean zero and derivatives of all of them, for `loss`.
    """

    def __init__(self, parameters: Parameterisation, x=None, y=None):
        noise = GreaterThan(LEAST_NUGGET, transform=torch.exp, inv_transform=torch.log)
        super().__init__(x, y, gpytorch.likelihoods.GaussianLikelihood(noise_constraint=noise))
        self.mean_module = gpytorch.means.ZeroMean()
        self.covar_module = BlockRQKernelGrad(parameters.blocks)
        self.register_parameter("raw_gradient_noise", torch.nn.Parameter(torch.zeros(1)))
        self.double()

    def forward(self, x):
        return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))

    @property
    def gradient_noise(self) -> torch.Tensor:
        return LEAST_NUGGET + self.raw_gradient_noise.exp()

    @property
    def length_scales(self) -> torch.Tensor:
        """(P,)"""
        return self.of_values.lengthscale.detach()[0]

    @property
    def of_values(self) -> BlockRQKernel:
        """Kernel of the values alone."""
        return self.covar_module.of_values

    @property
    def nugget(self) -> float:
        return self.likelihood.noise.item()

    def learn(self, iterations: int) -> None:
        """Hyperparameters of largest likelihood, by L-BFGS."""
        (x,) = self.train_inputs
        self.of_values.initialize(lengthscale=(2.0 * x.std(0) + 1e-3)[None], alpha=2.0)
        self.likelihood.noise = LEAST_NUGGET + 1e-6
        self.raw_gradient_noise.data.fill_(math.log(1e-5))
        fit(self.named_parameters(), self.loss, BOUNDS, iterations)

    def loss(self) -> torch.Tensor:
        """Minus the log likelihood, per observation and output, up to a constant."""
        (x,), y = self.train_inputs, self.train_targets
        n, scales = len(x), self.of_values.lengthscale[0]
        noise = torch.cat(
            [
                self.likelihood.noise.expand(n),
                (self.gradient_noise / scales**2).repeat_interleave(n),
            ]
        )
        factor = torch.linalg.cholesky(self.covar_module(x).to_dense() + torch.diag(noise))
        white = torch.linalg.solve_triangular(factor, y, upper=False)
        variance = white.square().mean(0)
        return factor.diagonal().log().sum() / len(y) + 0.5 * variance.log().mean()


class GradientGP(ExactGP):
    """The exact GP with the kernel `zonal_rq` on values and derivatives.

    Derivatives are further observations (`regional_lv.derivative_kernel`), P per simulation: values
    of all simulations come first, then derivatives of as many of them (at random) as fit into
    `max_observations`. Sensitivities become derivatives about the standardised inputs by the chain
    rule. Settings: max_observations; hyperparameter_rows, the simulations that the hyperparameters
    are fitted to (the cost grows with the cube of their number); iterations; calibration as for the
    exact GP.
    """

    name = "gradient_gp"
    learns_from_sensitivities = True

    def _learn_hyperparameters(self, training: TrainingSet, seed: int) -> dict:
        rows = subset(len(training.x), self.settings["hyperparameter_rows"], seed)
        y = training.y[rows]
        assert training.slopes is not None  # it learns from sensitivities
        observed = _observations(y - y.mean(0), training.slopes[rows])
        self.model = GradientModel(self.parameters, training.x[rows], observed)
        self.model.learn(self.settings["iterations"])
        self.nugget = self.model.nugget
        n, p = training.x.shape
        room = max(0, (self.settings["max_observations"] - n) // p)
        self.sloped = subset(n, min(n, room), derive(seed, "sloped"))
        return {"hyperparameter_rows": len(rows), "rows_with_derivatives": len(self.sloped)}

    def _make_model(self) -> GradientModel:
        return GradientModel(self.parameters)

    def _targets(self, training):
        return _observations(training.y, training.slopes[self.sloped])

    def _training_covariance(self):
        x, sloped, scales = self.inputs, self.inputs[self.sloped], self.model.length_scales
        n, count = len(x), len(sloped)
        upper = self._correlations_by_parts(x)
        lower = [
            covariance_with_values(sloped, x, *self._of_kernel())[count:],
            covariance_with_gradients(sloped, sloped, *self._of_kernel())[count:],
        ]
        noise = (self.model.gradient_noise / scales**2 - self.nugget).clamp(min=0.0)
        matrix = torch.cat([upper, torch.cat(lower, dim=1)])
        matrix.diagonal()[n:].add_(noise.repeat_interleave(count))
        constant = torch.zeros(len(matrix), 1, dtype=x.dtype)
        constant[:n] = 1.0
        return matrix, constant

    def _of_kernel(self) -> tuple:
        """What functions of `derivative_kernel` ask of the kernel."""
        kernel = self.model.of_values
        return self.model.length_scales, kernel.alpha[0], kernel.blocks

    def _correlations(self, x):
        kernel, v = self.model.of_values, self.inputs[self.sloped]
        columns = [super()._correlations(x)]
        _, slopes = kernel.with_slopes(x, v)
        for part, slope in zip(kernel.blocks, slopes, strict=True):
            for p in range(part.start, part.stop):
                gap = (x[:, p, None] - v[:, p]) / kernel.lengthscale[0, p] ** 2
                columns.append(slope * gap)
        return torch.cat(columns, dim=1)

    def _weighted(self, x):
        # As `_correlations` times the weights, one column after the other: putting them side by
        # side takes longer than the products.
        kernel, v = self.model.of_values, self.inputs[self.sloped]
        n = len(self.inputs)
        k, slopes = kernel.with_slopes(x, v)
        by_input = self.weights[n:].reshape(x.shape[1], len(v), -1)
        by_input = by_input / self.model.length_scales[:, None, None] ** 2
        values = k if len(v) == n else super()._correlations(x)
        total = values @ self.weights[:n]
        for part, slope in zip(kernel.blocks, slopes, strict=True):
            for p in range(part.start, part.stop):
                total = total + (slope * (x[:, p, None] - v[:, p])) @ by_input[p]
        return total

    def _weighted_slopes(self, x):
        kernel, n, p = self.model.of_values, len(self.inputs), x.shape[1]
        weighted, by_x = kernel.weighted_slopes(x, self.inputs, self.weights[:n])
        # Covariance of values and derivatives at x with the observed derivatives.
        joint = covariance_with_gradients(x, self.inputs[self.sloped], *self._of_kernel())
        rest = (joint @ self.weights[n:]).reshape(1 + p, len(x), -1)
        return weighted + rest[0], by_x + rest[1:].permute(1, 2, 0)

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
        return super()._state() | {"sloped": self.sloped}

    def _restore(self, state):
        self.sloped = state["sloped"]
        super()._restore(state)


def _observations(values: torch.Tensor, slopes: torch.Tensor) -> torch.Tensor:
    """Values (N, D) and derivatives (n, D, P) in the covariance's order: (N + P n, D)."""
    return torch.cat([values, slopes.permute(2, 0, 1).reshape(-1, slopes.shape[1])])
