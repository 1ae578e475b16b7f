"""Stationary kernels of unit variance, as functions of squared scaled distances.

A kernel sees the distances within its blocks of inputs: all inputs together, or the two of each
zone. Correlations are made for thousands of points at a time and their slopes only where they are
needed, so that the ones do not wait for the others.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch

from regional_lv import kernel as blockwise

Parts = Sequence[torch.Tensor]
"""Squared scaled distances (..., M, N), one for each block."""


class Kernel(NamedTuple):
    """blocks: slices of the inputs, by their number. value: correlations at the distances, with
    `alpha` the exponent of the rational quadratic kernels, which others ignore. slopes: from these
    correlations, distances and alpha, the slope about each of the distances."""

    blocks: Callable[[int], list[slice]]
    value: Callable[[Parts, torch.Tensor], torch.Tensor]
    slopes: Callable[[torch.Tensor, Parts, torch.Tensor], list[torch.Tensor]]


def _rq_slopes(k, parts, alpha):
    return [k * rate for rate in blockwise.rates(parts, alpha)]


def _rbf(parts, alpha):
    return torch.exp(-0.5 * parts[0])


def _rbf_slopes(k, parts, alpha):
    return [-0.5 * k]


def _matern52(parts, alpha):
    r = _matern_distance(parts)
    return (1 + r + r * r / 3) * torch.exp(-r)


def _matern52_slopes(k, parts, alpha):
    r = _matern_distance(parts)
    return [-5 / 6 * (1 + r) * torch.exp(-r)]


def _matern_distance(parts):
    # The square root has no derivative at zero, the kernel has: 0 in every direction.
    return torch.sqrt(5 * parts[0].clamp(min=1e-30))


ZONAL = "zonal_rq"
"""The product over the zones of rational quadratic kernels of their two parameters, one alpha."""

KERNELS = {
    "rq": Kernel(blockwise.one_block, blockwise.rational_quadratic, _rq_slopes),
    "rbf": Kernel(blockwise.one_block, _rbf, _rbf_slopes),
    "matern52": Kernel(blockwise.one_block, _matern52, _matern52_slopes),
    ZONAL: Kernel(blockwise.zone_blocks, blockwise.rational_quadratic, _rq_slopes),
}


def distances(kernel: str, a: torch.Tensor, b: torch.Tensor) -> list[torch.Tensor]:
    """Squared distances (..., M, N) within each block of the kernel between the rows of scaled
    inputs `a` (..., M, P) and `b` (..., N, P)."""
    blocks = KERNELS[kernel].blocks(a.shape[-1])
    return [squared_distance(a[..., part], b[..., part]) for part in blocks]


def squared_distance(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """(..., M, N) squared distances between the rows of `a` (..., M, P) and `b` (..., N, P); one
    matrix product instead of M N P differences."""
    d2 = (-2 * a) @ b.mT
    d2.add_((a * a).sum(-1)[..., :, None]).add_((b * b).sum(-1)[..., None, :])
    return d2.clamp_(min=0.0)


def correlation(kernel: str, a, b, length_scales, alpha) -> torch.Tensor:
    """(G, M, N) correlations of `a` (M, P) or (G, M, P) with `b`, one kernel of each of G: length
    scales (G, P), alpha (G,)."""
    scales = length_scales[:, None, :]
    return KERNELS[kernel].value(distances(kernel, a / scales, b / scales), alpha[:, None, None])


def mean_slopes(kernel: str, a, b, length_scales, alpha, weights) -> torch.Tensor:
    """d(k weights)/d(a), (G, M, P), of k = `correlation(a, b)` with `weights` (G, N)."""
    scales, alpha = length_scales[:, None, :], alpha[:, None, None]
    a, b = a / scales, b / scales
    parts = distances(kernel, a, b)
    k = KERNELS[kernel].value(parts, alpha)
    found = []
    blocks = KERNELS[kernel].blocks(a.shape[-1])
    for part, slope in zip(blocks, KERNELS[kernel].slopes(k, parts, alpha), strict=True):
        weighted = slope * weights[:, None, :]
        # d k_n / d a_p = 2 slope_n (a_p - b_np), both scaled
        own = weighted.sum(-1, keepdim=True) * a[..., part] - weighted @ b[..., part]
        found.append(2 * own)
    return torch.cat(found, -1) / scales
