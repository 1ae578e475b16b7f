"""Between the box of scaling factors, where the posterior lives, and a space without bounds."""

import math

import torch

WIDEST = 0.3
"""Largest width of the soft bounds, as a share of the box's width in log theta: a parameter of
which the data say nothing then has nearly Gaussian tails."""

_ROUNDS = 60


class Box:
    """log theta = log lower + w (g((v - log lower) / w) - g((v - log upper) / w)), with
    g(t) = t Phi(t) + phi(t) of the normal distribution, for v without bounds.

    In the middle of the box v is log theta; a distance w from a bound it begins to bend, and
    beyond the bound a uniform density has Gaussian tails of scale w. The slope never exceeds 1: the
    posterior is nowhere steeper in v than in log theta. A map with one width for all, such as the
    normal distribution function over the whole box, stretches the neighbourhood of a bound tenfold
    and unevenly, so that the curvature of a narrow posterior there changes by factors within
    its own width, and trajectories of one step size diverge.

    lower, upper: bounds of theta. width: w per parameter (..., 10), on the log scale.
    """

    def __init__(self, lower: float, upper: float, width: torch.Tensor):
        self.lower, self.upper = lower, upper
        self.low, self.high = math.log(lower), math.log(upper)
        span = self.high - self.low
        self.width = width.clamp(max=WIDEST * span)

    def theta(self, v: torch.Tensor) -> torch.Tensor:
        """Theta (..., 10), within the bounds."""
        return torch.exp(self._log_theta(v)).clamp(self.lower, self.upper)

    def _log_theta(self, v: torch.Tensor) -> torch.Tensor:
        # From the nearer bound, so that nothing is lost to round-off there.
        w, middle = self.width, 0.5 * (self.low + self.high)
        near, sign = torch.where(v < middle, v - self.low, self.high - v), torch.sign(middle - v)
        inside = w * (_integral(near / w) - _integral((near - (self.high - self.low)) / w))
        return torch.where(sign > 0, self.low + inside, self.high - inside)

    def log_jacobian(self, v: torch.Tensor) -> torch.Tensor:
        """log |d theta / dv| (...), summed over the parameters."""
        near = torch.minimum(v - self.low, self.high - v) / self.width
        far = near - (self.high - self.low) / self.width
        first, second = torch.special.log_ndtr(near), torch.special.log_ndtr(far)
        slope = first + torch.log1p(-torch.exp(second - first))
        return (slope + self._log_theta(v)).sum(-1)

    def position(self, theta: torch.Tensor) -> torch.Tensor:
        """v (..., 10) of `theta`; on a bound, the place two widths beyond it."""
        target = torch.log(theta)
        left = torch.full_like(target, self.low) - 2 * self.width
        right = torch.full_like(target, self.high) + 2 * self.width
        for _ in range(_ROUNDS):  # bisection: the map rises
            middle = 0.5 * (left + right)
            below = self._log_theta(middle) < target
            left, right = torch.where(below, middle, left), torch.where(below, right, middle)
        return 0.5 * (left + right)


def _integral(t: torch.Tensor) -> torch.Tensor:
    """Integral of the normal distribution function up to `t`."""
    density = torch.exp(-0.5 * t.square()) / math.sqrt(2 * math.pi)
    return t * torch.special.ndtr(t) + density
