"""The rational quadratic kernel and its derivatives, for NumPy arrays and for torch tensors.

With a length scale per input,

    k(x, x') = (1 + r^2 / (2 alpha))^(-alpha),   r^2 = sum_d ((x_d - x'_d) / l_d)^2,

and the covariances of derivatives are derivatives of k (Rasmussen and Williams 2006, section 9.4,
ISBN 026218253X). Observations are ordered values first, then the derivative along each input in
turn: (1 + d) n rows.
"""

import sys


def rational_quadratic(r2, alpha):
    """k, dk/d(r^2) and d2k/d(r^2)^2 at squared scaled distances `r2`."""
    base = 1 + r2 / (2 * alpha)
    value = base**-alpha
    first = -value / (2 * base)
    return value, first, -first * (alpha + 1) / (2 * alpha * base)


def joint_covariance(x, y, lengthscales, alpha):
    """Covariance ((1 + d) n, (1 + d) m) of values and gradients at `x` (n, d) with those at `y`.

    `lengthscales` (d,) and `alpha` are positive.
    """
    parts = (covariance_with_values, covariance_with_gradients)
    return _library(x).concatenate([part(x, y, lengthscales, alpha) for part in parts], 1)


def covariance_with_values(x, y, lengthscales, alpha):
    """Covariance ((1 + d) n, m) of values and gradients at `x` (n, d) with the values at `y`."""
    scaled, value, first, _ = _derivatives(x, y, lengthscales, alpha)
    slopes = [2 * first * scaled[..., j] for j in range(x.shape[1])]
    return _library(x).concatenate([value, *slopes], 0)


def covariance_with_gradients(x, y, lengthscales, alpha):
    """Covariance ((1 + d) n, d m) of values and gradients at `x` (n, d) with the gradients at
    `y` (m, d)."""
    library, d = _library(x), x.shape[1]
    scaled, _, first, second = _derivatives(x, y, lengthscales, alpha)
    rows = [library.concatenate([-2 * first * scaled[..., j] for j in range(d)], 1)]
    for i in range(d):
        curvature = [-4 * second * scaled[..., i] * scaled[..., j] for j in range(d)]
        curvature[i] = curvature[i] - 2 * first / lengthscales[i] ** 2
        rows.append(library.concatenate(curvature, 1))
    return library.concatenate(rows, 0)


def _derivatives(x, y, lengthscales, alpha):
    """Gaps over squared length scales (n, m, d), and k with its derivatives (n, m)."""
    gap = (x[:, None, :] - y[None, :, :]) / lengthscales
    return gap / lengthscales, *rational_quadratic((gap**2).sum(-1), alpha)


def _library(x):
    """NumPy or torch: what is needed of both has the same names, and torch stays unloaded where
    there are arrays only."""
    return sys.modules[type(x).__module__.split(".")[0]]
