"""Between theta and the space without bounds in which it is sampled."""

import torch

from regional_lv.inference.transform import BoundedTransform

POWER = 0.5
"""Of theta in the space without bounds. Posteriors of noisy hearts are nearly Gaussian there: their
skewness (the sum of squares of all third cumulants, whitened) is 6 with 4 for that of the sample,
and 23 about log theta, where the ridges between the two factors of a zone bend."""


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
