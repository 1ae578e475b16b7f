"""One kernel for all outputs: its likelihood, its maximum, and which kernel to take.

Intrinsic coregionalisation (Bonilla et al. 2007): cov(y_k(x), y_l(x')) = b_kl K(x, x'). With all
outputs seen at all inputs the maximum-likelihood B has a closed form given K, so that the
hyperparameters are those of K alone.
"""

import logging
import math
from dataclasses import dataclass

import numpy as np
import torch
from scipy.optimize import minimize

from regional_lv.emulators.kernels import KERNELS, Blocks, one_block, parts_of
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

CHOICE_ROWS, CHOICE_FOLDS, CHOICE_ITERATIONS = 300, 3, 40
"""Cross-validation of the kernels: rows used at most, folds, iterations per fit. Kernels differ by
far more than this leaves uncertain."""

OFFERED = ("rq", "rbf", "matern52")
"""Kernels among which cross-validation chooses, those of the paper."""

MOST_NUGGET = 1e-2
"""Largest nugget that is tried for a Cholesky factor: beyond it the matrix is wrong, not stiff."""


@dataclass(frozen=True)
class Hyperparameters:
    """Of K: length scales (P,), the rational quadratic's alpha, and what is added to the diagonal;
    `value` is the negative log likelihood."""

    length_scales: torch.Tensor
    alpha: float
    nugget: float
    value: float


def subset(rows: int, most: int, seed: int) -> torch.Tensor:
    """At most `most` of `rows` row numbers, chosen at random, ascending."""
    if rows <= most:
        return torch.arange(rows)
    shuffled = np.random.default_rng(derive(seed, "rows")).permutation(rows)
    return torch.as_tensor(np.sort(shuffled[:most]))


def fit_hyperparameters(
    x: torch.Tensor,
    y: torch.Tensor,
    kernel: str,
    nugget: float,
    iterations: int,
    restarts: int,
    seed: int,
    blocks: Blocks | None = None,
) -> Hyperparameters:
    """Most likely of `restarts` seeded starts, for inputs (N, P) and outputs (N, D) of unit scale.

    nugget: the least; more is learnt where the data ask for it. blocks: of the kernel, None for all
    inputs together.
    """
    blocks = blocks or one_block(x.shape[1])
    rng = np.random.default_rng(derive(seed, "hyperparameters"))
    first = np.concatenate([np.full(x.shape[1], math.log(5.0)), [0.0, math.log(1e-6)]])
    bounds = [(-2.0, 6.0)] * x.shape[1] + [(-3.0, 5.0), (-30.0, 0.0)]
    best = None
    for start in range(restarts):
        guess = first + (rng.normal(0, 0.7, len(first)) if start else 0.0)
        result = minimize(
            negative_log_likelihood,
            np.clip(guess, *np.transpose(bounds)),
            args=(x, y, kernel, nugget, blocks),
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"maxiter": iterations},
        )
        log.debug(
            "%s kernel: start %d of %d, negative log likelihood %.2f after %d evaluations",
            *(kernel, start + 1, restarts, result.fun, result.nfev),
        )
        if best is None or result.fun < best.fun:
            best = result
    p = np.exp(best.x)
    return Hyperparameters(
        torch.as_tensor(p[:-2]), float(p[-2]), nugget + float(p[-1]), float(best.fun)
    )


def negative_log_likelihood(
    p, x, y, kernel: str, nugget: float, blocks: Blocks
) -> tuple[float, np.ndarray]:
    """Restricted log likelihood with B at its maximum, and its gradient.

    (N - 1)/2 log|B| + D/2 (log|K| + log(1' K^-1 1)), B = Y' Q Y / (N - 1), Q the precision
    with the constant mean projected out; up to constants. p: logarithms of the length scales, of
    alpha and of what is added to `nugget`.
    """
    p = torch.as_tensor(p)
    scales, alpha = torch.exp(p[:-2]), torch.exp(p[-2])
    learnt = torch.exp(p[-1])
    scaled = x / scales
    of = KERNELS[kernel]
    parts = parts_of(kernel, scaled, scaled, alpha, blocks)
    correlation = of.value(parts, alpha)
    n, d = y.shape
    matrix = correlation.clone()
    matrix.diagonal().add_(nugget + learnt)
    factor, failed = torch.linalg.cholesky_ex(matrix)
    if failed:
        return 1e12, np.zeros(len(p))
    precision, total = projected_precision(factor, torch.ones(n, 1, dtype=y.dtype))
    weights = precision @ y
    b = regular(y.T @ weights / (n - 1))
    if n <= d:
        # Fewer simulations than outputs leave B singular, and the likelihood without bound.
        b = torch.diag(b.diagonal())
    b_factor, failed = torch.linalg.cholesky_ex(b)
    if failed:
        return 1e12, np.zeros(len(p))
    value = (n - 1) * b_factor.diagonal().log().sum()
    value = value + d * (factor.diagonal().log().sum() + 0.5 * torch.log(total))
    sensitivity = 0.5 * (d * precision - weights @ torch.cholesky_solve(weights.T, b_factor))
    # sum_ij W_ij (a_i - a_j)^2 for every parameter of a block from one product, W symmetric
    gradient = []
    slopes = of.slopes(correlation, parts)
    for part, slope in zip(blocks, slopes, strict=True):
        w, own = sensitivity * slope, scaled[:, part]
        gradient.append(-4 * ((own**2).T @ w.sum(1) - ((w @ own) * own).sum(0)))
    if "rq" in kernel:
        by_alpha = (sensitivity * _rq_alpha_slope(parts, alpha, correlation)).sum()
    else:
        by_alpha = torch.zeros((), dtype=y.dtype)
    gradient.append(torch.stack([by_alpha, learnt * sensitivity.diagonal().sum()]))
    return float(value), torch.cat(gradient).numpy()


