"""Exact Gaussian process for all outputs at once, one kernel shared by all.

Intrinsic coregionalisation (Bonilla et al. 2007): cov(y_k(theta), y_l(theta')) = b_kl K(theta,
theta'). All outputs are seen at all inputs, so that the covariance of the training set is a
Kronecker product, one Cholesky factor of the N x N matrix K serves all outputs, and the
maximum-likelihood B has a closed form given K.
"""

import logging
import math
import time

import numpy as np
import torch
from scipy.optimize import minimize

from regional_lv.emulators.base import Emulator, Prediction, SeparablePrediction
from regional_lv.errors import InputError
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

HYPERPARAMETER_ROWS = 1500
"""Rows that the hyperparameters are fitted to, at most: their likelihood costs O(N^3) per
evaluation and a dozen numbers are well determined long before."""

RESTARTS = 2
CALIBRATIONS = ("variance_factor", "none")
FEW_ROWS_SHRINKAGE = 0.1
"""Least shrinkage with no more simulations than outputs: the errors then lie in a subspace, and
leaving one out says nothing of the directions outside it."""

SHRINKAGES = (0.0, *np.logspace(-6, 0, 13))


# ------------------------------------------------------------------------------------ kernels
# Each gives the correlation, its slope with respect to the squared scaled distance d2, and its
# derivative with respect to log(alpha) (zero without such a parameter).


def _rq(d2, alpha):
    u = 1 + d2 / (2 * alpha)
    k = u**-alpha
    return k, -0.5 * k / u


def _rbf(d2, alpha):
    k = torch.exp(-0.5 * d2)
    return k, -0.5 * k


def _matern52(d2, alpha):
    r = torch.sqrt(5 * d2)
    decay = torch.exp(-r)
    return (1 + r + r * r / 3) * decay, -5 / 6 * (1 + r) * decay


def _rq_alpha_slope(d2, alpha, k):
    u = d2 / (2 * alpha)
    return alpha * k * (u / (1 + u) - torch.log1p(u))


KERNELS = {"rq": _rq, "rbf": _rbf, "matern52": _matern52}


