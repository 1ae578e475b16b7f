"""Between bounded parameters, where posteriors live, and a space without bounds."""

import math

import torch

WIDEST = 0.3
"""Largest width of the soft bounds, as a share of the range: a parameter of which the data say
nothing then has nearly Gaussian tails."""

POWER = 0.5
"""Of theta in the space without bounds. Posteriors of noisy hearts are nearly Gaussian there: their
skewness (the sum of squares of all third cumulants, whitened) is 6 with 4 for that of the sample,
and 23 about log theta, where the ridges between the two factors of a zone bend."""

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


class ThetaTransform:
    """The `BoundedTransform` of (theta^p - 1) / p (Box and Cox 1964) with p = `POWER`.

    lower, upper: bounds (P,) of theta. width: that of the soft bounds (..., P), in theta^p / p.
    """

    def __init__(self, lower: torch.Tensor, upper: torch.Tensor, width: torch.Tensor):
        self.lower, self.upper = lower, upper
        self.bounded = BoundedTransform(_scaled(lower), _scaled(upper), width)

    @classmethod
    def around(cls, theta: torch.Tensor, weight: torch.Tensor, emulator) -> "ThetaTransform":
        """With soft bounds as wide as draws `theta` (N, P) of normalised `weight` (N,) are."""
        scaled = _scaled(theta)
        spread = (weight @ (scaled - weight @ scaled).square()).sqrt()
        return cls(emulator.lower, emulator.upper, spread)

    def constrain(self, v: torch.Tensor) -> torch.Tensor:
        """Theta (..., P), within the bounds."""
        return torch.exp(self._log_theta(v)).clamp(self.lower, self.upper)

    def _log_theta(self, v: torch.Tensor) -> torch.Tensor:
        return torch.log1p(POWER * self.bounded.constrain(v)) / POWER

    def constrain_with_log_det(self, v: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Theta (..., P), and log |d theta / dv| (...), summed over the parameters."""
        log_theta = self._log_theta(v)
        theta = torch.exp(log_theta).clamp(self.lower, self.upper)
        return theta, (self.bounded.log_slope(v) + (1 - POWER) * log_theta).sum(-1)

    def unconstrain(self, theta: torch.Tensor) -> torch.Tensor:
        """v (..., P) of `theta`."""
        return self.bounded.unconstrain(_scaled(theta))


def _scaled(theta: torch.Tensor) -> torch.Tensor:
    return (theta**POWER - 1) / POWER


def _integral(t: torch.Tensor) -> torch.Tensor:
    """Integral of the normal distribution function up to `t`."""
    density = torch.exp(-0.5 * t.square()) / math.sqrt(2 * math.pi)
    return t * torch.special.ndtr(t) + density
