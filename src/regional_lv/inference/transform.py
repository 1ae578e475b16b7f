"""Between bounded parameters, where posteriors live, and a space without bounds."""

import math

import torch

WIDEST = 0.3
"""Largest width of the soft bounds, as a share of the range: a parameter of which the data say
nothing then has nearly Gaussian tails."""

BEYOND = 2.5
"""Where a value on a bound is put, in widths beyond it: it comes back to within a hundredth."""

_ROUNDS = 60


class BoundedTransform:
    """s(v) = low + w (g((v - low) / w) - g((v - high) / w)), within [low, high] for any v.

    g(t) = t Phi(t) + phi(t) of the normal distribution. In the middle of the range v is s. A
    distance w from a bound v begins to bend, and beyond the bound a uniform density of s has
    Gaussian tails of scale w. The slope never exceeds 1: a posterior is nowhere steeper in v than
    in s. A map with one width for all, such as the logistic function over the whole range,
    stretches the neighbourhood of a bound tenfold and unevenly, so that the curvature of a narrow
    posterior there changes by factors within its own width.

    low, high (P,); width: w per parameter (..., P).
    """

    def __init__(self, low: torch.Tensor, high: torch.Tensor, width: torch.Tensor):
        self.low, self.high = low, high
        self.width = torch.minimum(width, WIDEST * (high - low))

    def constrain(self, v: torch.Tensor) -> torch.Tensor:
        """s (..., P), within the bounds."""
        # From the nearer bound, so that nothing is lost to round-off there.
        w, middle = self.width, 0.5 * (self.low + self.high)
        near, sign = torch.where(v < middle, v - self.low, self.high - v), torch.sign(middle - v)
        inside = w * (_integral(near / w) - _integral((near - (self.high - self.low)) / w))
        return torch.where(sign > 0, self.low + inside, self.high - inside)

    def log_slope(self, v: torch.Tensor) -> torch.Tensor:
        """log ds/dv (..., P)."""
        near = torch.minimum(v - self.low, self.high - v) / self.width
        far = near - (self.high - self.low) * self.width.reciprocal()
        first, second = torch.special.log_ndtr(near), torch.special.log_ndtr(far)
        return first + torch.log1p(-torch.exp(second - first))

    def unconstrain(self, s: torch.Tensor) -> torch.Tensor:
        """v (..., P) of `s`; on a bound, the place `BEYOND` widths beyond it."""
        left, right = self.low - BEYOND * self.width, self.high + BEYOND * self.width
        for _ in range(_ROUNDS):  # bisection: the map rises
            middle = 0.5 * (left + right)
            below = self.constrain(middle) < s
            left, right = torch.where(below, middle, left), torch.where(below, right, middle)
        return 0.5 * (left + right)


def _integral(t: torch.Tensor) -> torch.Tensor:
    """Integral of the normal distribution function up to `t`."""
    density = torch.exp(-0.5 * t.square()) / math.sqrt(2 * math.pi)
    return t * torch.special.ndtr(t) + density
