"""Gaussian process regression on values and gradients: the algebra, shared by its users.

One kernel serves all outputs: the product over the zones of rational quadratic ones, with a length
scale per input (`kernel`). Gradients are further observations of the same process.
"""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.optimize import minimize

from regional_lv.kernel import joint_covariance

LEAST_NUGGET = 1e-8


@dataclass(frozen=True)
class Hyperparameters:
    """Length scales (d,), exponent `alpha`, and the noise variances of values and gradients.

    Noise is relative to the process's variance; that of a gradient is for inputs scaled by their
    length scale.
    """

    lengthscales: np.ndarray
    alpha: float
    value_nugget: float
    gradient_nugget: float


def _noise(n, lengthscales, h):
    return torch.cat(
        [
            torch.as_tensor(h.value_nugget).expand(n),
            (h.gradient_nugget / lengthscales**2).repeat_interleave(n),
        ]
    )


def observations(values: np.ndarray, gradients: np.ndarray) -> np.ndarray:
    """Values (n, m) and gradients (n, d, m) in the covariance's order: ((1 + d) n, m)."""
    n, d, m = gradients.shape
    return np.concatenate([values, gradients.transpose(1, 0, 2).reshape(d * n, m)])


def fit(
    x: np.ndarray,
    values: np.ndarray,
    gradients: np.ndarray,
    start: Hyperparameters | None = None,
    iterations: int = 60,
) -> Hyperparameters:
    """Hyperparameters of largest likelihood, each output with its own variance (profiled out).

    `x` (n, d), `values` (n, m) with mean zero, `gradients` (n, d, m). The cost grows with the cube
    of (1 + d) n: pass a subset of the rows when they are many.
    """
    n, d = x.shape
    y = torch.as_tensor(observations(values, gradients))
    points = torch.as_tensor(x)
    start = start or Hyperparameters(2.0 * x.std(axis=0) + 1e-3, 2.0, 1e-6, 1e-5)
    first = np.log([*start.lengthscales, start.alpha, start.value_nugget, start.gradient_nugget])
    rows = len(y)

    def loss(vector):
        free = torch.tensor(vector, requires_grad=True)
        parts = torch.exp(free)
        h = Hyperparameters(parts[:d], parts[d], *(parts[d + 1 :] + LEAST_NUGGET))
        covariance = joint_covariance(points, points, h.lengthscales, h.alpha)
        covariance = covariance + torch.diag(_noise(n, h.lengthscales, h))
        factor, failed = torch.linalg.cholesky_ex(covariance)
        if failed:
            return 1e10, np.zeros_like(vector)
        white = torch.linalg.solve_triangular(factor, y, upper=False)
        variance = (white**2).sum(0) / rows
        nll = torch.log(factor.diagonal()).sum() / rows + 0.5 * torch.log(variance).mean()
        nll.backward()
        return nll.item(), free.grad.numpy()

    bounds = [(np.log(0.05), np.log(100.0))] * d
    bounds += [(np.log(0.1), np.log(100.0)), (np.log(1e-12), 0.0), (np.log(1e-10), 0.0)]
    found = minimize(
        loss, first, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": iterations}
    )
    best = np.exp(found.x)
    return Hyperparameters(
        best[:d],
        float(best[d]),
        float(best[d + 1]) + LEAST_NUGGET,
        float(best[d + 2]) + LEAST_NUGGET,
    )
