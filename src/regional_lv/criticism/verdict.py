"""The verdict on sets of causes: what was searched, sampled and confirmed, and what is named."""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field

import pandas as pd
import torch

from regional_lv.criticism import score, words
from regional_lv.criticism.confirmation import Correction
from regional_lv.criticism.fit import Fit, white
from regional_lv.criticism.hypotheses import Hypothesis
from regional_lv.criticism.identify import Identified
from regional_lv.criticism.model import Model
from regional_lv.criticism.observations import Observations
from regional_lv.criticism.posterior import LeftOut, Posterior, precisions

PROBABILITY = 0.95
"""Of a cause that is named; of a group, that one of its members is present."""

LEAST_PROBABILITY = 0.01
"""Of a set that is simulated, or sampled."""

ADEQUATE = 0.02
"""Level of the last test, for each cause of a set: a set that misses the data at this level
explains nothing, whatever it gains. Larger sets were chosen among more, and fit more by chance."""

REFUTED = ADEQUATE / 2
"""The same for a set that estimates leave out. A right set is rejected now and then; the one that
stands in for it as the best has other estimates, and is less probable."""

LARGEST_GROUP = 5
"""Causes of which one is present, at most: a larger group is not informative."""

NEAR_END = 0.01
"""Share of its range at which a median counts as at the end."""

BEYOND = 1.645
"""Standard errors by which data require more than the end of a range."""

Member = tuple[str, str]
"""Name of a cause and its component, empty for a cause that has one place."""


@dataclass(frozen=True)
class Settings:
    """bootstrap: replicates. level: of the test whether anything is wrong. draws: per round of the
    sampler. largest_set: causes in a set, at most. sets, simulations, rounds: of the confirmation:
    sets and simulations of each per round, and rounds, after which one more simulates again what
    was simulated elsewhere (`CauseSet.elsewhere`). load_fractions: at which the heart could be
    imaged to tell causes apart."""

    bootstrap: int
    level: float
    draws: int
    largest_set: int
    sets: int
    simulations: int
    rounds: int
    load_fractions: tuple[float, ...] = ()

    @property
    def turns(self) -> int:
        """Rounds, the last one included."""
        return self.rounds + 1

    @classmethod
    def from_config(cls, section: dict) -> "Settings":
        """From the section `criticism` of the config; other keys are ignored."""
        flat = section | section["confirmation"]
        return cls(**{key: flat[key] for key in cls.__dataclass_fields__})


@dataclass(frozen=True)
class Tested:
    """What the base model's fit says of one hypothesis.

    component: the leading place. z: score there, signed. p_single, p_value: by itself, and over the
    catalogue.
    """

    hypothesis: Hypothesis
    component: str
    z: float
    p_single: float
    p_value: float
    identified: Identified
    fraction_simulated: float

    @property
    def name(self) -> str:
        return self.hypothesis.name


@dataclass(frozen=True)
class Searched:
    """What the search leaves for the steps after it; plain numbers (`content`, `of`).

    base_x: fit of the base model. base_evidence: its log evidence, to which all others are
    relative (a base model that misses by hundreds is fitted elsewhere by and by, and a second value
    would differ by as much). misfit: of it, over all tests. sets: members, fit and log prior
    of the leading sets. causes: how many were searched. unlisted: log evidence, relative to the
    base model, of a discrepancy that no listed cause makes; unlisted_approximated: the same by
    Laplace's approximation. critical_z: score that is significant over the catalogue.
    """

    base_x: list[float]
    base_evidence: float
    misfit: score.Misfit
    detected: bool
    tests: list[dict]
    sets: list[dict]
    causes: int
    unlisted: float
    unlisted_approximated: float
    unlisted_prior: float
    critical_z: float

    def content(self) -> dict:
        return asdict(self)

    @classmethod
    def of(cls, content: dict) -> "Searched":
        misfit = content["misfit"]
        largest = [tuple(row) for row in misfit["largest"]]
        sets = [s | {"members": tuple(map(tuple, s["members"]))} for s in content["sets"]]
        whole = score.Misfit(misfit["p_value"], misfit["families"], largest)
        return cls(**(content | {"misfit": whole, "sets": sets}))


