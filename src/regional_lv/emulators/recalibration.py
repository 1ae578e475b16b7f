"""Recalibrates an emulator's variance by its errors on simulations that it has not seen.

Any emulator can use it: it needs errors and slopes of the outputs, whitened by what the emulator
says of its own errors.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from scipy import stats
from scipy.optimize import minimize
from scipy.special import gammaln

from regional_lv.emulators.gaussian import Z95

FREEDOMS = (3.0, 1e4)
"""Least and most degrees of freedom of errors with a t."""

JUDGED = 0.95
"""Intervals by which the variance is calibrated. Errors have heavier tails than a Gaussian has:
what is right for their mean square is too narrow there."""


@dataclass(frozen=True)
class Calibration:
    """What a variance is multiplied by, and the distribution of the errors.

    trend: level and power (a, b) of a factor on the variance of all errors, exp(a + b times the
    mean of log theta). freedom: nu of a multivariate t; infinite: Gaussian. factor: a further one
    on errors along the Jacobian, which makes 95 % intervals of theta right, or on all of them.
    """

    factor: float = 1.0
    trend: tuple[float, float] = (0.0, 0.0)
    freedom: float = math.inf

    def scale(self, stiffness: torch.Tensor) -> torch.Tensor:
        """Factor (...) on the variance of all errors at a mean of log theta `stiffness` (...)."""
        level, power = self.trend
        return torch.exp(level + power * stiffness)

    @classmethod
    def fit(
        cls, kind: str, errors: torch.Tensor, slopes: torch.Tensor, stiffness: torch.Tensor
    ) -> "Calibration":
        """By errors (N, D) at means of log theta `stiffness` (N,), whitened by their predicted
        covariance, and slopes (N, D, P) of the outputs with respect to the factors, whitened by it
        or a multiple of it. kind: what is fitted, as the setting `calibration` of the exact GP
        says."""
        if kind == "none":
            return cls()
        trend, freedom = (0.0, 0.0), math.inf
        if kind in ("student", "variance_trend", "intervals"):
            trend = fit_trend(errors.square().mean(1), stiffness)
        if kind == "intervals":
            alike = errors / cls(trend=trend).scale(stiffness).sqrt()[:, None]
            return cls(float(alike.abs().quantile(JUDGED) / Z95) ** 2, trend)
        moved, along, across = cls(trend=trend)._judge(errors, slopes, stiffness)
        outputs, inputs = slopes.shape[1:]
        if kind == "student" and outputs > inputs:
            freedom = fit_freedom(along, across, inputs, outputs - inputs)
        return cls(interval_factor(moved, across, freedom, outputs), trend, freedom)

    def _judge(self, errors, slopes, stiffness):
        """After the trend: errors (N, P) of the estimates in predicted sd, and the squared lengths
        (N,) of what moves them and of the rest."""
        errors = errors / self.scale(stiffness).sqrt()[:, None]
        moved, along = estimates_move(slopes, errors)
        return moved, along, errors.square().sum(1) - along

    def report(self, errors: torch.Tensor, slopes: torch.Tensor, stiffness: torch.Tensor) -> dict:
        """What an emulator's report says of it; arguments as for `fit`."""
        moved, along, across = self._judge(errors, slopes, stiffness)
        return {
            "variance_factor": self.factor,
            "variance_trend": list(self.trend),
            "freedom": self.freedom if math.isfinite(self.freedom) else None,
            "loo_squared_distance_per_output_before": float(errors.square().mean()),
            "loo_squared_distance_per_output": float((along + across).mean() / errors.shape[1]),
            "loo_squared_distance_per_parameter": float(moved.square().mean()),
        }


def estimates_move(slopes: torch.Tensor, errors: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """How far `errors` (N, D) move the estimates of theta (N, P), in predicted sd, and the squared
    length (N,) of what moves them.

    errors: whitened by their predicted covariance S. slopes: the Jacobians J (N, D, P), whitened by
    S or a multiple of it. An error along the columns of the Jacobian is what inference mistakes for
    a change of theta: the estimate moves by (J' S^-1 J)^-1 J' S^-1 e, which has the covariance
    (J' S^-1 J)^-1 if S is right.
    """
    inverse = torch.linalg.pinv(slopes)
    move = (inverse @ errors[..., None])[..., 0]
    along = (slopes @ move[..., None])[..., 0].square().sum(-1)
    return move / inverse.square().sum(-1).sqrt(), along


def fit_trend(distance: torch.Tensor, x: torch.Tensor) -> tuple[float, float]:
    """Level and power (a, b) for which errors have the variance exp(a + b x), most likely.

    distance: (N,) squared errors in units of their predicted variance, means over the outputs;
    x: (N,). Outputs count as one: errors of one simulation go together. b has a standard normal
    prior, which matters to a few dozen simulations.
    """

    def loss(ab):
        logs = ab[0] + ab[1] * x
        ratio = distance * np.exp(-logs)
        rest = 1 - ratio
        value = 0.5 * (ratio + logs).sum() + 0.5 * ab[1] ** 2
        return value, np.array([0.5 * rest.sum(), 0.5 * (rest * x).sum() + ab[1]])

    distance, x = distance.numpy(), x.numpy()
    found = minimize(loss, [np.log(distance.mean()), 0.0], jac=True, method="L-BFGS-B")
    level, power = found.x
    return float(level), float(power)


def fit_freedom(along: torch.Tensor, across: torch.Tensor, inputs: int, others: int) -> float:
    """Degrees of freedom of a t with which squared errors `across` (N,), of `others` directions,
    tell most of those `along` (N,) that theta moves the outputs (`inputs` directions).

    Given the ones, the others have a t with nu + `others` degrees of freedom, and the scale
    (nu + across) / (nu + others) (Ding 2016, doi 10.1080/00031305.2016.1164756); a common factor on
    it is fitted beside nu.
    """
    along, across = along.numpy(), across.numpy()

    def loss(logs):
        nu, factor = np.exp(logs)
        n = nu + others
        scaled = factor * (nu + across)  # n times the scale
        constant = gammaln((n + inputs) / 2) - gammaln(n / 2)
        lost = 0.5 * inputs * np.log(scaled) + 0.5 * (n + inputs) * np.log1p(along / scaled)
        return (lost - constant).mean()

    bounds = [tuple(np.log(FREEDOMS)), (-3.0, 3.0)]
    found = minimize(loss, [math.log(10.0), 0.0], method="L-BFGS-B", bounds=bounds)
    return float(np.exp(found.x[0]))


def interval_factor(
    moved: torch.Tensor, across: torch.Tensor, freedom: float, outputs: int
) -> float:
    """Factor f >= 1 on the variance of errors along the Jacobian for which `JUDGED` intervals of
    theta hold that share of the estimates' errors.

    moved: (N, P) errors of the estimates, in predicted sd; across: (N,) squared length of the
    errors that no theta explains; freedom: nu of the errors' t, in `outputs` directions (D). To
    first order theta has a t with n = nu + D - P degrees of freedom and the squared scale
    f (nu + across) / n, in units of the predicted variance; of Gaussian errors the variance f
    (`likelihood.inflate`).
    """
    share, inputs = 0.5 + 0.5 * JUDGED, moved.shape[1]
    if math.isinf(freedom):
        half_width = stats.norm.ppf(share)
    else:
        n = freedom + max(outputs - inputs, 0)
        moved = moved / ((freedom + across) / n).sqrt()[:, None]
        half_width = stats.t.ppf(share, n)
    return max(1.0, float(moved.abs().quantile(JUDGED) / half_width) ** 2)
