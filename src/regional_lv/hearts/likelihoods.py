"""What the data of one heart say of its stiffness, without the prior that it was inferred with.

A heart is inferred by itself, with a prior that is uniform within a range. In a cohort other hearts
say more of it than that prior does, which has to go: with fifty hearts it would count fifty times.
Draws u (N, P) of the logarithms of the stiffness have a density proportional to

    L(u) exp(u_1 + ... + u_P)       within the range, and 0 outside,

of which the likelihood L is sought as that of a normal distribution, exp(h' u - u' K u / 2). K may
be singular: data that say nothing of a direction add nothing to it. The moments of the draws would
not do, as they are those of the range where the data say little. Score matching gives K and h from
draws within a range, without the normalising constant (Hyvarinen 2007, doi
10.1016/j.csda.2006.09.003; Yu, Drton and Shojaie 2022, doi 10.1093/imaiai/iaaa041). It minimises

    E[ sum_j  g_j s_j^2 / 2 + d(g_j s_j)/du_j ],        s = grad log of the density,

with weights g_j that are 0 at the ends of the range. Far from these it is the fit by the moments.
"""

from typing import NamedTuple

import numpy as np

EDGE = 0.1
"""Share of the range, at either end, within which draws count less the nearer they are to it."""


class NormalLikelihood(NamedTuple):
    """log L(u) = linear @ u - u @ precision @ u / 2: linear (P,), precision (P, P), of several
    hearts (H, P) and (H, P, P). The precision is positive semi-definite."""

    linear: np.ndarray
    precision: np.ndarray

    @classmethod
    def of_draws(
        cls,
        draws: np.ndarray,
        lower: np.ndarray,
        upper: np.ndarray,
        weights: np.ndarray | None = None,
    ) -> "NormalLikelihood":
        """From posterior draws (N, P) of the stiffness, whose prior is uniform between `lower` and
        `upper` (P,); weights (N,) of the draws up to a constant, equal by default."""
        u, low, high = np.log(draws), np.log(lower), np.log(upper)
        share = np.ones(len(u)) if weights is None else weights
        share = share / share.sum()
        middle = share @ u
        scale = np.sqrt(share @ (u - middle) ** 2)
        z = (u - middle) / scale
        from_low, from_high, edge = (v / scale for v in (u - low, high - u, EDGE * (high - low)))
        inside = np.minimum(np.minimum(from_low, from_high), edge)
        turned = np.where(inside < edge, np.where(from_low < from_high, 1.0, -1.0), 0.0)
        weight, slope = share[:, None] * inside, share[:, None] * turned
        # The score s_j is x @ (row j of K, h_j).
        x = np.hstack([-z, np.ones((len(z), 1))])
        square = np.einsum("nj,na,nb->jab", weight, x, x, optimize=True)
        mean_weight, mean_slope = weight.sum(0), slope.sum(0)
        right = -slope.T @ x
        right[np.diag_indices(len(scale))] += mean_weight
        precision = np.linalg.solve(square, right[..., None])[:, :-1, 0]
        precision = _nearest((precision + precision.T) / 2)
        at = weight.T @ z
        linear = (np.einsum("jk,jk->j", precision, at) - mean_slope) / mean_weight
        precision = precision / np.outer(scale, scale)
        # About the origin, and without the prior, whose score is 1.
        return cls(linear / scale - 1.0 + precision @ middle, precision)

    @classmethod
    def stack(cls, hearts: "list[NormalLikelihood]") -> "NormalLikelihood":
        """Of several hearts."""
        linear, precision = zip(*hearts, strict=True)
        return cls(np.stack(linear), np.stack(precision))


def _nearest(matrix: np.ndarray) -> np.ndarray:
    """The nearest positive semi-definite matrix to a symmetric one."""
    values, vectors = np.linalg.eigh(matrix)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T