@dataclass(frozen=True)
class Sampled:
    """One model with its fit, posterior and leave-one-segment-out prediction."""

    model: Model
    fit: Fit
    posterior: Posterior
    left_out: LeftOut


@dataclass
class CauseSet:
    """One set of causes, fitted by itself.

    log_evidence: relative to the base model; of a set without simulations with what these changed
    in others. uncertain: draws (N,), about 0, of what simulations may change in that; None of a set
    that has some. correction: from its simulations, if there are any. draws: of its posterior,
    where it is not sampled with all that a verdict needs. failed: whether it was to be simulated,
    and too few simulations converged.
    """

    members: tuple[Member, ...]
    model: Model
    fit: Fit
    log_evidence: float
    log_prior: float
    probability: float = 0.0
    sampled: Sampled | None = None
    draws: Posterior | None = None
    misfit: score.Misfit | None = None
    uncertain: torch.Tensor | None = None
    failed: bool = False

    @property
    def posterior(self) -> Posterior | None:
        return self.draws if self.sampled is None else self.sampled.posterior

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name for name, _ in self.members)

    @property
    def log_posterior(self) -> float:
        return self.log_evidence + self.log_prior

    @property
    def correction(self) -> Correction | None:
        return self.model.emulator.correction

    @property
    def confirmed(self) -> bool:
        """Whether simulations with all its effects at once, about its estimates, stand behind its
        numbers."""
        return self.correction is not None and not self.elsewhere

    @property
    def simulations(self) -> int:
        """How many of these there are."""
        return 0 if self.correction is None else self.correction.simulations

    @property
    def fits(self) -> bool:
        """Whether its misfit has been tested, and is none."""
        return self.misfit is not None and self.misfit.p_value > ADEQUATE * len(self.members)

    @property
    def refuted(self) -> bool:
        """Whether its misfit has been tested, and is more than right sets have now and then."""
        return self.misfit is not None and self.misfit.p_value <= REFUTED * len(self.members)

    @property
    def difference_sds(self) -> torch.Tensor:
        """(S, D) differences of simulated and emulated channels, in sds of the noise; NaN for
        channels without noise, such as a volume that is taken as exact."""
        assert self.correction is not None
        noise = self.model.noise_variance(self.fit.x)[0].sqrt()
        return torch.where(noise > 0, self.correction.value / noise, math.nan)

    @property
    def difference_sd(self) -> float:
        """The largest of them, whatever its sign."""
        if self.correction is None:
            return math.nan
        found = self.difference_sds.abs()[self.model.observations.present]
        found = found[found.isfinite()]
        return float(found.max()) if len(found) else math.nan

    @property
    def beyond_sd(self) -> dict[str, float]:
        """Cause -> how far its estimate is from the mean of those that were simulated, in their
        sds; empty without simulations."""
        if self.correction is None:
            return {}
        model = self.model
        width = (model.high - model.low)[model.psi]
        away = self.correction.beyond(model.scaled_psi(self.fit.x)[0], width)[0]
        return dict(zip(self.names, away.tolist(), strict=True))

    @property
    def elsewhere(self) -> bool:
        """Whether its simulations are so far from its estimates that their correction is
        extrapolated there."""
        return any(abs(away) > words.FARTHEST for away in self.beyond_sd.values())

    def place(self, name: str) -> int:
        """Coordinate of a cause of the set among those of the model."""
        return self.model.psi.start + self.names.index(name)

    def at_bound(self, name: str) -> bool:
        """Whether the data require more than the range of a cause holds."""
        place, model = self.place(name), self.model
        low, high = float(model.low[place]), float(model.high[place])
        if self.sampled is not None:
            draws = self.sampled.posterior
            (median,) = draws.quantile(draws.x[:, place], [0.5])
            if min(median - low, high - median) < NEAR_END * (high - low):
                return True
        x = float(self.fit.x[0, place])
        if min(x - low, high - x) > 1e-6 * (high - low):
            return False
        slopes = white(self.fit.whitening, self.fit.jacobian).flatten(1, 2)[0]
        error = white(self.fit.whitening, self.fit.residual[..., None]).flatten()
        covariance = torch.linalg.inv(precisions(model, self.fit)[0])
        gradient = torch.zeros(len(covariance), dtype=error.dtype)
        gradient[: model.means] = slopes.mT @ error
        # How far the free maximum lies outside, in its own standard errors.
        outside = (covariance @ gradient)[place] / covariance[place, place].sqrt()
        return abs(float(outside)) > BEYOND


