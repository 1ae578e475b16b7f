"""The verdict on one subject, or on several together: which models pass, and what is named."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import torch

from regional_lv.criticism.left_out import LeftOut
from regional_lv.criticism.linear_model import LinearModel
from regional_lv.criticism.misfit import Tested
from regional_lv.inference.averaging import Averaged
from regional_lv.inference.evidence import Fits
from regional_lv.inference.potential import Potential
from regional_lv.inference.sets import Candidate

PROBABILITY = 0.95
"""Of a cause that is named; of a group, that one of its members is present."""

ADEQUATE = 0.02
"""Level of the last test, for each cause of a set: a set that misses the data at this level
explains nothing, whatever it gains. Larger sets were chosen among more, and fit more by chance."""

LARGEST_GROUP = 5
"""Causes of which one is present, at most: a larger group is not informative."""

NEAR_END = 0.01
"""Share of its range at which a median counts as at the end."""

BEYOND = 1.645
"""Standard errors by which data require more than the end of a range."""


@dataclass(frozen=True)
class Examined:
    """One model about its fit: the linear model, its tests, and each segment predicted from the
    others. no_outliers: of a model with heavy tails, why what is far off are no outliers."""

    linear: LinearModel
    tested: Tested
    left_out: LeftOut
    no_outliers: str = ""

    def fits(self, size: int) -> bool:
        """Whether a set of `size` causes passes the tests."""
        return self.linear.testable and self.tested.p_value > ADEQUATE * max(size, 1)


@dataclass(frozen=True)
class Verdict:
    """What is concluded (`Verdict.of`).

    examined: by number of the model, the model as it is among them. confirmed: numbers of the
    models that simulations stand behind; None where there is no simulator to ask. best: number of
    the most probable set of causes that is confirmed (or of all, without a simulator) and fits, or
    of the first if none does; None if there is none. named: its causes that are certain; groups: of
    causes of which one is; proxies: causes of which the data require more than the range.
    """

    averaged: Averaged
    examined: Mapping[int, Examined]
    level: float
    confirmed: frozenset[int] | None
    best: int | None = None
    named: list[str] = field(default_factory=list)
    groups: list[list[str]] = field(default_factory=list)
    proxies: list[str] = field(default_factory=list)

    @classmethod
    def of(
        cls,
        averaged: Averaged,
        examined: Mapping[int, Examined],
        level: float,
        confirmed: frozenset[int] | None,
    ) -> "Verdict":
        """Choose the best set, and name its causes that are certain, and groups of which one is."""
        nothing = cls(averaged, examined, level, confirmed)
        best = nothing._best() if nothing.detected else None
        return nothing if best is None else replace(nothing, best=best)._with_names()

    @property
    def potential(self) -> Potential:
        return self.averaged.potential

    @property
    def base(self) -> Examined:
        """The model as it is."""
        return self.examined[self.averaged.base]

    @property
    def final(self) -> Examined:
        """The best set, or the model as it is."""
        return self.base if self.best is None else self.examined[self.best]

    @property
    def detected(self) -> bool:
        """Whether the model as it is misses the measurements."""
        return self.base.linear.testable and self.base.tested.p_value <= self.level

    @property
    def adequate(self) -> bool:
        """Whether the best set fits."""
        return self.best is not None and self.passes(self.best)

    @property
    def explained(self) -> bool:
        """Whether a set that fits stands behind what is named."""
        return self.adequate and bool(self.named or self.groups)

    @property
    def trusted(self) -> bool:
        """Whether a probable model passes the tests."""
        examined = (n for n in self.averaged.leading if n in self.examined)
        return not self.detected or any(map(self.passes, examined))

    @property
    def leads_unconfirmed(self) -> bool:
        """Whether something is wrong, and the most probable set is not confirmed."""
        sets = [n for n in self.examined if self.averaged.models[n].members]
        return self.detected and bool(sets) and sets[0] not in (self.confirmed or ())

    def passes(self, number: int) -> bool:
        """Whether an examined model fits."""
        if number == self.averaged.base:
            return not self.detected
        return self.examined[number].fits(len(self.averaged.models[number].members))

    def causes_of(self, number: int) -> dict[str, int]:
        """Cause -> place of its input, of a model."""
        inputs = self.potential.inputs
        return {inputs[k].cause: k for k in self.averaged.models[number].members}

    def _best(self) -> int | None:
        """The most probable set that fits; if none does that could replace the first, the first."""
        probability, first = self.averaged.probability, None
        for number in self.examined:
            if not self.averaged.models[number].members:
                continue
            if self.confirmed is not None and number not in self.confirmed:
                continue
            first = number if first is None else first
            if probability[number] < probability[first] / 19:
                break
            if self.passes(number):
                return number
        return first

    def _with_names(self) -> "Verdict":
        named: list[str] = []
        groups: list[list[str]] = []
        proxies: list[str] = []
        rest = self.averaged.probability[self.averaged.base] + self.averaged.departure_probability
        assert self.best is not None
        for cause, k in self.causes_of(self.best).items():
            probability = self.averaged.probability_of_cause(cause)
            if k == self.potential.tails and self.examined[self.best].no_outliers:
                continue
            if self.at_bound(self.best, k):
                # Of all listed causes this one comes nearest, or it is not worth a word.
                if probability >= PROBABILITY * (1 - rest):
                    proxies.append(cause)
            elif not self.adequate:
                continue
            elif probability >= PROBABILITY:
                named.append(cause)
            else:
                group = self._group(cause, rest)
                if group and sorted(group) not in map(sorted, groups):
                    groups.append(group)
        return replace(self, named=named, groups=groups, proxies=proxies)

    def _group(self, cause: str, rest: float) -> list[str]:
        """The fewest causes, `cause` first, of which at least one is present with `PROBABILITY`;
        empty if that takes too many."""
        assert self.best is not None
        own, group = set(self.causes_of(self.best)), [cause]
        models = range(len(self.averaged.models))
        sets = [(set(self.causes_of(n)), self.averaged.probability[n]) for n in models]
        while True:
            without = [(causes, p) for causes, p in sets if causes and not causes & set(group)]
            if 1 - sum(p for _, p in without) - rest >= PROBABILITY:
                return group
            shares: dict[str, float] = {}
            for causes, p in without:
                for other in causes - own:
                    shares[other] = shares.get(other, 0.0) + p
            if not shares or len(group) == LARGEST_GROUP:
                return []
            group.append(max(sorted(shares), key=shares.__getitem__))

    def at_bound(self, number: int, k: int) -> bool:
        """Whether the data require more than the range of the input at place `k` in a model."""
        model = self.averaged.models[number]
        return k != self.potential.tails and at_bound(self.potential, model, k)


def at_bound(potential: Potential, model: Candidate, k: int) -> bool:
    """Whether the data require more than the range of the input at place `k` of a model: its median
    is at the end, or its maximum lies beyond by more than `BEYOND` standard errors."""
    low, high = float(potential.low[k]), float(potential.high[k])
    if model.drawn is not None:
        column = model.drawn.x[:, k]
        order = column.argsort()
        half = int(torch.searchsorted(model.drawn.weight[order].cumsum(0), 0.5))
        median = float(column[order[min(half, len(order) - 1)]])
        if min(median - low, high - median) < NEAR_END * (high - low):
            return True
    return model.fit is not None and beyond_end(potential, model.fit, k) > BEYOND


def beyond_end(potential: Potential, fitted: Fits, k: int) -> float:
    """How far the maximum of a model (M = 1) without ends lies beyond the end at which coordinate
    `k` is, in its standard errors; 0 if it is at none."""
    x, gradient = fitted.x[0], fitted.gradient[0]
    at_end = (x <= potential.low) & (gradient < 0) | (x >= potential.high) & (gradient > 0)
    if not at_end[k]:
        return 0.0
    kept = fitted.free[0] & (~at_end | (torch.arange(len(x)) == k))
    covariance = torch.linalg.inv(fitted.curvature[0][kept][:, kept])
    place = int(kept[:k].sum())
    step = covariance @ gradient[kept]
    return float(step[place].abs() / covariance[place, place].sqrt())
