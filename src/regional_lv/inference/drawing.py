"""Weighted draws and the evidence of one model, by importance sampling about its fit.

Where outputs are linear in the inputs, these have a normal posterior given the scales of the noise,
whose width goes with the scales. In coordinates that are counted from its mean in its standard
deviations the posterior is the same for all scales, and scales that are hardly known leave no
funnel (Papaspiliopoulos, Roberts and Skold 2007, doi 10.1214/088342307000000014).

Measured inputs, of which a geometry has dozens, are proposed given the others, by the outputs'
derivatives there. By those at the fit, each would be proposed almost rightly, but all together
far from the fit only rarely: few draws would carry what there is of the tails, and posteriors would
come out too narrow (by a sixth with 34 measured inputs, beside Hamiltonian Monte Carlo) without
their effective sample size saying so.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch

from regional_lv.inference import importance
from regional_lv.inference.evidence import Fits, fit
from regional_lv.inference.potential import Potential
from regional_lv.inference.transform import BoundedTransform

ROUNDS, MOST_ROUNDS, EFFICIENCY = 4, 8, 0.2
"""Rounds of proposals of one distribution; rounds at most; and effective draws that suffice, as a
share of those of a round: a normal posterior in thirty dimensions has 0.3, in ten 0.6."""

SPREAD = 1.2
"""Of the covariance of the first proposal over that of the posterior as it is expected."""

LARGEST_SD = 3.0
"""Of a proposal, in standard deviations of the posterior as it is expected."""

LEAST_ESS = 50.0
"""Effective draws with which an evidence by sampling counts."""

SCALES, SETTLING = 300, 2
"""Draws of the scales of the noise in the linear model, to find out where they are; how often."""

SLOPES_OF = 4
"""Places, for each coefficient, at which derivatives are taken that are interpolated."""

ITERATIONS, LEAST_GAIN = 60, 1e-5
"""Of the fit of a model that is sampled."""


@dataclass(frozen=True)
class WeightedDraws:
    """Weighted draws of one model: coordinates x (N, P), normalised Pareto-smoothed `weight` (N,);
    log evidence and its standard error, effective sample size, and shape of the weights' tail (NaN
    where these are even). Draws of an approximation have an infinite error. The evidence is that
    with the emulator's covariance at every draw, or with that at the fit (`sample`)."""

    x: torch.Tensor
    weight: torch.Tensor
    log_evidence: float
    evidence_error: float
    ess: float
    pareto_k: float

    @property
    def reliable(self) -> bool:
        """Whether its evidence counts."""
        enough = self.ess >= LEAST_ESS and np.isfinite(self.evidence_error)
        return enough and importance.is_light(self.ess, len(self.x), self.pareto_k)


def fit_to_the_end(potential: Potential, start: Fits) -> Fits:
    """Models with the emulator's covariance where they start, until nothing is gained."""
    models = start.free, start.amplitude, start.x, start.error
    return fit(potential, *models, ITERATIONS, LEAST_GAIN)


def approximate(potential: Potential, fitted: Fits, draws: int, seed: int) -> WeightedDraws:
    """Draws of the normal distribution that resembles a model (M = 1), reflected at the ends of its
    ranges."""
    generator = torch.Generator().manual_seed(seed)
    free, x = fitted.free[0], fitted.x.repeat(draws, 1)
    factor = torch.linalg.cholesky(fitted.covariance[0][free][:, free])
    deviates = torch.randn(draws, len(factor), generator=generator, dtype=x.dtype)
    x[:, free] = fitted.mean[0, free] + deviates @ factor.mT
    x = potential.low + (x - potential.low).abs()
    x = potential.high - (potential.high - x).abs()
    x = torch.maximum(x, potential.low)  # of what lies a whole range beyond the other end
    weight = torch.full((draws,), 1 / draws, dtype=x.dtype)
    return WeightedDraws(x, weight, float(fitted.log_evidence), np.inf, float(draws), np.nan)


def sample(potential: Potential, fitted: Fits, draws: int, seed: int) -> WeightedDraws:
    """Sample one model (M = 1) by importance, `draws` a round.

    They are proposed for the emulator's covariance at the fit, and weighted with that at every
    draw. A model that misses the data is drawn to where the emulator is least certain; where that
    leaves no reliable draws, the covariance at the fit counts.
    """
    generator = torch.Generator().manual_seed(seed)
    coordinates = Standardised(potential, fitted, generator)
    uniform = float(potential.log_uniform(fitted.free))
    made = []

    def log_density(v):
        x, slope = coordinates.constrain_with_log_det(v)
        mean, own = potential.predict(x, fitted.amplitude)
        value, by_own = (potential.log_density(mean, x, error) for error in (fitted.error, own))
        made.append((x, torch.nan_to_num(by_own - value, nan=-torch.inf, neginf=-torch.inf)))
        return value + uniform + slope

    found = importance.sample(
        lambda v: torch.cat([log_density(part) for part in v.split(potential.chunk)]),
        coordinates.mean,
        SPREAD * coordinates.covariance,
        draws,
        generator,
        rounds=ROUNDS,
        most_rounds=MOST_ROUNDS,
        least_ess=EFFICIENCY * draws,
        largest_sd=LARGEST_SD,
        normal=coordinates.measured,
    )
    # The last ones that were made are those that count.
    x, change = (torch.cat(each)[-len(found.u) :] for each in zip(*made, strict=True))
    weighted = _drawn(x, replace(found, log_weight=found.log_weight + change))
    return weighted if weighted.reliable else _drawn(x, found)


