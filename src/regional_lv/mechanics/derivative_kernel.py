"""The rational quadratic kernel and its derivatives, for NumPy arrays.

With a length scale per input, and the inputs in blocks b,

    k(x, x') = prod_b (1 + r_b^2 / (2 alpha))^(-alpha),
    r_b^2 = sum_{d in b} ((x_d - x'_d) / l_d)^2.

One block of all inputs is the usual kernel. With a block for the factors of each of the ventricle's
zones (`StiffnessInputs.blocks`), functions of one zone and their products come cheaper: what a
zone's stiffness does depends on that of the others, but smoothly. The covariances of derivatives
are derivatives of k (Rasmussen and Williams 2006, section 9.4, ISBN 026218253X). Observations are
ordered values first, then the derivative along each input in turn: (1 + d) n rows.
"""

import math
from collections.abc import Sequence

import numpy as np


def rational_quadratic(bases: Sequence[np.ndarray], alpha: float) -> np.ndarray:
    """k (...) of 1 + r_b^2 / (2 alpha) (...), one of `bases` for each block."""
    return np.exp(-alpha * np.log(math.prod(bases[1:], start=bases[0])))


def rates(bases: Sequence[np.ndarray]) -> list[np.ndarray]:
    """f_b = d(log k)/d(r_b^2) (...) for each of the blocks; its own derivative is f_b^2 / alpha."""
    return [-0.5 / base for base in bases]


def joint_covariance(
    x: np.ndarray, y: np.ndarray, lengthscales: np.ndarray, alpha: float, blocks: Sequence[slice]
) -> np.ndarray:
    """Covariance ((1 + d) n, (1 + d) m) of values and gradients at `x` (n, d) with those at `y`.

    `lengthscales` (d,) and `alpha` are positive; `blocks` are slices that share out the d inputs,
    in their order.
    """
    parts = (covariance_with_values, covariance_with_gradients)
    return np.concatenate([part(x, y, lengthscales, alpha, blocks) for part in parts], 1)


def covariance_with_values(
    x: np.ndarray, y: np.ndarray, lengthscales: np.ndarray, alpha: float, blocks: Sequence[slice]
) -> np.ndarray:
    """Covariance ((1 + d) n, m) of values and gradients at `x` (n, d) with the values at `y`."""
    gap, value, rate, block = _derivatives(x, y, lengthscales, alpha, blocks)
    slopes = [2 * value * rate[block[j]] * gap[..., j] for j in range(x.shape[1])]
    return np.concatenate([value, *slopes], 0)


def covariance_with_gradients(
    x: np.ndarray, y: np.ndarray, lengthscales: np.ndarray, alpha: float, blocks: Sequence[slice]
) -> np.ndarray:
    """Covariance ((1 + d) n, d m) of values and gradients at `x` (n, d) with the gradients at
    `y` (m, d)."""
    d = x.shape[1]
    gap, value, rate, block = _derivatives(x, y, lengthscales, alpha, blocks)
    # d(log k)/dx_j, and minus d(log k)/dy_j
    slope = [2 * rate[block[j]] * gap[..., j] for j in range(d)]
    rows = [np.concatenate([-value * slope[j] for j in range(d)], 1)]
    for i in range(d):
        second = [slope[i] * slope[j] for j in range(d)]
        for j in range(d):
            if block[j] == block[i]:
                second[j] = second[j] + slope[i] * slope[j] / alpha
        second[i] = second[i] + 2 * rate[block[i]] / lengthscales[i] ** 2
        rows.append(np.concatenate([-value * part for part in second], 1))
    return np.concatenate(rows, 0)


def _derivatives(x, y, lengthscales, alpha, blocks):
    """Gaps over squared length scales (n, m, d), k (n, m), its rates, the number of each input's
    block."""
    gap = (x[:, None, :] - y[None, :, :]) / lengthscales
    bases = [1 + (gap[..., part] ** 2).sum(-1) / (2 * alpha) for part in blocks]
    block = [b for b, part in enumerate(blocks) for _ in range(part.start, part.stop)]
    return gap / lengthscales, rational_quadratic(bases, alpha), rates(bases), block
