"""Posterior, evidence and leave-one-segment-out prediction by adaptive importance sampling.

One set of draws (`inference.importance`) serves all folds whose posterior is near to the full one;
the others are sampled anew.
"""

import math
from dataclasses import dataclass

import arviz as az
import torch
from statsmodels.stats.weightstats import DescrStatsW

from regional_lv.criticism.fit import Fit, white
from regional_lv.criticism.model import Model
from regional_lv.gaussian import LOG_2PI
from regional_lv.inference import importance
from regional_lv.inference.transform import BoundedTransform
from regional_lv.seeds import derive

ROUNDS, MOST_ROUNDS = 6, 30
"""Of importance sampling: rounds of proposals of one distribution, and rounds at most."""

LARGEST_SD = 0.4
"""Of a proposal, as a share of the range: a uniform density has 0.29."""

LEAST_ESS = 150.0
"""Effective draws below which a fold is sampled by itself, and the evidence of a posterior is not
used."""

LARGEST_SHAPE = 0.7
"""Of the Pareto distribution of a fold's largest weights: beyond it, means over them are unreliable
(Vehtari et al. 2024, arXiv:1507.02646)."""


@dataclass(frozen=True)
class Posterior:
    """Weighted draws: x (N, P), log_weight (N,), normalised; log evidence and its relative error,
    effective sample size, and the residual y - f (N, S, D) of each draw."""

    model: Model
    x: torch.Tensor
    log_weight: torch.Tensor
    log_evidence: float
    evidence_error: float
    ess: float
    residual: torch.Tensor

    @property
    def weight(self) -> torch.Tensor:
        return self.log_weight.exp()

    @property
    def poor(self) -> bool:
        """Whether the sampler has not found its way to the posterior."""
        return self.ess < LEAST_ESS

    def quantile(self, values: torch.Tensor, levels) -> list[float]:
        """Weighted quantiles of one number per draw (N,)."""
        weighted = DescrStatsW(values.numpy(), self.weight.numpy())
        return weighted.quantile(levels, return_pandas=False).tolist()

    def moments(self, values: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Weighted mean and sd (...) of values (N, ...)."""
        weight = self.weight.reshape(-1, *[1] * (values.ndim - 1))
        mean = (weight * values).sum(0)
        return mean, (weight * (values - mean).square()).sum(0).sqrt()


def precisions(model: Model, found: Fit) -> torch.Tensor:
    """Precision (M, P, P) of the coordinates at M fits, with the weak prior."""
    m, p, r = len(found.x), len(model.low), model.means
    slopes = white(found.whitening, found.jacobian).flatten(1, 2)
    precision = torch.diag(12 / (model.high - model.low).square()).repeat(m, 1, 1)
    precision[:, :r, :r] += slopes.mT @ slopes
    first = model.first_sigma
    if first < p:
        w = found.whitening
        scales = torch.exp(2 * found.x[:, first:])
        change = 2 * scales[:, :, None] * model.observations.noise.units.square()
        squares = (w.mT @ w).square().sum(1) / 2
        precision[:, first:, first:] += change @ squares @ change.mT
    return precision


def laplace(model: Model, found: Fit) -> tuple[torch.Tensor, torch.Tensor]:
    """Centre (P,) and covariance (P, P) in x of a fit (M = 1), with the weak prior."""
    return found.x[0], torch.linalg.inv(precisions(model, found)[0])


def sample(
    model: Model,
    centre: torch.Tensor,
    covariance: torch.Tensor,
    draws: int,
    seed: int,
    keep: torch.Tensor | None = None,
) -> Posterior:
    """Sample the posterior of `model`, from a rough `centre` (P,) and `covariance` (P, P) in x.

    draws: per round. keep: (D,) channels that count as observed; all if None.
    """
    sd = covariance.diagonal().sqrt()
    transform = BoundedTransform(model.low, model.high, sd)
    start = transform.outside(centre)
    residuals = []

    def density(u):
        x = transform.inside(u)
        residuals.append(model.observations.y - model.mean(x))
        logs = log_density(model, residuals[-1], x, keep)
        return logs + model.log_prior(x) + transform.log_slope(u).sum(-1)

    found = importance.sample(
        density,
        start,
        2.0 * covariance,
        draws,
        torch.Generator().manual_seed(seed),
        rounds=ROUNDS,
        most_rounds=MOST_ROUNDS,
        least_ess=2 * LEAST_ESS,
        largest_sd=LARGEST_SD * (model.high - model.low),
    )
    return Posterior(
        model,
        transform.inside(found.u),
        found.log_weight - torch.logsumexp(found.log_weight, 0),
        found.log_evidence,
        found.evidence_error,
        found.ess,
        torch.cat(residuals)[-len(found.u) :],
    )


# --------------------------------------------------------------------------------- densities


def log_density(
    model: Model, residual: torch.Tensor, x: torch.Tensor, keep: torch.Tensor | None = None
) -> torch.Tensor:
    """Log density (N,) of the observed channels (those in `keep` (D,)) at residuals (N, S, D)."""
    present = model.observations.present
    mask = present if keep is None else present & keep
    if model.tails is not None:
        return torch.where(mask, _student(model, residual, x), 0.0).sum((-2, -1))
    count = int(mask.sum())
    if not model.observations.noise.groups:
        w = model.whitening(x[:1], mask)
        diagonal = w.diagonal(dim1=-2, dim2=-1)
        logs = torch.where(diagonal > 0, diagonal, 1.0).log().sum((-2, -1))
        distance = (w @ residual[..., None]).square().sum((-3, -2, -1))
        return logs - 0.5 * distance - 0.5 * LOG_2PI * count
    return torch.cat(
        [
            _varying_density(model, r, at, mask) - 0.5 * LOG_2PI * count
            for r, at in zip(residual.split(_ROWS), x.split(_ROWS), strict=True)
        ]
    )


def _varying_density(model: Model, residual, x, mask) -> torch.Tensor:
    """As `log_density` without its constant, for a covariance that differs from draw to draw."""
    both = mask[..., :, None] & mask[..., None, :]
    covariance = torch.where(both, model.covariance(x), torch.diag_embed((~mask).double()))
    factor = torch.linalg.cholesky(covariance)
    residual = torch.where(mask, residual, 0.0)[..., None]
    white = torch.linalg.solve_triangular(factor, residual, upper=False)
    logs = factor.diagonal(dim1=-2, dim2=-1).log().sum((-2, -1))
    return -logs - 0.5 * white.square().sum((-3, -2, -1))


_ROWS = 1024


def _student(model: Model, residual: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """Log density (N, S, D) channel by channel; scale: noise and emulator error together."""
    variance = model.error.diagonal(dim1=-2, dim2=-1) + model.noise_variance(x)
    nu = 1 / x[:, model.tail].clamp(min=1e-3)
    student = torch.distributions.StudentT(nu[:, None, None])
    return student.log_prob(residual / variance.sqrt()) - 0.5 * variance.log()


def left_out_errors(
    model: Model, residual: torch.Tensor, x: torch.Tensor, groups: list[torch.Tensor]
) -> list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]:
    """Of each group of channels (indices) given all others and the parameters, draw by draw: log
    density (N,), error y - prediction (N, S, k) and its covariance (N or 1, S, k, k)."""
    present = model.observations.present
    if model.tails is not None:
        logs = torch.where(present, _student(model, residual, x), 0.0)
        nu = 1 / x[:, model.tail].clamp(min=1e-3)
        inflation = (nu / (nu - 2).clamp(min=0.2))[:, None, None]
        variance = model.error.diagonal(dim1=-2, dim2=-1) + model.noise_variance(x)
        variance = variance * inflation
        return [
            (logs[..., g].sum((-2, -1)), residual[..., g], variance[..., g].diag_embed())
            for g in groups
        ]
    shared = not model.observations.noise.groups
    parts = []
    for r, at in zip(residual.split(_ROWS), x.split(_ROWS), strict=True):
        factor = torch.linalg.cholesky(model.covariance(at[:1] if shared else at))
        precision = torch.cholesky_inverse(factor)
        pulled = precision @ torch.where(present, r, 0.0)[..., None]
        parts.append([_given_others(precision, pulled, present, g) for g in groups])
    return [tuple(map(torch.cat, zip(*group, strict=True))) for group in zip(*parts, strict=True)]


def _given_others(precision, pulled, present, group):
    block = precision[..., group[:, None], group]
    factor = torch.linalg.cholesky(block)
    pulled = pulled[..., group, :]
    covariance = torch.cholesky_inverse(factor)
    error = covariance @ pulled
    distance = (error * pulled)[..., 0].sum((-2, -1))
    halves = factor.diagonal(dim1=-2, dim2=-1).log().sum((-2, -1))
    logs = halves - 0.5 * distance - 0.5 * LOG_2PI * int(present[:, group].sum())
    return logs, error[..., 0], covariance.expand(len(pulled), -1, -1, -1)


@dataclass(frozen=True)
class LeftOut:
    """Leave-one-segment-out prediction: elpd (F,) per fold, by the numbers in `folds`; mean and sd
    (S, D) of the prediction of every channel by the others; their joint mean and covariance fold by
    fold, over the channels observed; share of folds sampled by themselves, and the least effective
    sample size of any."""

    folds: tuple[int, ...]
    elpd: torch.Tensor
    joint: tuple[tuple[torch.Tensor, torch.Tensor], ...]
    mean: torch.Tensor
    sd: torch.Tensor
    repeated: float
    least_ess: float


def leave_out(posterior: Posterior, draws: int, seed: int) -> LeftOut:
    """Predict every segment (and the volume) from all other channels.

    The posterior without a fold is the full one reweighted by one over the density of the fold,
    the weights Pareto smoothed; where they are unreliable, the fold is fitted by itself.
    """
    model = posterior.model
    o = model.observations
    mean, sd = torch.zeros_like(o.y), torch.ones_like(o.y)
    elpd, joint, repeated, least = [], [], 0, math.inf
    places = [torch.nonzero(mask)[:, 0] for mask in o.groups.values()]
    full = left_out_errors(model, posterior.residual, posterior.x, places)
    for number, at, (logs, error, each) in zip(o.groups, places, full, strict=True):
        smoothed, shape = az.psislw((posterior.log_weight - logs).numpy())
        log_w = torch.as_tensor(smoothed)
        ess = float(1 / log_w.exp().square().sum())
        if shape > LARGEST_SHAPE or ess < LEAST_ESS:
            repeated += 1
            centre, scatter = importance.moments(
                posterior.x, importance.temper(log_w, LEAST_ESS / 2)
            )
            others = ~o.groups[number]
            found = sample(model, centre, 1.5 * scatter, draws, derive(seed, number), others)
            ((logs, error, each),) = left_out_errors(model, found.residual, found.x, [at])
            log_w, ess = found.log_weight, found.ess
        least = min(least, ess)
        elpd.append(torch.logsumexp(log_w + logs, 0))
        here = o.present[:, at].flatten()
        flat = error.flatten(1)[:, here]
        centre, scatter = importance.moments(flat, log_w.exp())
        within = log_w.exp() @ each.flatten(1).expand(len(error), -1)
        within = torch.block_diag(*within.unflatten(0, each.shape[1:]))
        covariance = scatter + within[here][:, here]
        observed = o.y[:, at].flatten()[here]
        joint.append((observed - centre, covariance))
        put(mean, at, o.present, observed - centre)
        put(sd, at, o.present, covariance.diagonal().sqrt())
    folds = tuple(o.groups)
    return LeftOut(folds, torch.stack(elpd), tuple(joint), mean, sd, repeated / len(folds), least)


def put(target: torch.Tensor, at: torch.Tensor, present: torch.Tensor, values) -> None:
    """Write `values` into the channels `at` of target (S, D) that were observed."""
    target[:, at] = target[:, at].masked_scatter(present[:, at], values)


def gain_of(before: LeftOut, after: LeftOut, posterior: Posterior) -> tuple[float, float, float]:
    """Gain in elpd; its standard error; and the one from the spread over the folds.

    The first is the sd that the gain has over repeated measurements of the same heart, as
    `posterior` (of the model after, given all channels) has it: of the log ratio of two
    predictions, taken as normal, under the noise. The second, usual one takes the segments for a
    sample of many. Where all the gain is in one segment, as with a scar, that one is as large as
    the gain whatever the data say (Sivula et al. 2020, arXiv:2008.10296, on few folds).
    """
    model = posterior.model
    o = model.observations
    difference = after.elpd - before.elpd
    residual, _ = posterior.moments(posterior.residual)
    x, _ = importance.moments(posterior.x, posterior.weight)
    noise = model.noise_variance(x[None])[0]
    variance = 0.0
    joints = zip(before.joint, after.joint, strict=True)
    for mask, ((m0, c0), (m1, c1)) in zip(o.groups.values(), joints, strict=True):
        here = o.present & mask
        expected = (o.y - residual)[here]
        q0, q1 = torch.linalg.inv(c0), torch.linalg.inv(c1)
        slope = q0 @ (expected - m0) - q1 @ (expected - m1)
        curvature = (q0 - q1) * noise[here]
        variance += float((slope.square() * noise[here]).sum())
        variance += float(0.5 * (curvature * curvature.mT).sum())
    spread = difference.var() if len(difference) > 1 else torch.tensor(math.nan)
    over_folds = float((len(difference) * spread).sqrt())
    return float(difference.sum()), math.sqrt(max(variance, 0.0)), over_folds