def _rq_alpha_slope(parts, alpha, k):
    """d(correlation)/d(log alpha) of the rational quadratic kernels."""
    return alpha * k * sum(1 - 1 / base - torch.log(base) for base in parts)


def choose_kernel(x: torch.Tensor, y: torch.Tensor, nugget: float, seed: int) -> tuple[str, dict]:
    """The kernel with the least K-fold cross-validated error, and the errors (root mean square).

    Inputs (N, P) and outputs (N, D) of unit scale. On a subsample: `CHOICE_ROWS`.
    """
    rows = subset(len(x), CHOICE_ROWS, derive(seed, "choice"))
    x, y = x[rows], y[rows]
    blocks = one_block(x.shape[1])
    order = np.random.default_rng(derive(seed, "folds")).permutation(len(x))
    fold = torch.as_tensor(order % CHOICE_FOLDS)
    errors = {}
    for kernel in OFFERED:
        value, total = KERNELS[kernel].value, 0.0
        for k in range(CHOICE_FOLDS):
            inside, outside = fold != k, fold == k
            h = fit_hyperparameters(
                x[inside], y[inside], kernel, nugget, CHOICE_ITERATIONS, restarts=1, seed=seed
            )
            a, b = x[inside] / h.length_scales, x[outside] / h.length_scales
            alpha = torch.tensor(h.alpha, dtype=x.dtype)
            matrix = value(parts_of(kernel, a, a, alpha, blocks), alpha)
            factor, _ = cholesky(matrix, h.nugget, "choice of the kernel")
            mean, weights = condition(factor, y[inside], torch.ones(len(a), 1, dtype=x.dtype))
            predicted = mean + value(parts_of(kernel, b, a, alpha, blocks), alpha) @ weights
            total += float((predicted - y[outside]).square().sum())
        errors[kernel] = math.sqrt(total / y.numel())
    best = min(errors, key=errors.get)
    log.info(
        "kernel %s: cross-validated errors %s",
        *(best, ", ".join(f"{name} {error:.4f}" for name, error in errors.items())),
    )
    return best, errors


# ------------------------------------------------------------------------------ linear algebra


def cholesky(matrix: torch.Tensor, nugget: float, who: str) -> tuple[torch.Tensor, float]:
    """Lower factor of `matrix` (..., N, N) + nugget I, and the nugget: raised, and logged, until
    there is a factor. Changes `matrix`. Raises ArithmeticError beyond `MOST_NUGGET`."""
    matrix.diagonal(dim1=-2, dim2=-1).add_(nugget)
    factor, failed = torch.linalg.cholesky_ex(matrix)
    while failed.any():
        if nugget > MOST_NUGGET:
            raise ArithmeticError(f"{who}: no Cholesky factor with a nugget of {nugget:.1e}")
        matrix.diagonal(dim1=-2, dim2=-1).add_(9 * nugget)
        nugget *= 10
        log.warning("%s: nugget raised to %.1e for a Cholesky factor", who, nugget)
        factor, failed = torch.linalg.cholesky_ex(matrix)
    return factor, nugget


def projected_precision(
    factor: torch.Tensor, constant: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Q = K^-1 - K^-1 c c' K^-1 / (c' K^-1 c) and c' K^-1 c, of a factor (..., N, N).

    constant: c (N, 1), what each observation sees of the unknown constant mean. Training needs
    all of K^-1; predictions never use it.
    """
    precision = torch.cholesky_inverse(factor)
    sums = precision @ constant
    total = (constant.mT @ sums)[..., 0, 0]
    return precision - sums @ sums.mT / total[..., None, None], total


def condition(
    factor: torch.Tensor, y: torch.Tensor, constant: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Generalised least-squares mean (..., D) and weights K^-1 (y - c mean) (..., N, D)."""
    solved = torch.cholesky_solve(constant.expand(*factor.shape[:-1], 1), factor)
    mean = solved.mT @ y / (solved.mT @ constant)
    return mean[..., 0, :], torch.cholesky_solve(y - constant * mean, factor)


def regular(b: torch.Tensor) -> torch.Tensor:
    """`b` with a little on its diagonal, for outputs that depend on one another exactly."""
    size = b.diagonal(dim1=-2, dim2=-1).mean(-1)[..., None, None]
    return b + 1e-9 * size * torch.eye(b.shape[-1], dtype=b.dtype)