def _squared_distance(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """(M, N) squared distances between rows; one matrix product instead of M N P differences."""
    d2 = (a * a).sum(-1)[:, None] + (b * b).sum(-1) - 2 * (a @ b.T)
    return d2.clamp_(min=0.0)


class ExactGP(Emulator):
    """Exact multi-output GP with a constant mean (its uncertainty included).

    kernel: rq, rbf or matern52, with one length scale per parameter. nugget: smallest value added
    to the diagonal of the correlation matrix; a larger one is learnt where the data ask for it.
    iterations: L-BFGS iterations per start. calibration: `variance_factor` multiplies the
    predictive variance by what the leave-one-out errors of the training set ask for, `none` leaves
    it as the likelihood has it.

    Raises InputError for settings that are not offered.
    """

    name = "exact_gp"

    def __init__(
        self,
        kernel: str = "rq",
        input_transform: str = "log",
        nugget: float = 1e-8,
        iterations: int = 150,
        calibration: str = "variance_factor",
    ):
        super().__init__(input_transform)
        for key, value, offered in (
            ("kernel", kernel, KERNELS),
            ("calibration", calibration, CALIBRATIONS),
        ):
            if value not in offered:
                raise InputError(
                    f"exact_gp.{key}: {value!r} is not offered; choose one of {', '.join(offered)}"
                )
        self.settings |= {
            "kernel": kernel,
            "nugget": float(nugget),
            "iterations": int(iterations),
            "calibration": calibration,
        }

    # ------------------------------------------------------------------------------- fitting

    def _fit(self, x: torch.Tensor, y: torch.Tensor, seed: int) -> None:
        started = time.monotonic()
        rows = torch.arange(len(x))
        if len(x) > HYPERPARAMETER_ROWS:
            shuffled = np.random.default_rng(derive(seed, "rows")).permutation(len(x))
            rows = torch.as_tensor(np.sort(shuffled[:HYPERPARAMETER_ROWS]))
        value, parameters = self._fit_hyperparameters(x[rows], y[rows], seed)
        self.length_scales = torch.exp(parameters[:-2])
        self.alpha = float(torch.exp(parameters[-2]))
        self.nugget = self.settings["nugget"] + float(torch.exp(parameters[-1]))
        self.inputs = x
        self._factorise()
        self.mean, self.weights = _condition(self.cholesky, y)
        residuals, variances = leave_one_out(self.cholesky, y)
        self._calibrate(x, y, residuals, variances)
        seconds = time.monotonic() - started
        self.info = {
            "rows": len(x),
            "hyperparameter_rows": len(rows),
            "log_marginal_likelihood": -value,
            "length_scales": self.length_scales.tolist(),
            "alpha": self.alpha,
            "nugget": self.nugget,
            "seconds": seconds,
            **self.info,
        }
        log.info("exact_gp: fitted to %d simulations in %.1f s", len(x), seconds)

    def _fit_hyperparameters(self, x, y, seed) -> tuple[float, torch.Tensor]:
        """Best of several seeded starts: (negative log likelihood, log hyperparameters)."""
        rng = np.random.default_rng(derive(seed, "hyperparameters"))
        first = np.concatenate([np.full(x.shape[1], math.log(5.0)), [0.0, math.log(1e-6)]])
        bounds = [(-2.0, 6.0)] * x.shape[1] + [(-3.0, 5.0), (-30.0, 0.0)]
        best = None
        for start in range(RESTARTS):
            guess = first + (rng.normal(0, 0.7, len(first)) if start else 0.0)
            result = minimize(
                self._negative_log_likelihood,
                np.clip(guess, *np.transpose(bounds)),
                args=(x, y),
                jac=True,
                method="L-BFGS-B",
                bounds=bounds,
                options={"maxiter": self.settings["iterations"]},
            )
            log.info(
                "exact_gp: start %d of %d, negative log likelihood %.2f after %d evaluations",
                *(start + 1, RESTARTS, result.fun, result.nfev),
            )
            if best is None or result.fun < best.fun:
                best = result
        return float(best.fun), torch.as_tensor(best.x)

    def _negative_log_likelihood(self, p, x, y) -> tuple[float, np.ndarray]:
        """Restricted log likelihood with B at its maximum, and its gradient.

        (N - 1)/2 log|B| + D/2 (log|K| + log(1' K^-1 1)), B = Y' Q Y / (N - 1), Q the precision
        with the constant mean projected out; up to constants.
        """
        p = torch.as_tensor(p)
        scales, alpha = torch.exp(p[:-2]), torch.exp(p[-2])
        learnt = torch.exp(p[-1])
        scaled = x / scales
        d2 = _squared_distance(scaled, scaled)
        correlation, slope = KERNELS[self.settings["kernel"]](d2, alpha)
        n, d = y.shape
        matrix = correlation.clone()
        matrix.diagonal().add_(self.settings["nugget"] + learnt)
        factor, failed = torch.linalg.cholesky_ex(matrix)
        if failed:
            return 1e12, np.zeros(len(p))
        precision, total = _projected_precision(factor)
        weights = precision @ y
        b = _regular(y.T @ weights / (n - 1))
        if n <= d:
            # Fewer simulations than outputs leave B singular, and the likelihood without bound.
            b = torch.diag(b.diagonal())
        b_factor, failed = torch.linalg.cholesky_ex(b)
        if failed:
            return 1e12, np.zeros(len(p))
        value = (n - 1) * b_factor.diagonal().log().sum()
        value = value + d * (factor.diagonal().log().sum() + 0.5 * torch.log(total))
        sensitivity = 0.5 * (d * precision - weights @ torch.cholesky_solve(weights.T, b_factor))
        # sum_ij W_ij (a_i - a_j)^2 for every parameter from one product, W symmetric
        w = sensitivity * slope
        spread = 2 * ((scaled**2).T @ w.sum(1) - ((w @ scaled) * scaled).sum(0))
        gradient = [-2 * spread]
        if self.settings["kernel"] == "rq":
            by_alpha = (sensitivity * _rq_alpha_slope(d2, alpha, correlation)).sum()
        else:
            by_alpha = torch.zeros((), dtype=y.dtype)
        gradient.append(torch.stack([by_alpha, learnt * sensitivity.diagonal().sum()]))
        return float(value), torch.cat(gradient).numpy()

    def _factorise(self) -> None:
        """Cholesky factor of the correlation matrix of the training inputs, and 1' K^-1 1."""
        self._scaled = self.inputs / self.length_scales
        matrix, _ = self._correlate(_squared_distance(self._scaled, self._scaled))
        matrix.diagonal().add_(self.nugget)
        factor, failed = torch.linalg.cholesky_ex(matrix)
        while failed:
            matrix.diagonal().add_(9 * self.nugget)
            self.nugget *= 10
            log.warning("exact_gp: nugget raised to %.1e for a Cholesky factor", self.nugget)
            factor, failed = torch.linalg.cholesky_ex(matrix)
        self.cholesky = factor
        ones = torch.ones(len(factor), 1, dtype=factor.dtype)
        self._ones = torch.linalg.solve_triangular(factor, ones, upper=False)
        self._total = (self._ones**2).sum()

    def _correlate(self, d2):
        return KERNELS[self.settings["kernel"]](d2, self.alpha)

    def _calibrate(self, x, y, residuals, variances) -> None:
        """B, and the factor on the variance from leave-one-out errors of the training set alone."""
        b = y.T @ _projected_precision(self.cholesky)[0] @ y / (len(y) - 1)
        shrinkage = 0.0
        if len(y) < 4 * y.shape[1]:
            shrinkage = choose_shrinkage(residuals / variances.sqrt()[:, None])
        b = (b + shrinkage * torch.diag(b.diagonal())) / (1 + shrinkage)
        self.output_b = _regular(b)
        self._set_output_covariance()
        self.variance_factor = 1.0
        theta = self._unstandardise(x)
        by_theta = torch.cat([self.jacobian(part)[0] for part in theta.split(256)])
        along = self._squared_length_along(by_theta / self.output_sd[:, None], residuals, variances)
        if self.settings["calibration"] == "variance_factor":
            self.variance_factor = max(1.0, float(along.mean()))
        distance = _squared_length(residuals, self.output_b) / variances
        self.info = {
            "calibration": self.settings["calibration"],
            "variance_factor": self.variance_factor,
            "output_shrinkage": shrinkage,
            "loo_squared_distance_per_output": float(distance.mean() / y.shape[1]),
            "loo_squared_distance_per_parameter": float(along.mean()),
            "loo_rmse_standardised": float(residuals.square().mean().sqrt()),
        }

    def _squared_length_along(self, jacobian, residuals, variances) -> torch.Tensor:
        """Squared length (N,), per parameter, of the errors in the directions in which theta moves
        the outputs, in units of their predicted variance.

        An error along the columns of the Jacobian is what inference mistakes for a change of
        theta: the estimate moves by (J' S^-1 J)^-1 J' S^-1 e, which has the covariance
        (J' S^-1 J)^-1 if S is right, and the squared length 1 per parameter.
        """
        factor = torch.linalg.cholesky(self.output_b)
        white = torch.linalg.solve_triangular(factor, jacobian, upper=False)
        error = torch.linalg.solve_triangular(factor, residuals.T, upper=False).T
        basis, _ = torch.linalg.qr(white)
        along = (basis.mT @ error[..., None])[..., 0]
        return along.square().mean(-1) / variances

    def _set_output_covariance(self) -> None:
        self.output_covariance = self.output_sd[:, None] * self.output_b * self.output_sd

    # ---------------------------------------------------------------------------- predicting

    def _predict(self, theta: torch.Tensor) -> Prediction:
        flat = theta.reshape(-1, theta.shape[-1])
        mean, variance = _Evaluate.apply(flat, self)
        shape = theta.shape[:-1]
        return SeparablePrediction(
            mean.reshape(*shape, -1),
            variance.reshape(shape),
            self.output_covariance,
            determinant_weight=1 / self.variance_factor,
        )

    def _forward(self, theta: torch.Tensor) -> dict[str, torch.Tensor]:
        """Everything about predictions at `theta` (M, 10) that values and derivatives need."""
        x = self.standardise(theta)
        scaled = x / self.length_scales
        k, slope = self._correlate(_squared_distance(scaled, self._scaled))
        half = torch.linalg.solve_triangular(self.cholesky, k.T, upper=False)
        rest = 1 - (self._ones.T @ half)[0]
        variance = 1 + self.nugget - (half * half).sum(0) + rest * rest / self._total
        variance = variance.clamp(min=self.nugget)
        mean = self.output_mean + self.output_sd * (self.mean + k @ self.weights)
        return {
            "mean": mean,
            "variance": self.variance_factor * variance,
            "scaled": scaled,
            "slope": slope,
            "half": half,
            "rest": rest,
        }

    def _variance_weights(self, half, rest) -> torch.Tensor:
        """d(variance)/d(k), (M, N)."""
        inner = half + self._ones * (rest / self._total)
        return (
            -2
            * self.variance_factor
            * torch.linalg.solve_triangular(self.cholesky.T, inner, upper=True).T
        )

    def jacobian(self, theta: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """As in the base class, from the kernel's derivative."""
        shape = theta.shape[:-1]
        flat = theta.detach().reshape(-1, theta.shape[-1])
        f = self._forward(flat)
        to_theta = self.standardise_slope(flat) / self.length_scales
        # d k_n / d scaled_p = 2 slope_n (scaled_p - scaled_np)
        slope = f["slope"]
        means = torch.empty(len(flat), len(self.outputs), flat.shape[1], dtype=flat.dtype)
        plain = slope @ self.weights
        for p in range(flat.shape[1]):
            moment = slope @ (self._scaled[:, p, None] * self.weights)
            means[:, :, p] = 2 * (f["scaled"][:, p, None] * plain - moment)
        means *= self.output_sd[:, None] * to_theta[:, None, :]
        by_k = self._variance_weights(f["half"], f["rest"]) * slope
        variance = 2 * (by_k.sum(1, keepdim=True) * f["scaled"] - by_k @ self._scaled) * to_theta
        return means.reshape(*shape, *means.shape[1:]), variance.reshape(*shape, -1)

    # --------------------------------------------------------------------------- keeping

    def _select(self, index: torch.Tensor) -> None:
        self.mean, self.weights = self.mean[index], self.weights[:, index].contiguous()
        self.output_b = self.output_b[index][:, index]
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
    *("inputs", "length_scales", "alpha", "nugget", "mean", "weights", "output_b"),
    "variance_factor",
)


class _Evaluate(torch.autograd.Function):
    """Mean and variance with their exact gradient: two triangular solves, no graph of N x D."""

    @staticmethod
    def forward(ctx, theta, gp):
        f = gp._forward(theta)
        ctx.gp = gp
        ctx.save_for_backward(theta, *(f[key] for key in ("scaled", "slope", "half", "rest")))
        return f["mean"], f["variance"]

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, by_mean, by_variance):
        gp = ctx.gp
        theta, scaled, slope, half, rest = ctx.saved_tensors
        by_k = (by_mean * gp.output_sd) @ gp.weights.T
        by_k += gp._variance_weights(half, rest) * by_variance[:, None]
        by_k *= slope
        by_scaled = 2 * (by_k.sum(1, keepdim=True) * scaled - by_k @ gp._scaled)
        return by_scaled / gp.length_scales * gp.standardise_slope(theta), None