@dataclass
class Criticism:
    """The verdict on one subject, or on several together.

    sets: the most probable first. best: the most probable one that is confirmed. base_probability,
    unlisted_probability: that nothing is wrong, or what no listed cause makes; NaN where the data
    are too few to tell. simulations: of the confirmation.
    """

    observations: Observations
    settings: Settings
    base: Sampled
    searched: Searched
    tests: list[Tested]
    sets: list[CauseSet]
    base_probability: float
    unlisted_probability: float
    best: CauseSet | None = None
    outliers: str = ""
    named: list[str] = field(default_factory=list)
    groups: list[list[str]] = field(default_factory=list)
    acts_like: list[str] = field(default_factory=list)
    simulations: pd.DataFrame | None = None

    @property
    def final(self) -> Sampled:
        if self.best is None:
            return self.base
        assert self.best.sampled is not None
        return self.best.sampled

    @property
    def adequate(self) -> bool:
        """Whether the best set is confirmed and fits the data."""
        return self.best is not None and self.best.fits

    @property
    def explained(self) -> bool:
        """Whether a set that fits stands behind all that the verdict says; or heavy tails, which
        leave nothing to test."""
        tails = self.best is not None and self.best.model.tails is not None
        return (self.adequate or tails) and bool(self.named or self.groups)

    def probability(self, name: str) -> float:
        return _total(s for s in self.sets if name in s.names)

    def share_of(self, name: str, component: str) -> float:
        """Of the probability that a cause is present, the share of one of its components; 1 if it
        has none."""
        there = self.probability(name)
        same = _total(s for s in self.sets if (name, component) in s.members)
        return same / there if there else 1.0

    def name_causes(self, best: CauseSet) -> None:
        """Name the causes of the best set that are certain, and the groups of which one is."""
        listed = 1 - self.base_probability - self.unlisted_probability
        for name in best.names:
            if best.at_bound(name):
                # Of all listed causes this one comes nearest, or it is not worth a word.
                if self.probability(name) >= PROBABILITY * listed:
                    self.acts_like.append(name)
            elif not self.adequate:
                continue
            elif self.probability(name) >= PROBABILITY:
                self.named.append(name)
            else:
                group = self._group(best, name)
                if group and group not in self.groups:
                    self.groups.append(group)

    def _group(self, best: CauseSet, name: str) -> list[str]:
        """The fewest causes, `name` first, of which at least one is present with `PROBABILITY`;
        empty if that takes too many."""
        group, rest = [name], self.base_probability + self.unlisted_probability
        while True:
            without = [s for s in self.sets if not set(group) & set(s.names)]
            if 1 - _total(without) - rest >= PROBABILITY:
                return group
            shares: dict[str, float] = {}
            for one in without:
                for other in set(one.names) - set(best.names):
                    shares[other] = shares.get(other, 0.0) + one.probability
            if not shares or len(group) == LARGEST_GROUP:
                return []
            group.append(max(sorted(shares), key=shares.__getitem__))


def _total(sets: Iterable[CauseSet]) -> float:
    return sum(s.probability for s in sets)
