"""Stationary kernels of unit variance, as functions of squared scaled distances.

A kernel sees the distances within its blocks of inputs: all inputs together, or the factors of each
zone. Correlations are made for thousands of points at a time and their slopes only where they are
needed, so that the ones do not wait for the others.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch

from regional_lv import derivative_kernel
from regional_lv.parameters import Parameterisation

Parts = Sequence[torch.Tensor]
"""What a kernel is a function of (..., M, N), for each block: the squared scaled distance d2, or
for the rational quadratic ones 1 + d2 / (2 alpha)."""


class Kernel(NamedTuple):
    """parts: from a block's scaled inputs (..., M, P) and (..., N, P) and from `alpha`, the
    exponent of the rational quadratic kernels, which others ignore. value: correlations at the
    parts. slopes: from these correlations and the parts, the slope about each d2. zonal: whether
    every zone is a block of its own; otherwise all inputs are one."""

    parts: Callable[[torch.Tensor, torch.Tensor, torch.Tensor], torch.Tensor]
    value: Callable[[Parts, torch.Tensor], torch.Tensor]
    slopes: Callable[[torch.Tensor, Parts], list[torch.Tensor]]
    zonal: bool = False


def _squared_distance(a, b, alpha):
    # One matrix product instead of M N P differences.
    d2 = (-2 * a) @ b.mT
    d2.add_((a * a).sum(-1)[..., :, None]).add_((b * b).sum(-1)[..., None, :])
    return d2.clamp_(min=0.0)


def _rq_part(a, b, alpha):
    # 1 + |a - b|^2 / (2 alpha) as one matrix product: (1 + |a|^2) 1 + 1 |b|^2 - 2 a b'
    scale = (2 * alpha) ** -0.5
    a, b = a * scale, b * scale
    one_a, one_b = torch.ones_like(a[..., :1]), torch.ones_like(b[..., :1])
    left = torch.cat([-2 * a, 1 + (a * a).sum(-1, keepdim=True), one_a], -1)
    right = torch.cat([b, one_b, (b * b).sum(-1, keepdim=True)], -1)
    return left @ right.mT


def _rq_slopes(k, parts):
    return [k * rate for rate in derivative_kernel.rates(parts)]


def _rbf(parts, alpha):
    return torch.exp(-0.5 * parts[0])


def _rbf_slopes(k, parts):
    return [-0.5 * k]


def _matern52(parts, alpha):
    r = _matern_distance(parts)
    return (1 + r + r * r / 3) * torch.exp(-r)


def _matern52_slopes(k, parts):
    r = _matern_distance(parts)
    return [-5 / 6 * (1 + r) * torch.exp(-r)]


def _matern_distance(parts):
    # The square root has no derivative at zero, the kernel has: 0 in every direction.
    return torch.sqrt(5 * parts[0].clamp(min=1e-30))


ZONAL = "zonal_rq"
"""The product over the zones of rational quadratic kernels of their factors, one alpha."""

KERNELS = {
    "rq": Kernel(_rq_part, derivative_kernel.rational_quadratic, _rq_slopes),
    "rbf": Kernel(_squared_distance, _rbf, _rbf_slopes),
    "matern52": Kernel(_squared_distance, _matern52, _matern52_slopes),
    ZONAL: Kernel(_rq_part, derivative_kernel.rational_quadratic, _rq_slopes, zonal=True),
}

Blocks = Sequence[slice]
"""Slices that share out the P inputs, in their order."""


def blocks_of(kernel: str, parameters: Parameterisation) -> Blocks:
    """The blocks that a kernel of the parameters has."""
    return parameters.blocks if KERNELS[kernel].zonal else one_block(len(parameters))


def one_block(inputs: int) -> Blocks:
    """All inputs together."""
    return [slice(0, inputs)]


def parts_of(
    kernel: str, a: torch.Tensor, b: torch.Tensor, alpha, blocks: Blocks
) -> list[torch.Tensor]:
    """What the kernel is a function of, between the rows of scaled inputs `a` (..., M, P) and `b`
    (..., N, P)."""
    of = KERNELS[kernel]
    return [of.parts(a[..., part], b[..., part], alpha) for part in blocks]


def correlation(kernel: str, a, b, length_scales, alpha, blocks: Blocks | None = None):
    """(G, M, N) correlations of `a` (M, P) or (G, M, P) with `b`, one kernel of each of G: length
    scales (G, P), alpha (G,). blocks: None for all inputs together."""
    scales, alpha = length_scales[:, None, :], alpha[:, None, None]
    blocks = blocks or one_block(a.shape[-1])
    return KERNELS[kernel].value(parts_of(kernel, a / scales, b / scales, alpha, blocks), alpha)


def mean_slopes(kernel: str, a, b, length_scales, alpha, weights, blocks: Blocks | None = None):
    """d(k weights)/d(a), (G, M, P), of k = `correlation(a, b)` with `weights` (G, N)."""
    of, scales, alpha = KERNELS[kernel], length_scales[:, None, :], alpha[:, None, None]
    blocks = blocks or one_block(a.shape[-1])
    a, b = a / scales, b / scales
    parts = parts_of(kernel, a, b, alpha, blocks)
    slopes, found = of.slopes(of.value(parts, alpha), parts), []
    for part, slope in zip(blocks, slopes, strict=True):
        weighted = slope * weights[:, None, :]
        # d k_n / d a_p = 2 slope_n (a_p - b_np), both scaled
        own = weighted.sum(-1, keepdim=True) * a[..., part] - weighted @ b[..., part]
        found.append(2 * own)
    return torch.cat(found, -1) / scales