# ------------------------------------------------------------------------- linear algebra, LOO


def _projected_precision(factor: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Q = K^-1 - K^-1 1 1' K^-1 / (1' K^-1 1), and 1' K^-1 1.

    Training needs all of K^-1; predictions never use it.
    """
    precision = torch.cholesky_inverse(factor)
    sums = precision.sum(1)
    total = sums.sum()
    return precision - torch.outer(sums, sums) / total, total


def _regular(b: torch.Tensor) -> torch.Tensor:
    """`b` with a little on its diagonal, for outputs that depend on one another exactly."""
    return b + 1e-9 * b.diagonal().mean() * torch.eye(len(b), dtype=b.dtype)


def _condition(factor: torch.Tensor, y: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Generalised least-squares mean (D,) and weights K^-1 (y - mean) (N, D)."""
    ones = torch.ones(len(y), 1, dtype=y.dtype)
    solved = torch.cholesky_solve(ones, factor)
    mean = (solved.T @ y / solved.sum())[0]
    return mean, torch.cholesky_solve(y - mean, factor)


def leave_one_out(factor: torch.Tensor, y: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Errors (N, D) and variances (N,) of predicting each row from all others, in closed form.

    With the constant mean estimated anew each time: e_i = [Q y]_i / Q_ii, v_i = 1 / Q_ii
    (Dubrule 1983, doi 10.1007/BF01033233).
    """
    precision, _ = _projected_precision(factor)
    diagonal = precision.diagonal()
    return (precision @ y) / diagonal[:, None], 1 / diagonal


def _squared_length(errors: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """e_i' B^-1 e_i, (N,)."""
    factor = torch.linalg.cholesky(b)
    return torch.linalg.solve_triangular(factor, errors.T, upper=False).square().sum(0)


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
