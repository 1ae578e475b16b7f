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

from collections.abc import Sequence

import numpy as np


def joint_covariance(
    x: np.ndarray, y: np.ndarray, lengthscales: np.ndarray, alpha: float, blocks: Sequence[slice]
) -> np.ndarray:
    """Covariance ((1 + d) n, (1 + d) m) of values and gradients at `x` (n, d) with those at `y`.

    `lengthscales` (d,) and `alpha` are positive; `blocks` are slices that share out the d inputs,
    in their order.
    """
    gap = np.moveaxis((x[:, None] - y) / lengthscales, -1, 0)
    bases = np.stack([1 + (gap[part] ** 2).sum(0) / (2 * alpha) for part in blocks])
    value = np.exp(-alpha * np.log(bases.prod(0)))
    block = np.repeat(np.arange(len(blocks)), [part.stop - part.start for part in blocks])
    # d(log k)/dx is rate * gap / lengthscale, and minus that about y.
    rate = -1 / bases[block]
    slope = rate * gap / lengthscales[:, None, None]
    rows = [np.concatenate([value, *(-value * slope)], 1)]
    for i, lengthscale in enumerate(lengthscales):
        second = slope[i] * slope * (1 + (block == block[i]) / alpha)[:, None, None]
        second[i] += rate[i] / lengthscale**2
        rows.append(np.concatenate([value * slope[i], *(-value * second)], 1))
    return np.concatenate(rows)