def _drawn(x: torch.Tensor, found: importance.Weighted) -> WeightedDraws:
    """Draws x (N, P), their weights smoothed."""
    if found.is_lost:
        return WeightedDraws(x, found.weight, -np.inf, np.inf, 0.0, np.nan)
    log_weight, k = importance.smooth(found.log_weight)
    weight = torch.softmax(log_weight, 0)
    ess = importance.effective(weight)
    return WeightedDraws(x, weight, found.log_evidence, found.evidence_error, ess, k)


class Standardised:
    """Coordinates v (N, m + n + G) in which the posterior of a fitted model (M = 1) is nearly
    standard normal: of its m measured inputs, given the others and linear about them; of its n
    other free inputs; then G log noise scales as they are.

    Attributes: measured, m; mean (n + G,) and covariance (n + G, n + G), about those of the
    posterior of the others.
    """

    def __init__(self, potential: Potential, fitted: Fits, generator: torch.Generator):
        self._potential, count = potential, len(potential.inputs)
        self._linearise(fitted)
        n = len(self._pull) - self.measured
        self.mean, self.covariance = fitted.x.new_zeros(n), torch.eye(n, dtype=fitted.x.dtype)
        if potential.noise.groups:
            # A joint maximum has too small a noise; so inputs are fitted again, where it is.
            centre, spread = fitted.mean[0, count:], fitted.covariance[0, count:, count:]
            for _ in range(SETTLING):
                start = self._marginal, centre, spread, SCALES, generator
                found = importance.sample(*start, rounds=SETTLING)
                centre, spread = importance.moments(found.u, found.weight)
                x, free = fitted.x.clone(), fitted.free.clone()
                x[:, count:], free[:, count:] = centre, False
                self._linearise(fit_to_the_end(potential, replace(fitted, x=x, free=free)))
            self.mean = torch.cat([self.mean, centre])
            self.covariance = torch.block_diag(self.covariance, spread)
        if self.measured:
            self._interpolate_slopes(generator)

    def _interpolate_slopes(self, generator: torch.Generator) -> None:
        """Find the outputs' derivatives as linear functions of the other inputs' coordinates, where
        measured inputs are likely given these: they would cost more than all else at every draw."""
        n = len(self._pull) - self.measured
        count = SLOPES_OF * (1 + len(self.mean))
        v = torch.randn(count, len(self.mean), generator=generator, dtype=self.mean.dtype)
        factor = torch.linalg.cholesky(self.covariance)
        v = self.mean + SPREAD * v @ factor.mT
        x = self._with_others(torch.cat([v.new_zeros(count, self.measured), v], 1))[0]
        _, slopes = self._potential.linearise(x)
        solved = torch.linalg.lstsq(_with_one(v[:, :n]), slopes.flatten(1)).solution
        self._slopes_by_others = solved.reshape(-1, *slopes.shape[1:])

    def _linearise(self, fitted: Fits) -> None:
        potential, count = self._potential, len(self._potential.inputs)
        places = fitted.free[0, :count].nonzero()[:, 0]
        # The measured ones first: the coordinates are conditioned on those that follow.
        is_measured = torch.isin(places, potential.measured.at)
        self._fitted, self.measured = fitted, int(is_measured.sum())
        self._free = free = torch.cat([places[is_measured], places[~is_measured]])
        covariance = fitted.covariance[0][free][:, free]
        self._transform = BoundedTransform(
            potential.low[free], potential.high[free], covariance.diagonal().sqrt()
        )
        mean, slopes = potential.linearise(fitted.x)
        observed = potential.observed
        self._residual = observed.split((potential.y - mean)[0])[..., None]
        self._slopes = observed.columns(slopes[0][:, free])
        # The ends of the ranges count with the normal factors that stand for them.
        self._precision = torch.linalg.inv(covariance)
        self._pull = self._precision @ (fitted.mean - fitted.x)[0, free]
        whitening = potential.whitening(fitted.x, fitted.error)
        weights = potential.weights(fitted.x, potential.y - mean, whitening)
        self._root = observed.split(weights[0].sqrt(), absent=1.0)[..., None]
        self._at_fit = self._root * whitening[0]

    def constrain_with_log_det(self, v: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Coordinates x (N, P) of the model, and log |dx / dv| (N,), -inf where round-off leaves
        none."""
        x, stretch = self._with_others(v)
        if not self.measured:
            return x, stretch
        x, of_measured = self._with_measured(x, v)
        return x, stretch + of_measured

    def _with_others(self, v):
        """Coordinates x (N, P) by all of v (N, ...) but its measured inputs, which are at their
        means given the others in the linear model; and log |dx / dv| (N,) without these."""
        n, m, x = len(self._pull), self.measured, self._fitted.x.repeat(len(v), 1)
        centre, factor, log_density = self._normal(v[:, n:])
        others = torch.cat([torch.zeros_like(v[:, :m]), v[:, m:n]], 1)
        away = torch.linalg.solve_triangular(factor.mT, others[..., None], upper=True)[..., 0]
        u = self._fitted.x[0, self._free] + centre + away
        x[:, self._free], x[:, len(self._potential.inputs) :] = (
            self._transform.constrain(u),
            v[:, n:],
        )
        stretch = self._transform.log_slope(u)[:, m:].sum(-1)
        stretch = stretch - factor.diagonal(dim1=-2, dim2=-1)[:, m:].log().sum(-1)
        return x, torch.where(log_density.isneginf(), log_density, stretch)

    def _with_measured(self, x, v):
        """The measured inputs by v (N, ...), about where they are likely given the others at x
        (N, P); and log |dx / dv| (N,) of these alone."""
        potential, m, at = self._potential, self.measured, self._free[: self.measured]
        by = _with_one(v[:, m : len(self._pull)])
        slopes = torch.tensordot(by, self._slopes_by_others, dims=1)
        found = potential.quadratic(potential.mean(x), slopes, x, self._fitted.error)
        factor, lost = _factor(found.curvature[:, at][:, :, at])
        step = torch.cholesky_solve(found.gradient[:, at, None], factor)
        step = step + torch.linalg.solve_triangular(factor.mT, v[:, :m, None], upper=True)
        wanted, x = x[:, at] + step[..., 0], x.clone()
        # Dozens of them, each a little beyond its range now and then, would lose most draws.
        ends = BoundedTransform(potential.low[at], potential.high[at], self._transform.width[:m])
        x[:, at] = ends.constrain(wanted)
        stretch = ends.log_slope(wanted).sum(-1)
        stretch = stretch - factor.diagonal(dim1=-2, dim2=-1).log().sum(-1)
        return x, torch.where(lost, -torch.inf, stretch)

    def _normal(self, log_sigma):
        """Of the linear model with scales (N, G): mean (N or 1, n) less the fit, Cholesky factor
        (N or 1, n, n) of the precision, and log density (N or 1,) of the observations, -inf where
        round-off leaves no such factor."""
        precision, pull, white = self._precision[None], self._pull[None], self._at_fit[None]
        if self._potential.noise.groups:
            x = self._fitted.x.repeat(len(log_sigma), 1)
            x[:, len(self._potential.inputs) :] = log_sigma
            white = self._root * self._potential.whitening(x, self._fitted.error)
            change = white.mT @ white - self._at_fit.mT @ self._at_fit
            slopes = self._slopes.flatten(0, -2)
            precision = precision + slopes.mT @ (change @ self._slopes).flatten(1, -2)
            pull = pull + (change @ self._residual).flatten(1) @ slopes
        factor, lost = _factor(precision)
        centre = torch.cholesky_solve(pull[..., None], factor)[..., 0]
        logs = white.diagonal(dim1=-2, dim2=-1).log().flatten(1).sum(-1)
        logs = logs - factor.diagonal(dim1=-2, dim2=-1).log().sum(-1)
        error = (white @ self._residual).square().flatten(1).sum(-1)
        logs = logs - 0.5 * error + 0.5 * (pull * centre).sum(-1)
        return centre, factor, torch.where(lost, -torch.inf, logs)

    def _marginal(self, log_sigma):
        """Log posterior density (N,) of the scales in the linear model."""
        prior = self._potential.noise.log_prior(log_sigma) + log_sigma.sum(-1)
        parts = log_sigma.split(self._potential.chunk)
        return prior + torch.cat([self._normal(part)[2] for part in parts])


def _with_one(v: torch.Tensor) -> torch.Tensor:
    """A column of ones before those of v (N, n)."""
    return torch.cat([torch.ones_like(v[:, :1]), v], 1)


def _factor(precision: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Cholesky factors of matrices (N, n, n), and which have none by round-off (N,): of these the
    factor is the identity."""
    factor, failed = torch.linalg.cholesky_ex(precision)
    lost = failed > 0
    identity = torch.eye(factor.shape[-1]).to(factor)
    return torch.where(lost[:, None, None], identity, factor), lost
