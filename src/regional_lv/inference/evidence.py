"""Fits of many models at once, and the evidence of each by Laplace's approximation in its box.

About a fit the log density is a quadratic form, and the evidence the integral of its exponential
over the ranges: also where the density rises beyond the end of one, or is flat.
"""

from dataclasses import dataclass, fields

import numpy as np
import torch

from regional_lv.emulators.gaussian import LOG_2PI
from regional_lv.inference.optimise import maximise
from regional_lv.inference.potential import Potential, Quadratic

WEAK = 1e-6
"""Least precision of a coordinate, in units of its range: an sd of a thousand ranges."""

SWEEPS, SETTLED, DAMPING = 40, 1e-4, 0.8
"""Of expectation propagation: sweeps, the change of means, in sds, at which they end, and what
share of a change each makes."""

STEPS_PER_RANGE = 2.0
"""Longest steps of a fit that fit into a range."""

TOGETHER = 1024
"""Models of one heart that are fitted at a time, for the memory's sake; of several hearts fewer."""

NEGLIGIBLE = 40.0
"""Log density, below the largest of a box, that quadrature leaves out."""

_NODES, _WEIGHTS = map(torch.as_tensor, np.polynomial.legendre.leggauss(40))


@dataclass(frozen=True)
class Fits:
    """M models at their fits.

    free (M, P): the coordinates that are free. amplitude (M,): of a smooth departure. x (M, P).
    error (M or 1, ...): the emulator's covariance there (`Potential`). gradient (M, P), curvature
    (M, P, P): of the log density about all coordinates. log_evidence (M,). mean (M, P), covariance
    (M, P, P): of the normal distribution that resembles the posterior in its box, zero where
    nothing is free.
    """

    free: torch.Tensor
    amplitude: torch.Tensor
    x: torch.Tensor
    error: torch.Tensor
    gradient: torch.Tensor
    curvature: torch.Tensor
    log_evidence: torch.Tensor
    mean: torch.Tensor
    covariance: torch.Tensor

    def __len__(self) -> int:
        return len(self.x)

    def row(self, m: int) -> "Fits":
        """One of them (M = 1)."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return Fits(**{k: of_row(v, slice(m, m + 1)).clone() for k, v in values.items()})

    @classmethod
    def join(cls, parts: list["Fits"]) -> "Fits":
        """All models of several."""
        columns = {field.name: [getattr(p, field.name) for p in parts] for field in fields(cls)}
        columns["error"] = [
            e.expand(len(p), *e.shape[1:]) for e, p in zip(columns["error"], parts, strict=True)
        ]
        return cls(**{name: torch.cat(column) for name, column in columns.items()})


def of_row(values: torch.Tensor, rows) -> torch.Tensor:
    """Rows of values (M, ...), or all of them (1, ...) where they are common to all rows."""
    return values if len(values) == 1 else values[rows]


def fit(
    potential: Potential,
    free: torch.Tensor,
    amplitude: torch.Tensor,
    start: torch.Tensor,
    error: torch.Tensor,
    iterations: int,
    least_gain: float,
) -> Fits:
    """Fit M models by Levenberg and Marquardt's method within their ranges (`maximise`).

    free (M, P), amplitude (M,): of the models. start (M, P). error (M or 1, ...): covariance of the
    emulator that the fits keep (`Potential`); it is taken anew where they end.
    """
    most = max(1, TOGETHER // potential.observed.count)
    if len(start) > most:
        parts = torch.arange(len(start)).split(most)
        rows = [(free[at], amplitude[at], start[at], of_row(error, at)) for at in parts]
        return Fits.join([fit(potential, *each, iterations, least_gain) for each in rows])
    unit = potential.width / STEPS_PER_RANGE
    low, high = (torch.where(free, end, start) / unit for end in (potential.low, potential.high))
    slopes = start.new_empty(len(start), len(potential.y), len(potential.inputs))

    def value(rows, u):
        x = u * unit
        return potential.log_density(potential.mean(x), x, of_row(error, rows))

    def derivatives(rows, u):
        x = u * unit
        means, slopes[rows] = potential.linearise(x)
        found = potential.quadratic(means, slopes[rows], x, of_row(error, rows))
        gradient, curvature = _restricted(found.gradient * unit, found.curvature, free[rows])
        return gradient, curvature * unit[:, None] * unit

    u, _, _ = maximise(value, derivatives, start / unit, low, high, iterations, least_gain)
    x = torch.minimum(torch.maximum(u * unit, potential.low), potential.high)
    x = torch.where(free, x, start)  # to the last digit
    # The last step may have been too short for slopes of its own.
    means, error = potential.predict(x, amplitude)
    found = potential.quadratic(means, slopes, x, error)
    normal = laplace(potential, free, x, found)
    return Fits(free, amplitude, x, error, found.gradient, found.curvature, *normal)


def _restricted(gradient, curvature, free):
    """With zero where a coordinate is not free."""
    both = free[:, :, None] & free[:, None, :]
    return torch.where(free, gradient, 0.0), torch.where(both, curvature, 0.0)


def held_at_ends(potential: Potential, free, x, gradient) -> torch.Tensor:
    """Mask (M, P) of free coordinates at an end beyond which the density rises."""
    outwards = ((x <= potential.low) & (gradient < 0)) | ((x >= potential.high) & (gradient > 0))
    return free & outwards


def laplace(
    potential: Potential, free: torch.Tensor, x: torch.Tensor, found: Quadratic
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Log evidence (M,) of models `free` (M, P) from the quadratic form at their maxima x (M, P),
    and mean (M, P) and covariance (M, P, P) of the posterior."""
    width = potential.width
    gradient, curvature = _restricted(found.gradient, found.curvature, free)
    # Inside the box a maximum has no slope but what is left of the search for it.
    held = held_at_ends(potential, free, x, gradient)
    slope = torch.where(held, gradient * width, 0.0)
    # The integral over what is not free is one.
    precision = curvature * width[:, None] * width
    precision = precision + torch.diag_embed(torch.where(free, 0.0, 2 * torch.pi))
    ends = (
        torch.where(free, (end - x) / width, sign * torch.inf)
        for end, sign in ((potential.low, -1), (potential.high, 1))
    )
    log_integral, mean, covariance = integrate(slope, precision, *ends)
    scale = torch.where(free, width, 0.0)
    log_evidence = (
        found.value
        + potential.log_uniform(free)
        + torch.where(free, width.log(), 0.0).sum(-1)
        + log_integral
    )
    return log_evidence, x + mean * scale, covariance * scale[:, :, None] * scale[:, None, :]


