"""Exact Gaussian process for all outputs at once, one kernel shared by all.

Intrinsic coregionalisation (`shared_kernel`): the covariance of the training set is a Kronecker
product, one Cholesky factor of the N x N matrix K serves all outputs.
"""

import logging
import math
import time
from collections.abc import Iterator
from functools import cached_property

import numpy as np
import torch
from scipy import stats
from scipy.optimize import brentq, minimize
from scipy.special import gammaln

from regional_lv.emulators.base import (
    Architecture,
    Emulator,
    Prediction,
    SeparablePrediction,
    TrainingSet,
)
from regional_lv.emulators.kernels import KERNELS, Blocks, blocks_of, parts_of
from regional_lv.emulators.shared_kernel import (
    cholesky,
    condition,
    fit_hyperparameters,
    projected_precision,
    regular,
    subset,
)
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

HYPERPARAMETER_ROWS = 1500
"""Rows that the hyperparameters are fitted to, at most: their likelihood costs O(N^3) per
evaluation and a dozen numbers are well determined long before."""

RESTARTS = 2

FREEDOMS = (3.0, 1e4)
"""Least and most degrees of freedom of errors with a t."""

JUDGED = 0.95
"""Intervals by which the variance is calibrated. Errors have heavier tails than a Gaussian has:
what is right for their mean square is too narrow there."""

ROUGH_ROWS, ROUGH_PENALTY = 1000, 1e-10
"""Simulations of the rough emulator, and what keeps its weights small. On the paper's 5,541 its
mean costs a twentieth of the exact one, and differs from it by half the noise of MRI: chi2 of 0.6
over all outputs at half of the points of the box."""

ROWS_AT_ONCE = 256
"""Rows of the covariance matrix that are made together: what their derivatives need is made, too,
and for all rows it takes gigabytes."""

FEW_ROWS_SHRINKAGE = 0.1
"""Least shrinkage with no more simulations than outputs: the errors then lie in a subspace, and
leaving one out says nothing of the directions outside it."""

SHRINKAGES = (0.0, *np.logspace(-6, 0, 13))


