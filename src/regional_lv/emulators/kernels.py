"""Stationary kernels of unit variance, as functions of the squared scaled distance."""

import torch

from regional_lv import kernel as blockwise

# Each gives the correlation and its slope with respect to the squared scaled distance d2; `alpha`
# is the exponent of the rational quadratic kernel, which the others ignore.


def _rq(d2, alpha):
    u = 1 + d2 / (2 * alpha)
    k = u**-alpha
    return k, -0.5 * k / u


def _rbf(d2, alpha):
    k = torch.exp(-0.5 * d2)
    return k, -0.5 * k


def _matern52(d2, alpha):
    # The square root has no derivative at zero, the kernel has: 0 in every direction.
    r = torch.sqrt(5 * d2.clamp(min=1e-30))
    decay = torch.exp(-r)
    return (1 + r + r * r / 3) * decay, -5 / 6 * (1 + r) * decay


KERNELS = {"rq": _rq, "rbf": _rbf, "matern52": _matern52}
ZONAL = "zonal_rq"
"""The product over the zones of rational quadratic kernels of their two parameters, one alpha."""


def blocks(kernel: str, inputs: int) -> list[slice]:
    """The inputs whose squared distance the kernel takes together: all, or those of each zone."""
    return (blockwise.zone_blocks if kernel == ZONAL else blockwise.one_block)(inputs)


def block_distances(kernel: str, a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Squared distances (B, M, N) within each block of the kernel, of scaled `a` (M, P), `b`."""
    parts = blocks(kernel, a.shape[1])
    return torch.stack([squared_distance(a[:, part], b[:, part]) for part in parts])


def correlation_and_slopes(kernel: str, d2: torch.Tensor, alpha) -> tuple[torch.Tensor, ...]:
    """Correlations (M, N) at `block_distances` (B, M, N), and their slopes (B, M, N) about them."""
    if kernel == ZONAL:
        value, rate, _ = blockwise.rational_quadratic(d2, alpha)
        return value, value * rate
    value, slope = KERNELS[kernel](d2[0], alpha)
    return value, slope[None]


def squared_distance(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """(..., M, N) squared distances between the rows of `a` (..., M, P) and `b` (..., N, P); one
    matrix product instead of M N P differences."""
    d2 = (a * a).sum(-1)[..., :, None] + (b * b).sum(-1)[..., None, :] - 2 * (a @ b.mT)
    return d2.clamp_(min=0.0)


def correlation(kernel: str, a, b, length_scales, alpha) -> torch.Tensor:
    """(G, M, N) correlations of `a` (M, P) or (G, M, P) with `b`, one kernel of each of G: length
    scales (G, P), alpha (G,)."""
    scales = length_scales[:, None, :]
    return KERNELS[kernel](squared_distance(a / scales, b / scales), alpha[:, None, None])[0]


def mean_slopes(kernel: str, a, b, length_scales, alpha, weights) -> torch.Tensor:
    """d(k weights)/d(a), (G, M, P), of k = `correlation(a, b)` with `weights` (G, N)."""
    scales = length_scales[:, None, :]
    a, b = a / scales, b / scales
    _, slope = KERNELS[kernel](squared_distance(a, b), alpha[:, None, None])
    weighted = slope * weights[:, None, :]
    # d k_n / d a_p = 2 slope_n (a_p - b_np), both scaled
    return 2 * (weighted.sum(-1, keepdim=True) * a - weighted @ b) / scales
