"""Exact Gaussian process that learns from sensitivities as well as from outputs."""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.optimize import minimize

from regional_lv import derivative_kernel
from regional_lv.emulators.base import Architecture, TrainingSet
from regional_lv.emulators.exact_gp import ExactGP
from regional_lv.emulators.kernels import KERNELS, ZONAL, Blocks, parts_of
from regional_lv.emulators.shared_kernel import subset
from regional_lv.seeds import derive

LEAST_NUGGET = 1e-8


class GradientGP(ExactGP):
    """The exact GP with the kernel `zonal_rq` on values and derivatives.

    Derivatives are further observations (`regional_lv.derivative_kernel`), P per simulation: values
    of all simulations come first, then derivatives of as many of them (at random) as fit into
    `max_observations`. Sensitivities become derivatives about the standardised inputs by the chain
    rule. Settings: max_observations; hyperparameter_rows, the simulations that the hyperparameters
    are fitted to; iterations; calibration as for the exact GP.
    """

    name = "gradient_gp"
    architecture = Architecture("Gradient GP", "GP", "global", "multi-output")
    learns_from_sensitivities = True
    kernel = ZONAL

    def _learn_hyperparameters(self, training: TrainingSet, seed: int) -> dict:
        rows = subset(len(training.x), self.settings["hyperparameter_rows"], seed)
        y = training.y[rows]
        h = fit_hyperparameters(
            training.x[rows],
            _observations(y - y.mean(0), training.slopes[rows]),
            self._blocks,
            self.settings["iterations"],
        )
        self.length_scales, self.alpha = torch.as_tensor(h.length_scales), h.alpha
        self.nugget, self.gradient_nugget = h.value_nugget, h.gradient_nugget
        n, p = training.x.shape
        room = max(0, (self.settings["max_observations"] - n) // p)
        self.sloped = subset(n, min(n, room), derive(seed, "sloped"))
        return {"hyperparameter_rows": len(rows), "rows_with_derivatives": len(self.sloped)}

    def _targets(self, training):
        return _observations(training.y, training.slopes[self.sloped])

    def _training_covariance(self):
        x, sloped = self.inputs, self.inputs[self.sloped]
        common = self.length_scales, self.alpha, self._blocks
        self._scaled = x / self.length_scales
        n, count = len(x), len(sloped)
        upper = self._rows_at(x)
        lower = [
            derivative_kernel.covariance_with_values(sloped, x, *common)[count:],
            derivative_kernel.covariance_with_gradients(sloped, sloped, *common)[count:],
        ]
        noise = (self.gradient_nugget - self.nugget * self.length_scales**2).clamp(min=0.0)
        matrix = torch.cat([upper, torch.cat(lower, dim=1)])
        matrix.diagonal()[n:].add_((noise / self.length_scales**2).repeat_interleave(count))
        constant = torch.zeros(len(matrix), 1, dtype=x.dtype)
        constant[:n] = 1.0
        return matrix, constant

    # With u = x / l, v those of the simulations and k = prod_b k_b(r_b^2): for inputs p of block b
    # and i of block c, with f the derivative of log k about r_b^2, and f_b^2 / alpha that of f_b,
    # the covariance of the value at x with the derivative of a simulation along p is
    # -2 k f_b (u_p - v_p) / l_p. Its derivative about u_i is -4 k f_b (f_c + f_b / alpha [b = c])
    # (u_i - v_i) (u_p - v_p) / l_p, and for i = p -2 k f_b / l_p more. The sums over p are products
    # of matrices: nothing of size M x N x P is made.

    def _rows(self, context):
        u, k, *_ = context
        v, slopes, _ = self._at_sloped(u)
        columns = [k]
        for part, slope in zip(self._blocks, slopes, strict=True):
            for p in range(part.start, part.stop):
                columns.append(-2 * slope * (u[:, p, None] - v[:, p]) / self.length_scales[p])
        return torch.cat(columns, dim=1)

    def _at_sloped(self, u):
        """v, k f_b and f_b of the simulations that give derivatives; made anew, which takes less
        than picking their columns."""
        v = self._scaled[self.sloped]
        parts = parts_of(self.kernel, u, v, self.alpha, self._blocks)
        k, rates = KERNELS[self.kernel].value(parts, self.alpha), derivative_kernel.rates(parts)
        return v, [k * rate for rate in rates], rates

    def _weighted(self, u, k, *parts):
        # As `_rows` times the weights, one column after the other: putting them side by side takes
        # longer than the products.
        v, slopes, _ = self._at_sloped(u)
        weights = self._slope_weights
        total = k @ self.weights[: k.shape[1]]
        for part, slope in zip(self._blocks, slopes, strict=True):
            for p in range(part.start, part.stop):
                total.addmm_((v[:, p] - u[:, p, None]) * slope, weights[p], alpha=2)
        return total

    @property
    def _slope_weights(self):
        """Weights (P, n, D) of the derivatives, over the length scales."""
        weights = self.weights[len(self.inputs) :].reshape(
            len(self.length_scales), -1, self.weights.shape[1]
        )
        return weights / self.length_scales[:, None, None]

    def _pull_back(self, by_k, u, k, *parts):
        n = k.shape[1]
        by_values = super()._pull_back(by_k[:, :n], u, k, *parts)
        v, slopes, rates = self._at_sloped(u)
        by_slope = by_k[:, n:].reshape(len(u), u.shape[1], -1) / self.length_scales[:, None]
        along = [
            (u[:, None, part] @ by_slope[:, part])[:, 0] - (by_slope[:, part] * v[:, part].T).sum(1)
            for part in self._blocks
        ]
        common = sum(f * each for f, each in zip(rates, along, strict=True))
        by_u = torch.empty_like(u)
        for part, slope, f, own in zip(self._blocks, slopes, rates, along, strict=True):
            pulled = -4 * slope * (common + f * own / self.alpha)
            moment = pulled.sum(1, keepdim=True) * u[:, part] - pulled @ v[:, part]
            by_u[:, part] = moment - 2 * (slope[:, None] * by_slope[:, part]).sum(-1)
        return by_values + by_u / self.length_scales

    def _mean_slopes(self, u, k, *parts):
        of_values = super()._mean_slopes(u, k, *parts)
        v, slopes, rates = self._at_sloped(u)
        weights = self._slope_weights
        along = [
            torch.tensordot(u[:, part], weights[part], 1)
            - (v[:, part].T[..., None] * weights[part]).sum(0)
            for part in self._blocks
        ]
        common = sum(f[..., None] * each for f, each in zip(rates, along, strict=True))
        by_u = torch.empty_like(of_values)
        for part, slope, f, own in zip(self._blocks, slopes, rates, along, strict=True):
            pulled = -4 * slope[..., None] * (common + f[..., None] * own / self.alpha)
            moment = pulled.sum(1)[..., None] * u[:, None, part] - pulled.mT @ v[:, part]
            by_u[..., part] = moment - 2 * torch.tensordot(slope, weights[part], ([1], [1])).mT
        return of_values + by_u / self.length_scales

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


def _observations(values: torch.Tensor, slopes: torch.Tensor) -> torch.Tensor:
    """Values (N, D) and derivatives (n, D, P) in the covariance's order: (N + P n, D)."""
    return torch.cat([values, slopes.permute(2, 0, 1).reshape(-1, slopes.shape[1])])


@dataclass(frozen=True)
class Hyperparameters:
    """Length scales (P,), exponent `alpha`, and the noise variances of values and derivatives.

    Noise is relative to the process's variance; that of a derivative is for inputs scaled by their
    length scale.
    """

    length_scales: np.ndarray
    alpha: float
    value_nugget: float
    gradient_nugget: float


def fit_hyperparameters(
    x: torch.Tensor, y: torch.Tensor, blocks: Blocks, iterations: int
) -> Hyperparameters:
    """Hyperparameters of largest likelihood, each output with its own variance (profiled out).

    x: (n, P). y: (n + P n, D), values with mean zero and derivatives of all of them. The cost grows
    with the cube of (1 + P) n: pass a subset of the rows when they are many.
    """
    n, p = x.shape
    first = np.log([*(2.0 * x.numpy().std(axis=0) + 1e-3), 2.0, 1e-6, 1e-5])
    rows = len(y)

    def loss(vector):
        free = torch.tensor(vector, requires_grad=True)
        scales, alpha, *nuggets = torch.exp(free).split([p, 1, 1, 1])
        value_nugget, gradient_nugget = (nugget + LEAST_NUGGET for nugget in nuggets)
        covariance = derivative_kernel.joint_covariance(x, x, scales, alpha, blocks)
        of_gradients = (gradient_nugget / scales**2).repeat_interleave(n)
        noise = torch.cat([value_nugget.expand(n), of_gradients])
        factor, failed = torch.linalg.cholesky_ex(covariance + torch.diag(noise))
        if failed:
            return 1e10, np.zeros_like(vector)
        white = torch.linalg.solve_triangular(factor, y, upper=False)
        variance = (white**2).sum(0) / rows
        nll = torch.log(factor.diagonal()).sum() / rows + 0.5 * torch.log(variance).mean()
        nll.backward()
        return nll.item(), free.grad.numpy()

    bounds = [(np.log(0.05), np.log(100.0))] * p
    bounds += [(np.log(0.1), np.log(100.0)), (np.log(1e-12), 0.0), (np.log(1e-10), 0.0)]
    found = minimize(
        loss, first, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": iterations}
    )
    best = np.exp(found.x)
    return Hyperparameters(
        best[:p],
        float(best[p]),
        float(best[p + 1]) + LEAST_NUGGET,
        float(best[p + 2]) + LEAST_NUGGET,
    )