class ExactGP(Emulator):
    """Exact multi-output GP with a constant mean (its uncertainty included).

    Settings: kernel; nugget, the smallest value added to the diagonal of the correlation matrix (a
    larger one is learnt where the data ask for it); iterations, L-BFGS iterations per start;
    calibration: `variance_factor` multiplies the predictive variance by what makes 95 % intervals
    of theta right for the leave-one-out errors of the training set, `variance_trend` by a power of
    the mean stiffness first, `student` (the default) makes their distribution a multivariate t as
    well, `none` leaves it as the likelihood has it. The kernel is the same everywhere, but outputs
    answer the more to theta the softer a heart is, and so do the errors; and errors of one
    simulation are large or small together, so that those that no theta explains tell how large
    those are that move the estimate.
    """

    name = "exact_gp"
    architecture = Architecture("Exact GP", "GP", "global", "multi-output")

    # ------------------------------------------------------------------------------- fitting

    def _fit(self, training: TrainingSet, seed: int) -> None:
        started = time.monotonic()
        learnt = self._learn_hyperparameters(training, seed)
        self._factorise()
        targets = self._targets(training)
        self.mean, self.weights = condition(self.cholesky, targets, self._constant)
        self._calibrate(training.y, targets)
        seconds = time.monotonic() - started
        self.info = {
            "rows": len(training.x),
            **learnt,
            "length_scales": self.length_scales.tolist(),
            "alpha": self.alpha,
            "nugget": self.nugget,
            "seconds": seconds,
            **self.info,
        }
        log.info("%s: fitted to %d simulations in %.1f s", self.name, len(training.x), seconds)

    def _learn_hyperparameters(self, training: TrainingSet, seed: int) -> dict:
        """Set length scales, alpha and nugget; return what the report says of them."""
        rows = subset(len(training.x), HYPERPARAMETER_ROWS, seed)
        s = self.settings
        h = fit_hyperparameters(
            training.x[rows],
            training.y[rows],
            *(s["kernel"], s["nugget"], s["iterations"], RESTARTS, seed, self._blocks),
        )
        self.length_scales, self.alpha, self.nugget = h.length_scales, h.alpha, h.nugget
        return {"hyperparameter_rows": len(rows), "log_marginal_likelihood": -h.value}

    def _targets(self, training: TrainingSet) -> torch.Tensor:
        """The observations (n, D), in the order of the covariance matrix."""
        return training.y

    def _training_covariance(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Correlations (n, n) of the observations, and what each sees of the mean (n, 1)."""
        self._scaled = self.inputs / self.length_scales
        matrix = self._rows_at(self.inputs)
        return matrix, torch.ones(len(matrix), 1, dtype=matrix.dtype)

    def _factorise(self) -> None:
        """Cholesky factor of the observations' correlation matrix, and c' K^-1 c."""
        matrix, self._constant = self._training_covariance()
        self.cholesky, self.nugget = cholesky(matrix, self.nugget, self.name)
        self._ones = torch.linalg.solve_triangular(self.cholesky, self._constant, upper=False)
        self._total = (self._ones**2).sum()

    def _rows_at(self, x: torch.Tensor) -> torch.Tensor:
        """Correlations (M, n) of the values at `x` (M, P) with the observations."""
        return torch.cat([self._rows(self._near(part)) for part in x.split(ROWS_AT_ONCE)])

    @property
    def kernel(self) -> str:
        return self.settings["kernel"]

    @cached_property
    def _blocks(self) -> Blocks:
        return blocks_of(self.kernel, self.parameters)

    def _leave_one_out(self, precision, targets) -> tuple[torch.Tensor, torch.Tensor]:
        """Errors (N, D) and variances (N,) of predicting each simulation from all others."""
        return leave_one_out(precision, targets)

    def _calibrate(self, y, targets) -> None:
        """B, and the factor on the variance from leave-one-out errors of the training set alone."""
        precision, _ = projected_precision(self.cholesky, self._constant)
        b = targets.T @ precision @ targets / (len(targets) - 1)
        residuals, variances = self._leave_one_out(precision, targets)
        del precision
        shrinkage = 0.0
        if len(y) < 4 * y.shape[1]:
            shrinkage = choose_shrinkage(residuals / variances.sqrt()[:, None])
        b = (b + shrinkage * torch.diag(b.diagonal())) / (1 + shrinkage)
        self.output_b = regular(b)
        self._set_output_covariance()
        self.variance_factor, self.variance_trend, self.freedom = 1.0, (0.0, 0.0), math.inf
        theta, calibration = self._unstandardise(self.inputs), self.settings["calibration"]
        outputs, inputs = y.shape[1], theta.shape[1]
        factor = torch.linalg.cholesky(self.output_b)
        # Of unit variance in every direction if that is right.
        errors = torch.linalg.solve_triangular(factor, residuals.T, upper=False).T
        errors = errors / variances.sqrt()[:, None]
        before = float(errors.square().mean())
        if calibration in ("student", "variance_trend"):
            self.variance_trend = fit_trend(errors.square().mean(1), theta.log().mean(1))
            errors = errors / self._trend(theta).sqrt()[:, None]
        by_theta = torch.cat([self.jacobian(part)[0] for part in theta.split(256)])
        slopes = by_theta / self.output_sd[:, None]
        moved, along = estimates_move(
            torch.linalg.solve_triangular(factor, slopes, upper=False), errors
        )
        across = errors.square().sum(1) - along
        if calibration == "student" and outputs > inputs:
            self.freedom = fit_freedom(along, across, inputs, outputs - inputs)
        if calibration != "none":
            self.variance_factor = interval_factor(moved, across, self.freedom, outputs)
        self.info = {
            "calibration": calibration,
            "variance_factor": self.variance_factor,
            "variance_trend": list(self.variance_trend),
            "freedom": self.freedom if math.isfinite(self.freedom) else None,
            "output_shrinkage": shrinkage,
            "loo_squared_distance_per_output_before": before,
            "loo_squared_distance_per_output": float(errors.square().mean()),
            "loo_squared_distance_per_parameter": float(moved.square().mean()),
            "loo_rmse_standardised": float(residuals.square().mean().sqrt()),
        }

    def _trend(self, theta: torch.Tensor) -> torch.Tensor:
        """What the variance is multiplied by at `theta` (M, P) before `variance_factor`, (M,)."""
        level, power = self.variance_trend
        return torch.exp(level + power * theta.log().mean(-1))

    def _set_output_covariance(self) -> None:
        self.output_covariance = self.output_sd[:, None] * self.output_b * self.output_sd

    # ---------------------------------------------------------------------------- predicting

    def _predict(self, theta: torch.Tensor) -> Prediction:
        flat = theta.reshape(-1, theta.shape[-1])
        mean, variance = _Evaluate.apply(flat, self)
        shape = theta.shape[:-1]
        return self._separable(mean.reshape(*shape, -1), variance.reshape(shape))

    @cached_property
    def rough(self) -> Emulator:
        """As in the base class: the correlations with `ROUGH_ROWS` simulations, weighted so that
        the mean is nearly the same at all of them; the variance is that of knowing these alone."""
        if len(self.inputs) < 2 * ROUGH_ROWS:
            return self
        rows = subset(len(self.inputs), ROUGH_ROWS, derive(0, "rough"))
        rough = object.__new__(ExactGP)  # also of emulators that learn from more than values
        rough.__dict__.update(self.__dict__, settings=self.settings | {"kernel": self.kernel})
        rough.inputs = self.inputs[rows]
        rough._factorise()
        theta = self._unstandardise(self.inputs)
        mean = torch.cat([self.predict_mean(part) for part in theta.split(ROWS_AT_ONCE)])
        target = (mean - self.output_mean) / self.output_sd - self.mean
        # A penalty keeps the weights small: further equations, whose right side is zero.
        penalty = ROUGH_PENALTY**0.5 * torch.eye(len(rows), dtype=mean.dtype)
        left = torch.cat([rough._rows_at(self.inputs), penalty])
        right = torch.cat([target, torch.zeros_like(target[: len(rows)])])
        rough.weights = torch.linalg.lstsq(left, right).solution
        return rough

    def _separable(self, mean, variance) -> SeparablePrediction:
        return SeparablePrediction(
            mean,
            variance,
            self.output_covariance,
            determinant_weight=1 / self.variance_factor,
            freedom=self.freedom,
        )

    def predict_mean(self, theta: torch.Tensor) -> torch.Tensor:
        """As in the base class: a product with the weights, no triangular solve."""
        mean = _Mean.apply(theta.reshape(-1, theta.shape[-1]), self)
        return mean.reshape(*theta.shape[:-1], -1)

    def with_variance(self, theta: torch.Tensor, variance: torch.Tensor) -> Prediction:
        """As in the base class, without the triangular solves that the own variance takes."""
        return self._separable(self.predict_mean(theta), variance)

    def _forward(self, theta: torch.Tensor) -> dict:
        """Everything about predictions at `theta` (M, P) that values and derivatives need."""
        context = self._near(self.standardise(theta))
        k = self._rows(context)
        half = torch.linalg.solve_triangular(self.cholesky, k.T, upper=False)
        rest = 1 - (self._ones.T @ half)[0]
        variance = 1 + self.nugget - (half * half).sum(0) + rest * rest / self._total
        scale = self.variance_factor * self._trend(theta)
        return {
            "mean": self._mean(k @ self.weights),
            "scale": scale,
            "variance": scale * variance.clamp(min=self.nugget),
            "half": half,
            "rest": rest,
            "context": context,
        }

    def _near(self, x: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """The context of predictions at `x` (M, P), of which their values and derivatives are
        made: `x` scaled, its correlations k (M, N) with the simulations, and the kernel's parts."""
        scaled = x / self.length_scales
        parts = parts_of(self.kernel, scaled, self._scaled, self.alpha, self._blocks)
        return scaled, KERNELS[self.kernel].value(parts, self.alpha), *parts

    def _rows(self, context) -> torch.Tensor:
        """Correlations (M, n) with the observations."""
        return context[1]

    def _slopes(self, k, parts) -> Iterator[tuple[slice, torch.Tensor]]:
        """The blocks of the kernel, each with the slope of k (M, N) about its squared distance."""
        return zip(self._blocks, KERNELS[self.kernel].slopes(k, parts), strict=True)

    def _pull_back(self, by_k, scaled, k, *parts) -> torch.Tensor:
        """Gradient (M, P) about x of a function whose gradient about k is `by_k` (M, n)."""
        # d k_n / d scaled_p = 2 slope_n (scaled_p - scaled_np), the slope that of p's block
        by_scaled = torch.empty_like(scaled)
        for part, slope in self._slopes(k, parts):
            by_d2 = by_k * slope
            moment = by_d2 @ self._scaled[:, part]
            by_scaled[:, part] = 2 * (by_d2.sum(1, keepdim=True) * scaled[:, part] - moment)
        return by_scaled / self.length_scales

    def _mean_slopes(self, scaled, k, *parts) -> torch.Tensor:
        """d(k weights)/dx, (M, D, P), of the values among the observations: they come first."""
        weights = self.weights[: k.shape[1]]
        by_x = k.new_empty(len(scaled), weights.shape[1], scaled.shape[1])
        for part, slope in self._slopes(k, parts):
            plain = slope @ weights
            for p in range(part.start, part.stop):
                moment = slope @ (self._scaled[:, p, None] * weights)
                by_x[:, :, p] = 2 * (scaled[:, p, None] * plain - moment)
        return by_x / self.length_scales

    def _variance_weights(self, scale, half, rest) -> torch.Tensor:
        """d(variance)/d(k), (M, N)."""
        inner = half + self._ones * (rest / self._total)
        solved = torch.linalg.solve_triangular(self.cholesky.T, inner, upper=True).T
        return -2 * scale[:, None] * solved

    def _trend_slope(self, theta, variance) -> torch.Tensor:
        """d(variance)/d(theta) (M, P) by the trend alone."""
        return (self.variance_trend[1] / theta.shape[-1]) * variance[:, None] / theta

    def jacobian(self, theta: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """As in the base class, from the kernel's derivative."""
        shape = theta.shape[:-1]
        flat = theta.detach().reshape(-1, theta.shape[-1])
        f = self._forward(flat)
        weights = self._variance_weights(f["scale"], f["half"], f["rest"])
        variance = self._pull_back(weights, *f["context"]) * self.standardise_slope(flat)
        variance = variance + self._trend_slope(flat, f["variance"])
        return self.linearise(theta)[1], variance.reshape(*shape, -1)

    @torch.no_grad()
    def linearise(self, theta: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """As in the base class; O(N) per point, where the variance is O(N^2)."""
        shape = theta.shape[:-1]
        flat = theta.reshape(-1, theta.shape[-1])
        context = self._near(self.standardise(flat))
        slopes = self._mean_slopes(*context) * self.output_sd[:, None]
        slopes = slopes * self.standardise_slope(flat)[:, None, :]
        mean = self._mean(self._weighted(*context))
        return mean.reshape(*shape, -1), slopes.reshape(*shape, *slopes.shape[1:])

    def _mean(self, weighted) -> torch.Tensor:
        """Predicted mean (M, D) from the correlations times the weights (M, D)."""
        return self.output_mean + self.output_sd * (self.mean + weighted)

    def _weighted(self, scaled, k, *parts) -> torch.Tensor:
        """`_rows` times the weights, (M, D), for means without their variance."""
        return k @ self.weights

    # --------------------------------------------------------------------------- keeping

    def _select(self, index: torch.Tensor) -> None:
        self.mean, self.weights = self.mean[index], self.weights[:, index].contiguous()
        self.output_b = self.output_b[index][:, index]
        self.__dict__.pop("rough", None)
        self._set_output_covariance()

    def _state(self) -> dict:
        # The Cholesky factor is made again at loading: a quarter of a gigabyte at N = 5,661.
        return {key: getattr(self, key) for key in _STATE}

    def _restore(self, state: dict) -> None:
        for key in _STATE:
            setattr(self, key, state[key])
        self._factorise()
        self._set_output_covariance()


_STATE = (
    *("length_scales", "alpha", "nugget", "mean", "weights", "output_b"),
    *("variance_factor", "variance_trend", "freedom"),
)


class _Evaluate(torch.autograd.Function):
    """Mean and variance with their exact gradient: two triangular solves, no graph of N x D."""

    @staticmethod
    def forward(ctx, theta, gp):
        f = gp._forward(theta)
        ctx.gp = gp
        keys = ("scale", "variance", "half", "rest")
        ctx.save_for_backward(theta, *(f[key] for key in keys), *f["context"])
        return f["mean"], f["variance"]

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, by_mean, by_variance):
        gp = ctx.gp
        theta, scale, variance, half, rest, *context = ctx.saved_tensors
        by_k = (by_mean * gp.output_sd) @ gp.weights.T
        by_k += gp._variance_weights(scale, half, rest) * by_variance[:, None]
        by_theta = gp._pull_back(by_k, *context) * gp.standardise_slope(theta)
        return by_theta + by_variance[:, None] * gp._trend_slope(theta, variance), None


class _Mean(torch.autograd.Function):
    """The mean alone with its exact gradient: a row of correlations per point."""

    @staticmethod
    def forward(ctx, theta, gp):
        context = gp._near(gp.standardise(theta))
        ctx.gp = gp
        ctx.save_for_backward(theta, *context)
        return gp._mean(gp._weighted(*context))

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, by_mean):
        gp = ctx.gp
        theta, *context = ctx.saved_tensors
        by_k = (by_mean * gp.output_sd) @ gp.weights.T
        return gp._pull_back(by_k, *context) * gp.standardise_slope(theta), None


# ------------------------------------------------------------------------- linear algebra, LOO


def leave_one_out(precision: torch.Tensor, y: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Errors (..., N, D) and variances (..., N) of predicting each row from all others, in closed
    form, of the projected precision Q (..., N, N).

    With the constant mean estimated anew each time: e_i = [Q y]_i / Q_ii, v_i = 1 / Q_ii
    (Dubrule 1983, doi 10.1007/BF01033233).
    """
    diagonal = precision.diagonal(dim1=-2, dim2=-1)
    return (precision @ y) / diagonal[..., None], 1 / diagonal


def estimates_move(slopes: torch.Tensor, errors: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """How far `errors` (N, D) move the estimates of theta (N, P), in predicted sd, and the squared
    length (N,) of what moves them.

    errors: whitened by their predicted covariance S. slopes: the Jacobians J (N, D, P), whitened by
    S or a multiple of it. An error along the columns of the Jacobian is what inference mistakes for
    a change of theta: the estimate moves by (J' S^-1 J)^-1 J' S^-1 e, which has the covariance
    (J' S^-1 J)^-1 if S is right.
    """
    inverse = torch.linalg.pinv(slopes)
    move = (inverse @ errors[..., None])[..., 0]
    along = (slopes @ move[..., None])[..., 0].square().sum(-1)
    return move / inverse.square().sum(-1).sqrt(), along


def fit_trend(distance: torch.Tensor, x: torch.Tensor) -> tuple[float, float]:
    """Level and power (a, b) for which errors have the variance exp(a + b x), most likely.

    distance: (N,) squared errors in units of their predicted variance, means over the outputs;
    x: (N,). Outputs count as one: errors of one simulation go together. b has a standard normal
    prior, which matters to a few dozen simulations.
    """

    def loss(ab):
        logs = ab[0] + ab[1] * x
        ratio = distance * np.exp(-logs)
        rest = 1 - ratio
        value = 0.5 * (ratio + logs).sum() + 0.5 * ab[1] ** 2
        return value, np.array([0.5 * rest.sum(), 0.5 * (rest * x).sum() + ab[1]])

    distance, x = distance.numpy(), x.numpy()
    found = minimize(loss, [np.log(distance.mean()), 0.0], jac=True, method="L-BFGS-B")
    return tuple(float(value) for value in found.x)


def fit_freedom(along: torch.Tensor, across: torch.Tensor, inputs: int, others: int) -> float:
    """Degrees of freedom of a t with which squared errors `across` (N,), of `others` directions,
    tell most of those `along` (N,) that theta moves the outputs (`inputs` directions).

    Given the ones, the others have a t with nu + `others` degrees of freedom, and the scale
    (nu + across) / (nu + others) (Ding 2016, doi 10.1080/00031305.2016.1164756); a common factor on
    it is fitted beside nu.
    """
    along, across = along.numpy(), across.numpy()

    def loss(logs):
        nu, factor = np.exp(logs)
        n = nu + others
        scaled = factor * (nu + across)  # n times the scale
        constant = gammaln((n + inputs) / 2) - gammaln(n / 2)
        lost = 0.5 * inputs * np.log(scaled) + 0.5 * (n + inputs) * np.log1p(along / scaled)
        return (lost - constant).mean()

    bounds = [tuple(np.log(FREEDOMS)), (-3.0, 3.0)]
    found = minimize(loss, [math.log(10.0), 0.0], method="L-BFGS-B", bounds=bounds)
    return float(np.exp(found.x[0]))


def interval_factor(
    moved: torch.Tensor, across: torch.Tensor, freedom: float, outputs: int
) -> float:
    """Factor f >= 1 on the variance for which `JUDGED` intervals of theta hold that share of the
    estimates' errors.

    moved: (N, P) errors of the estimates, in predicted sd; across: (N,) squared length of the
    errors that no theta explains; freedom: nu of the errors' t, in `outputs` directions (D).
    Inference takes the density to the power 1 / f (`SeparablePrediction.determinant_weight`). To
    first order theta then has a t with n = (nu + D) / f - P degrees of freedom and the squared
    scale (nu + across) / n, in units of the predicted variance; of Gaussian errors the variance f.
    """
    share, inputs = 0.5 + 0.5 * JUDGED, moved.shape[1]
    if math.isinf(freedom):
        return max(1.0, float(moved.abs().quantile(JUDGED) / stats.norm.ppf(share)) ** 2)
    judged = float((moved.abs() / (freedom + across).sqrt()[:, None]).quantile(JUDGED))

    def too_narrow(factor):
        n = (freedom + outputs) / factor - inputs
        return judged * n**0.5 - stats.t.ppf(share, n)

    widest = (freedom + outputs) / (inputs + 1)  # n = 1
    if too_narrow(1.0) <= 0:
        return 1.0
    return float(brentq(too_narrow, 1.0, widest)) if too_narrow(widest) < 0 else widest


def choose_shrinkage(z: torch.Tensor) -> float:
    """Weight w that draws the covariance of `z` (N, D) to its diagonal, (C + w diag C) / (1 + w).

    With few simulations the sample covariance of many outputs is singular or too narrow; the
    weight is the one under which each row is most likely given the covariance of the others.
    """
    n, d = z.shape
    gram = z.T @ z
    best = (-math.inf, SHRINKAGES[-1])
    for weight in SHRINKAGES:
        if n <= d and weight < FEW_ROWS_SHRINKAGE:
            continue
        factor, failed = torch.linalg.cholesky_ex(gram + weight * torch.diag(gram.diagonal()))
        if failed:
            continue
        leverage = torch.linalg.solve_triangular(factor, z.T, upper=False).square().sum(0)
        if leverage.max() > 1 - 1e-9:
            continue
        # Sherman-Morrison: without row i the gram loses z_i z_i'. The diagonal that it is drawn to
        # keeps that row: one number per output, out of N.
        size = (n - 1) * (1 + weight)
        distance = size * leverage / (1 - leverage)
        determinant = 2 * factor.diagonal().log().sum() + torch.log1p(-leverage) - d * np.log(size)
        score = float(-0.5 * (distance + determinant).mean())
        best = max(best, (score, float(weight)))
    return best[1]
