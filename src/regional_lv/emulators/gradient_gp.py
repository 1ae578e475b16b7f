"""Exact Gaussian process that learns from sensitivities as well as from outputs."""

import copy
import math
from dataclasses import asdict
from functools import cached_property

import gpytorch
import numpy as np
import torch
from gpytorch.constraints import GreaterThan

from regional_lv.emulators.base import TrainingSet
from regional_lv.emulators.exact_gp import ExactGP, Factorised, stated_variance
from regional_lv.emulators.kernels import BlockRQKernel, Blocks
from regional_lv.emulators.observed_derivatives import (
    ObservedDerivatives,
    Weighted,
    covariance,
    crossed,
)
from regional_lv.emulators.optimise import fit
from regional_lv.emulators.shared_kernel import condition, projected_precision, subset
from regional_lv.seeds import derive

LEAST_NUGGET, LEAST_GRADIENT_NOISE = 1e-8, 1e-6
"""Relative to the variance of the values, and of derivatives with respect to inputs in length
scales."""

BOUNDS = {
    "raw_lengthscale": (math.log(0.05), math.log(100.0)),
    "raw_alpha": (math.log(0.1), math.log(100.0)),
    "raw_noise": (math.log(1e-12), 0.0),
    "raw_gradient_noise": (math.log(1e-10), 0.0),
}
"""Of the logarithms of the model's parameters."""

HYPERPARAMETER_OBSERVATIONS = 2000
"""Values and derivatives that the hyperparameters are fitted to, at most."""


class GradientModel(gpytorch.models.ExactGP):
    """Values and derivatives of every output, each output with its own variance (profiled out).

    Noise is relative to the process's variance: that of the values is the likelihood's, that of the
    derivatives `gradient_noise`, for inputs scaled by their length scale.

    x: (n, P), seen: M derivatives, y: (n + M, D), values of mean zero and these derivatives, for
    `loss`.
    """

    def __init__(self, blocks: Blocks, x=None, seen: ObservedDerivatives | None = None, y=None):
        noise = GreaterThan(LEAST_NUGGET, transform=torch.exp, inv_transform=torch.log)
        super().__init__(x, y, gpytorch.likelihoods.GaussianLikelihood(noise_constraint=noise))
        self.mean_module = gpytorch.means.ZeroMean()
        self.covar_module = BlockRQKernel(blocks)
        self.register_parameter("raw_gradient_noise", torch.nn.Parameter(torch.zeros(1)))
        self.seen = seen
        self.double()

    def forward(self, x):
        return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))

    @property
    def gradient_noise(self) -> torch.Tensor:
        return LEAST_GRADIENT_NOISE + self.raw_gradient_noise.exp()

    @property
    def length_scales(self) -> torch.Tensor:
        """(P,)"""
        return self.of_values.lengthscale.detach()[0]

    @property
    def of_values(self) -> BlockRQKernel:
        """Kernel of the values alone."""
        return self.covar_module

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
        (x,), y, seen = self.train_inputs, self.train_targets, self.seen
        assert seen is not None  # only a model of a training set has a likelihood
        scales = self.of_values.lengthscale[0][seen.along]
        noise = torch.cat(
            [self.likelihood.noise.expand(len(x)), self.gradient_noise.expand(len(scales))]
        )
        matrix = covariance(self.of_values, x, seen) + torch.diag(noise)
        factor = torch.linalg.cholesky(matrix)
        by_length = torch.cat([y[: len(x)], y[len(x) :] * scales[:, None]])
        white = torch.linalg.solve_triangular(factor, by_length, upper=False)
        determinant = factor.diagonal().log().sum() - scales.log().sum()
        return determinant / len(y) + 0.5 * white.square().mean(0).log().mean()