def integrate(
    slope: torch.Tensor, precision: torch.Tensor, low: torch.Tensor, high: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Log integrals (M,) of exp(g'd - d'Hd / 2) over boxes of d, and mean (M, P) and covariance
    (M, P, P) of d there.

    slope g (M, P), precision H (M, P, P); low, high (M, P), infinite where there is no end.

    By expectation propagation: the ends of each coordinate are replaced by a normal factor that
    leaves its mean and variance as they are within the ends (Minka 2001; of boxes: Cunningham,
    Hennig and Lacoste-Julien 2011, arXiv:1111.6832). Exact for one coordinate, or for independent
    ones.
    """
    bounded = torch.isfinite(high - low)
    # At first the factor of a uniform distribution between the ends.
    factor = torch.where(bounded, 12 / (high - low).square(), 0.0)
    pull = torch.where(bounded, factor * (low + high) / 2, 0.0)
    mean = torch.full_like(slope, torch.inf)
    for sweep in range(SWEEPS):
        half = torch.linalg.cholesky(precision + torch.diag_embed(factor))
        covariance = torch.cholesky_inverse(half)
        before, mean = mean, (covariance @ (slope + pull)[..., None])[..., 0]
        variance = covariance.diagonal(dim1=-2, dim2=-1)
        others = (1 / variance - factor).clamp(min=WEAK)
        centre, spread = (mean / variance - pull) / others, 1 / others
        log_mass, inside, left = cut(centre, spread, low, high)
        settled = ((mean - before).abs() < SETTLED * variance.sqrt()).all()
        if settled or sweep == SWEEPS - 1:
            break
        wanted = (1 / left - others).clamp(min=0.0)
        factor = factor + DAMPING * (wanted - factor)
        pull = pull + DAMPING * (inside / left - centre * others - pull)
    own = 1 + factor * spread
    replaced = (pull.square() * spread + 2 * pull * centre - factor * centre.square()) / own
    log_integral = (
        (log_mass + 0.5 * own.log() - 0.5 * replaced).sum(-1)
        + 0.5 * ((slope + pull) * mean).sum(-1)
        + 0.5 * LOG_2PI * slope.shape[1]
        - half.diagonal(dim1=-2, dim2=-1).log().sum(-1)
    )
    return log_integral, mean, covariance


def cut(
    mean: torch.Tensor, variance: torch.Tensor, low: torch.Tensor, high: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Log probability (...) of intervals under normal distributions, and mean and variance within.

    By Gauss and Legendre's quadrature over what counts: nothing is lost far out in a tail, or where
    the interval is a small part of an sd.
    """
    sd = variance.sqrt()
    a, b = (low - mean) / sd, (high - mean) / sd
    mode = torch.minimum(torch.maximum(torch.zeros_like(a), a), b)
    root = (mode.square() + 2 * NEGLIGIBLE).sqrt()
    below, above = (2 * NEGLIGIBLE / ((sign * mode).clamp(min=0) + root) for sign in (-1, 1))
    first, last = torch.maximum(a - mode, -below), torch.minimum(b - mode, above)
    half = (last - first)[..., None] / 2
    t = first[..., None] + half * (_NODES + 1)
    logs = -t * (mode[..., None] + t / 2) + (half * _WEIGHTS).log()
    log_mass = torch.logsumexp(logs, -1)
    weight = torch.exp(logs - log_mass[..., None])
    centre = (weight * t).sum(-1)
    left = (weight * (t - centre[..., None]).square()).sum(-1)
    log_mass = log_mass - 0.5 * (mode.square() + LOG_2PI)
    return log_mass, mean + sd * (mode + centre), variance * left
