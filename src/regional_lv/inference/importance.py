"""Adaptive importance sampling, for posteriors whose density is cheap in batches.

Proposals are Student t distributions in coordinates without bounds, fitted to the weighted draws of
the rounds before (population Monte Carlo, Cappe et al. 2004, doi 10.1198/106186004X12803); a
posterior that one of them does not resemble gets a mixture of several (Cappe et al. 2008,
doi 10.1007/s11222-008-9059-x). While proposals are fitted, all draws of the later rounds count,
weighted against the mixture of their proposals (Cornuet et al. 2012,
doi 10.1111/j.1467-9469.2011.00756.x). The draws that are kept are new ones from this mixture: a
proposal that was fitted to a draw of large weight lies on it and takes that weight away, so that
evidence and tails would come out too small. It needs no gradient and gives the evidence as well.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import torch

from regional_lv.emulators.gaussian import LOG_2PI
from regional_lv.inference.arviz_arrays import PARETO_K, smoothed_weights

PARTS = 8
"""Distributions in a mixture."""

FREEDOM = 5
"""Degrees of freedom of the proposals: heavier tails than any posterior in a box."""

WIDER = 1.05
"""Of the standard deviation of coordinates that are proposed as normal."""

WIDENED = 1.5
"""Of a proposal's covariance over that of the weighted draws it follows, whose tails are thin. With
1.2, posteriors of 45 inputs are as wide, but the worst of twenty has 226 effective draws in place
of 395."""

EVEN = 0.02
"""Standard deviation of log weights below which they count as even."""

KEPT_ROUNDS = 2
"""Rounds of draws that are kept, at most, where the density is not so cheap."""

SHARE_ENOUGH = 0.5
"""Effective share of the draws from which the tail of their weights has too little of it to
matter."""

TRUNCATION = 20
"""Draws that may carry the weight of the proposal's next form, at least: a few lucky draws of an
early round would make it collapse."""


Limit: TypeAlias = float | torch.Tensor
"""Of the sd of every coordinate: one for all, or (P,)."""


@dataclass(frozen=True)
class Weighted:
    """Draws u (N, P), the last ones that were made, and their log weights (N,), not normalised:
    -inf of a draw that is lost."""

    u: torch.Tensor
    log_weight: torch.Tensor

    @property
    def is_lost(self) -> bool:
        """Whether no draw is left."""
        return bool(self.log_weight.isneginf().all())

    @cached_property
    def weight(self) -> torch.Tensor:
        """Normalised, (N,); even where all are lost."""
        return torch.softmax(torch.zeros_like(self.u[:, 0]) if self.is_lost else self.log_weight, 0)

    @property
    def ess(self) -> float:
        """Effective sample size."""
        return 0.0 if self.is_lost else effective(self.weight)

    @property
    def has_light_tail(self) -> bool:
        """Whether `is_light` says so of the smoothed weights."""
        if self.is_lost:
            return False
        smoothed, k = smooth(self.log_weight)
        return is_light(effective(torch.softmax(smoothed, 0)), len(self.u), k)

    @property
    def log_evidence(self) -> float:
        return float(torch.logsumexp(self.log_weight, 0)) - math.log(len(self.u))

    @property
    def evidence_error(self) -> float:
        """Standard error of the log evidence."""
        if self.is_lost:
            return math.inf
        return math.sqrt(max(1 / self.ess - 1 / len(self.u), 0.0))

    def tempered(self, normal: int = 0) -> torch.Tensor:
        """Weights (N,) flattened until enough draws for a next proposal count, of all coordinates
        but the first that are `normal`."""
        return temper(self.log_weight, 4 * (self.u.shape[1] - normal) + TRUNCATION)


def sample(
    log_density: Callable[[torch.Tensor], torch.Tensor],
    mean: torch.Tensor,
    covariance: torch.Tensor,
    draws: int,
    generator: torch.Generator,
    *,
    rounds: int,
    most_rounds: int | None = None,
    least_ess: float = math.inf,
    kept: int | None = KEPT_ROUNDS,
    largest_sd: Limit = math.inf,
    normal: int = 0,
) -> Weighted:
    """Draws of a `log_density` (M,) of u (M, N + P), which need not be normalised.

    mean (P,), covariance (P, P): of the first proposal. draws: per round. rounds: of proposals of
    one distribution; further ones are of mixtures, `most_rounds` in all (None: `rounds`). Ends when
    the effective sample size reaches `least_ess` and the weights' tail is light (`is_light`); then
    as many are drawn once more from the last proposals, at most `kept` rounds, which alone are
    returned. kept: None for those that there are, of which the evidence is not asked.
    largest_sd: of a proposal. normal: N, of the first coordinates, which are all but standard
    normal given the others: they are proposed as such, `WIDER`, and nothing is fitted to them.
    Fitted together, dozens of them would leave a hundredth of the effective draws.
    """
    proposal: Student | Mixture = Student(mean, limited(covariance, largest_sd))
    proposals: list[Student | Mixture] = []
    us, targets = [], []

    def drawn(proposal, count: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Draws (count, N + P), and their log densities over that of the normal coordinates."""
        u = proposal.draw(count, generator)
        beside = WIDER * torch.randn(count, normal, generator=generator, dtype=u.dtype)
        u = torch.cat([beside, u], 1)
        target = log_density(u) + 0.5 * (beside / WIDER).square().sum(1)
        target = target + normal * (math.log(WIDER) + 0.5 * LOG_2PI)
        return u, torch.nan_to_num(target, nan=-math.inf, posinf=-math.inf, neginf=-math.inf)

    for number in range(most_rounds or rounds):
        u, target = drawn(proposal, draws)
        proposals.append(proposal)
        us.append(u)
        targets.append(target)
        # The first rounds only show the way.
        recent = slice(number // 2, None)
        together = Mixture.equal(proposals[recent])
        every = torch.cat(us[recent])
        u = every[:, normal:]
        found = Weighted(every, torch.cat(targets[recent]) - together.log_density(u))
        if found.ess >= least_ess and found.has_light_tail:
            break
        if found.is_lost:
            continue
        tempered = found.tempered(normal)
        if number < rounds - 1:
            mean, spread = moments(u, tempered)
            proposal = Student(mean, limited(WIDENED * spread, largest_sd))
        else:
            if not isinstance(proposal, Mixture):
                proposal = Mixture.split(u, tempered, largest_sd)
            proposal = proposal.adapted(u, tempered, largest_sd)
    if kept is None:
        return found
    u, target = drawn(together, draws * min(len(together.parts), kept))
    return Weighted(u, target - together.log_density(u[:, normal:]))


def effective(weight: torch.Tensor) -> float:
    """Effective sample size of normalised weights (N,)."""
    return float(1 / weight.square().sum())


def moments(u: torch.Tensor, weight: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Weighted mean (P,) and covariance (P, P) of draws (N, P)."""
    covariance = torch.cov(u.mT, correction=0, aweights=weight)
    return weight @ u, covariance.reshape(u.shape[1], u.shape[1])


def smooth(log_weight: torch.Tensor) -> tuple[torch.Tensor, float]:
    """Pareto-smoothed log weights (N,) and the shape k of their tail (Vehtari et al. 2024).

    Weights that are all but even, but for draws that are lost, are left as they are, and have no k
    (NaN): a tail fitted to round-off says nothing.
    """
    if not log_weight[~log_weight.isneginf()].std() >= EVEN:
        return log_weight, math.nan
    smoothed, k = smoothed_weights(log_weight.numpy())
    return torch.as_tensor(smoothed), k


def is_light(ess: float, draws: int, pareto_k: float) -> bool:
    """Whether the tail of the weights of some draws lets their means count (`PARETO_K`)."""
    return ess >= SHARE_ENOUGH * draws or not pareto_k > PARETO_K


def resample(
    weight: torch.Tensor, count: int, generator: torch.Generator | None = None
) -> torch.Tensor:
    """Systematic resampling: `count` indices in ascending order, each as often as its normalised
    weight (N,) says, but for rounding, which `generator` decides."""
    shift = 0.5
    if generator is not None:
        shift = torch.rand(1, generator=generator, dtype=weight.dtype)
    points = (torch.arange(count, dtype=weight.dtype) + shift) / count
    return torch.searchsorted(weight.cumsum(0), points).clamp(max=len(weight) - 1)


def temper(log_weight: torch.Tensor, least: float) -> torch.Tensor:
    """Weights flattened, by a power, until at least `least` draws count."""
    power = 1.0
    for _ in range(40):
        weight = torch.softmax(power * log_weight, 0)
        if effective(weight) >= least:
            break
        power *= 0.8
    return weight


def limited(covariance: torch.Tensor, largest_sd: Limit) -> torch.Tensor:
    """The covariance with no coordinate's sd above `largest_sd`, and safely positive."""
    sd = covariance.diagonal().sqrt()
    factor = (largest_sd / sd).clamp(max=1.0)
    scaled = covariance * factor[:, None] * factor
    return scaled + torch.diag(1e-8 + 1e-6 * scaled.diagonal())


class Student:
    """Multivariate Student t of mean (P,) and scale matrix `spread` (P, P)."""

    def __init__(self, mean: torch.Tensor, spread: torch.Tensor):
        self.mean, self.factor = mean, torch.linalg.cholesky(spread)
        p = len(mean)
        self.constant = (
            math.lgamma((FREEDOM + p) / 2)
            - math.lgamma(FREEDOM / 2)
            - 0.5 * p * math.log(FREEDOM * math.pi)
            - float(self.factor.diagonal().log().sum())
        )

    def draw(self, count: int, generator: torch.Generator) -> torch.Tensor:
        p = len(self.mean)
        normal = torch.randn(count, p, generator=generator, dtype=torch.float64)
        # Chi-squared: a sum of squares, reproducible from the generator.
        chi = torch.randn(count, FREEDOM, generator=generator, dtype=torch.float64)
        scale = (chi.square().sum(1, keepdim=True) / FREEDOM).sqrt()
        return self.mean + (normal / scale) @ self.factor.mT

    def log_density(self, u: torch.Tensor) -> torch.Tensor:
        p = len(self.mean)
        return self.constant - 0.5 * (FREEDOM + p) * torch.log1p(self.distance(u) / FREEDOM)

    def distance(self, u: torch.Tensor) -> torch.Tensor:
        """Squared Mahalanobis distance (N,) of u (N, P) from the centre."""
        z = torch.linalg.solve_triangular(self.factor, (u - self.mean).mT, upper=False)
        return z.square().sum(0)


class Mixture:
    """Distributions with shares (K,) that add up to one."""

    def __init__(self, parts: list, shares: torch.Tensor):
        self.parts, self.shares = parts, shares

    @classmethod
    def equal(cls, parts: list) -> "Mixture":
        return cls(parts, torch.full((len(parts),), 1 / len(parts), dtype=torch.float64))

    @classmethod
    def split(cls, u: torch.Tensor, weight: torch.Tensor, largest_sd: Limit) -> "Mixture":
        """Around the centres of clusters of weighted draws, all as wide as the draws within."""
        from sklearn.cluster import KMeans  # slow to load, and few posteriors need a mixture

        mean, spread = moments(u, weight)
        factor = torch.linalg.cholesky(limited(spread, largest_sd))
        z = torch.linalg.solve_triangular(factor, (u - mean).mT, upper=False).mT
        means = KMeans(PARTS, n_init=1, random_state=0)
        means.fit(z.numpy(), sample_weight=weight.numpy())
        centres = torch.as_tensor(means.cluster_centers_)
        labels = torch.as_tensor(means.labels_).long()
        _, within = moments(z - centres[labels], weight)
        spread = limited(factor @ within @ factor.mT, largest_sd)
        return cls.equal([Student(mean + factor @ centre, spread) for centre in centres])

    def adapted(self, u: torch.Tensor, weight: torch.Tensor, largest_sd: Limit) -> "Mixture":
        """After one step of expectation maximisation on weighted draws."""
        logs = self._logs(u)
        share = torch.softmax(logs, 0) * weight
        parts, shares = [], []
        for part, own in zip(self.parts, share, strict=True):
            total = own.sum()
            if effective(own / total) < 2 * u.shape[1]:
                # Too few draws for a covariance: the others take over.
                continue
            pulled = own * (FREEDOM + u.shape[1]) / (FREEDOM + part.distance(u))
            mean, spread = moments(u, pulled / pulled.sum())
            spread = WIDENED * spread * pulled.sum() / total
            parts.append(Student(mean, limited(spread, largest_sd)))
            shares.append(total)
        return Mixture(parts, torch.stack(shares) / sum(shares)) if parts else self

    def draw(self, count: int, generator: torch.Generator) -> torch.Tensor:
        which = torch.multinomial(self.shares, count, replacement=True, generator=generator)
        counts = torch.bincount(which, minlength=len(self.parts)).tolist()
        return torch.cat([p.draw(n, generator) for p, n in zip(self.parts, counts, strict=True)])

    def log_density(self, u: torch.Tensor) -> torch.Tensor:
        return torch.logsumexp(self._logs(u), 0)

    def _logs(self, u: torch.Tensor) -> torch.Tensor:
        return torch.stack([p.log_density(u) for p in self.parts]) + self.shares.log()[:, None]