class GradientGP(ExactGP):
    """The exact GP with the kernel `zonal_rq` on values and derivatives.

    Derivatives are further observations (`observed_derivatives`): values of all simulations come
    first, then, input by input, derivatives with respect to all inputs, or of each simulation about
    as many of them (at random) as fit into `max_observations`. Sensitivities become derivatives
    with respect to the standardised inputs by the chain rule. Settings: max_observations;
    hyperparameter_rows, the simulations that the hyperparameters are fitted to (the cost grows with
    the cube of their number); iterations; calibration as for the exact GP; variance_observations,
    those that the variance is computed from, all (None) or a part that is large enough to say where
    the errors are large: how large is calibrated by the errors of leaving out simulations.

    `inputs` (n, P) are those of all simulations, `seen` the derivatives that the mean has `weights`
    (n + M, D) on, `variance_seen` those that the variance is computed from.
    """

    name = "gradient_gp"
    learns_from_sensitivities = True
    fixed: tuple[torch.Tensor, torch.Tensor] | None = None
    """Values (P,) and mask (P,) of what is the same wherever it is asked (`at_fixed`)."""

    def _learn_hyperparameters(self, training: TrainingSet, seed: int) -> dict:
        rows = subset(len(training.x), self.settings["hyperparameter_rows"], seed)
        most = HYPERPARAMETER_OBSERVATIONS
        seen = self._choose(len(rows), most, derive(seed, "hyperparameter derivatives"))
        y = training.y[rows]
        assert training.slopes is not None  # it learns from sensitivities
        observed = _observations(y - y.mean(0), training.slopes[rows], seen)
        self.model = GradientModel(self.parameters.blocks, training.x[rows], seen, observed)
        self.model.learn(self.settings["iterations"])
        self.nugget = self.model.nugget
        n, most = len(training.x), self.settings["max_observations"]
        # What is nearly linear needs few of them.
        weight = self.model.length_scales**-2
        self.seen = self.variance_seen = self._choose(n, most, derive(seed, "derivatives"), weight)
        few = self.settings["variance_observations"]
        if few is not None and few < n + len(self.seen):
            own = derive(0, "derivatives for the variance")
            self.variance_seen = self._choose(n, few, own, weight)
        return {
            "hyperparameter_rows": len(rows),
            "derivatives": len(self.seen),
        }

    def _choose(self, n: int, most: int, seed: int, weight=None) -> ObservedDerivatives:
        """Derivatives of n simulations, `most` observations in all."""
        return ObservedDerivatives.some(n, len(self.parameters), most - n, seed, weight)

    def _make_model(self) -> GradientModel:
        return GradientModel(self.parameters.blocks)

    def _targets(self, training):
        return self._observed(training.y, training.slopes, self.seen)

    def _observed(self, values, slopes, seen: ObservedDerivatives) -> torch.Tensor:
        """`_observations`, derivatives with respect to inputs in units of their length scales."""
        found = _observations(values, slopes, seen)
        found[len(values) :] *= self.model.length_scales[seen.along, None]
        return found

    def _training_covariance(self):
        return self._covariance_of(self.seen)

    def _covariance_of(self, seen: ObservedDerivatives) -> tuple[torch.Tensor, torch.Tensor]:
        n = len(self.inputs)
        matrix = covariance(self.model.of_values, self.inputs, seen)
        noise = (self.model.gradient_noise - self.nugget).clamp(min=0.0).detach()
        matrix.diagonal()[n:].add_(noise)
        constant = torch.zeros(len(matrix), 1, dtype=matrix.dtype)
        constant[:n] = 1.0
        return matrix, constant

    def _correlations(self, x):
        return crossed(self.model.of_values, x, self.inputs, self.seen)

    def _weighted(self, x):
        return self._by_simulation.mean(x)

    def _weighted_slopes(self, x):
        return self._by_simulation.with_slopes(x)

    @cached_property
    def _by_simulation(self) -> Weighted:
        fixed = None
        if self.fixed is not None:
            values, mask = self.fixed
            fixed = self.standardise(values), mask
        # Simulations without weight, such as those that networks learnt, cost nothing; one stays.
        n, at = len(self.inputs), self.seen.at
        used = self.weights[:n].any(1)
        used[:1] = True
        used[at[self.weights[n:].any(1)]] = True
        kept = used[at]
        seen = ObservedDerivatives((used.cumsum(0) - 1)[at[kept]], self.seen.along[kept])
        weights = torch.cat([self.weights[:n][used], self.weights[n:][kept]])
        return Weighted(self.model.of_values, self.inputs[used], seen, weights, fixed)

    def at_fixed(self, theta: torch.Tensor, mask: torch.Tensor) -> "GradientGP":
        """This emulator for points at which the parameters of a mask (P,) are those of theta (P,):
        its mean and derivatives cost less, the latter 0 with respect to these."""
        given = copy.copy(self)
        given._clear_cached("_by_simulation")
        given.fixed = theta, mask
        return given

    @cached_property
    def _for_variance(self) -> Factorised:
        """The observations that the variance is computed from."""
        if self.variance_seen is self.seen:
            return self._known
        known, _ = Factorised.of(*self._covariance_of(self.variance_seen), self.nugget, self.name)
        return known

    def _predict(self, theta):
        x = self.standardise(theta.reshape(-1, theta.shape[-1]))
        k = crossed(self.model.of_values, x, self.inputs, self.variance_seen)
        variance = stated_variance(k, self._for_variance, self.nugget).reshape(theta.shape[:-1])
        scale = self.calibration.scale(self._stiffness(theta))
        return self._separable(self.predict_mean(theta), scale * variance)

    def condition(
        self, theta: np.ndarray, y: np.ndarray, sensitivities: np.ndarray
    ) -> "GradientGP":
        """This emulator given further simulations as well; hyperparameters and calibration stay.

        theta (m, P), y (m, D), sensitivities d(y)/d(theta) (m, D, P), natural units.

        The error of the mean is a process with this kernel that is zero at what the variance is
        computed from, and at the new simulations what it is found to be there: the mean of that is
        added, and its variance is the new one. With `variance_observations` of None this is the
        process given all observations, old and new; otherwise far fewer of them are factorised.

        Raises InputError for shapes that do not fit and numbers that are not finite.
        """
        theta, y, slopes = self._checked(theta, y, sensitivities)
        mean, by_theta = self.linearise(theta)
        error = (y - mean) / self.output_sd
        slopes = self._standardise_slopes(slopes - by_theta, theta)
        n, m = len(self.inputs), len(theta)
        given = copy.copy(self)
        given._clear_cached()
        given.inputs = torch.cat([self.inputs, self.standardise(theta)])
        new = ObservedDerivatives.of_all(torch.arange(m), torch.arange(theta.shape[1]))
        given.variance_seen = self.variance_seen.joined(ObservedDerivatives(n + new.at, new.along))
        few = given._for_variance
        found = error.new_zeros(len(few.cholesky), error.shape[1])
        observed = self._observed(error, slopes, new)
        found[n : n + m], found[len(found) - len(new) :] = observed[:m], observed[m:]
        added, weights = condition(few.cholesky, found, few.constant)
        given.mean = self.mean + added
        given.seen = self.seen.joined(given.variance_seen)
        weights[:n] += self.weights[:n]
        given.weights = torch.cat([weights[: n + m], self.weights[n:], weights[n + m :]])
        return given

    def _leave_one_out(self, precision, targets):
        """Without a simulation's derivatives, too; variances as they are stated."""
        errors, variances = self._left_out(precision, targets, self.seen)
        if self.variance_seen is not self.seen:
            few = projected_precision(self._for_variance.cholesky, self._for_variance.constant)
            _, variances = self._left_out(few, torch.zeros_like(few[:, :1]), self.variance_seen)
        return errors, variances

    def _left_out(self, precision, targets, seen: ObservedDerivatives):
        """Blocks of the projected precision: the errors of a block are Q_ii^-1 [Q y]_i, their
        covariance Q_ii^-1."""
        n, at = len(self.inputs), seen.at
        weighted = precision @ targets
        errors, variances = targets.new_empty(n, targets.shape[1]), targets.new_empty(n)
        counts = torch.bincount(at, minlength=n)
        for count in counts.unique():
            which = (counts == count).nonzero()[:, 0]
            places = n + torch.argsort(at, stable=True)[counts[at.sort().values] == count]
            own = torch.cat([which[:, None], places.reshape(len(which), -1)], 1)
            blocks = torch.linalg.inv(precision[own[:, :, None], own[:, None, :]])
            errors[which] = (blocks @ weighted[own])[:, 0]
            variances[which] = blocks[:, 0, 0]
        return errors, variances

    def _select(self, index):
        super()._select(index)
        self._clear_cached("_by_simulation")

    def _state(self):
        return super()._state() | {
            "seen": asdict(self.seen),
            "variance_seen": asdict(self.variance_seen),
        }

    def _restore(self, state):
        self.seen = ObservedDerivatives(**state["seen"])
        self.variance_seen = ObservedDerivatives(**state["variance_seen"])
        super()._restore(state)


def _observations(
    values: torch.Tensor, slopes: torch.Tensor, seen: ObservedDerivatives
) -> torch.Tensor:
    """Values (N, D) and those of the derivatives (N, D, P) that are seen: (N + M, D)."""
    return torch.cat([values, slopes[seen.at, :, seen.along]])
