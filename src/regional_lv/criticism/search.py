"""Fits of all sets of causes: which of them explain the data, and with what evidence.

Every single cause and every pair is fitted, by Levenberg and Marquardt's method, from several
starts. A larger set starts from the sets with one cause less: the score of the last cause says what
it would gain there and how large it would be. All sets of three are judged by that, from each of
their pairs, and the most promising ones are fitted. Beyond three only the best sets grow, in a
floating search (Pudil et al. 1994, doi 10.1016/0167-8655(94)90127-9): each cause of a set found is
taken away, too, and what is left grows again. So a cause that imitated several others in small
sets gives way to them in large ones.

The evidence of a fit is Laplace's, cut at the ends of the ranges. The prior of a set depends on its
size alone: all sizes are equally likely, and all sets of one size (Scott and Berger 2010, doi
10.1214/10-AOS792), so that a longer catalogue does not make it more likely that something is found.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import torch

from regional_lv.criticism.fit import Fit, fit, normal_equations
from regional_lv.criticism.model import Model
from regional_lv.criticism.posterior import precisions
from regional_lv.criticism.score import LARGEST_MATRICES, Projected, pattern_of
from regional_lv.gaussian import LOG_2PI
from regional_lv.progress import Progress

EXHAUSTIVE = 3
"""Size up to which every set is judged."""

ITERATIONS = 25
"""Of a fit: a set that matters is fitted to the end later."""

MOST_FITTED = 200
"""Sets of three that are fitted: those that promise most."""

BEAM = 10
"""Sets from which larger ones than `EXHAUSTIVE` grow, and four times as many that are fitted."""

ROUNDS = 5
"""Of taking causes away and growing again, for each size."""

SHARES = (0.05, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95)
"""Of the range of a single cause: where its fits start."""

ROWS = 512
"""Fits that run at once, at most (of several hearts `score.LARGEST_MATRICES` allows fewer)."""


@dataclass(frozen=True)
class Candidate:
    """A fitted set of causes. members: their places in the catalogue of the model, ascending.
    x: (P,), of that model. objective: of the fit. log_evidence: relative to no cause, without the
    prior of the set."""

    members: tuple[int, ...]
    x: torch.Tensor
    objective: float
    log_evidence: float


def log_prior(size: int, most: int, causes: int, places: Sequence[int] = ()) -> float:
    """Log prior probability of one set of `size` of all `causes`; of sizes from 0 to `most`.

    places: of each member, how many places it could have.
    """
    return -math.log(most + 1) - math.log(math.comb(causes, size)) - sum(map(math.log, places))


class Search:
    """The search over sets of one model.

    Parameters
    ----------
    model: with an extension for every place of every cause.
    base: fit (M = 1) of the model without extensions, in its own coordinates.
    causes: name of a cause -> its places among the model's extensions.
    largest: of the sets.
    """

    def __init__(self, model: Model, base: Fit, causes: Mapping[str, Sequence[int]], largest: int):
        self.model, self.causes, self.largest = model, causes, largest
        self._name = {place: name for name, places in causes.items() for place in places}
        start = model.at_base(base.x)
        none = torch.zeros(1, len(model.emulator.extensions), dtype=torch.bool)
        self._base = fit(model, model.observations.y[None], start, active=none)
        matrix = model.observations.y.numel() ** 2
        self._rows = max(1, min(ROWS, int(LARGEST_MATRICES / matrix)))
        self._reference = float(self._evidence(self._base, none)[0])
        self.found: dict[tuple[int, ...], Candidate] = {(): self._candidate((), self._base, 0, 0.0)}

    def run(self) -> list[Candidate]:
        """All fitted sets, the one with the largest evidence first."""
        rows: list[tuple[tuple[int, ...], torch.Tensor]] = [
            ((place,), x) for place in self._name for x in self._spread(place)
        ]
        self._fit_all(rows, "single causes")
        for size in range(2, min(self.largest, len(self.causes)) + 1):
            if size > EXHAUSTIVE:
                self._float(size)
            else:
                self._enlarge(self._best(size - 1), None if size == 2 else MOST_FITTED)
        return sorted(self.found.values(), key=lambda c: -c.log_evidence)

    def _float(self, size: int) -> None:
        """Fit sets of `size` by floating search: the best smaller ones grow, and so does what is
        left of the best of `size` without each of their causes."""
        tried: set[tuple[int, ...]] = set()
        for _ in range(ROUNDS):
            leading = self._best(size)[:BEAM]
            parents = {c.members for c in self._best(size - 1)[:BEAM]}
            parents |= {m for c in leading for m in _less_one(c.members)}
            parents -= tried
            if not parents:
                break
            self._enlarge([self.found[m] for m in sorted(parents)], 4 * BEAM)
            tried |= parents
            self._shrink(size)

    def _shrink(self, size: int) -> None:
        """Take each cause of the best sets of `size` away, and go on while that finds better sets
        of the smaller size."""
        while size > 2:
            smaller = self._best(size - 1)[0].objective
            self._fit_all(self._reduced(self._best(size)[:BEAM]), f"sets of {size} less one cause")
            size -= 1
            if self._best(size)[0].objective <= smaller:
                break

    def _best(self, size: int) -> list[Candidate]:
        """The fitted sets of one size, the best fit first."""
        return sorted((c for c in self.found.values() if len(c.members) == size), key=_order)

    def _enlarge(self, parents: list[Candidate], most: int | None) -> None:
        """Fit sets with one cause more than `parents`: `most` of them, or all from all starts."""
        grown = self._grow(parents)
        if most is not None:
            grown = self._promising(grown, most)
        rows = [(members, x) for members, starts in grown.items() for _, x in starts]
        self._fit_all(rows, f"sets of {len(parents[0].members) + 1}")

    def _reduced(self, candidates: list[Candidate]) -> list:
        """(members, start) of the sets without one of their causes that are not fitted yet."""
        rows: dict[tuple[int, ...], torch.Tensor] = {}
        for candidate in candidates:
            for members in _less_one(candidate.members):
                if members not in self.found and members not in rows:
                    (place,) = set(candidate.members) - set(members)
                    at = self.model.psi.start + place
                    rows[members] = candidate.x.clone()
                    rows[members][at] = self._base.x[0, at]
        return list(rows.items())

    # --------------------------------------------------------------------------------- starts

    def _spread(self, place: int) -> list[torch.Tensor]:
        at, found = self.model.psi.start + place, []
        low, high = self.model.low[at], self.model.high[at]
        for share in SHARES:
            x = self._base.x[0].clone()
            x[at] = low + share * (high - low)
            found.append(x)
        return found

    def _grow(self, parents: list[Candidate]) -> dict[tuple[int, ...], list]:
        """Sets with one cause more: members -> (expected objective, start) from each parent.

        A cause with several places takes, from each parent, the one with the largest score.
        """
        grown: dict[tuple[int, ...], list] = {}
        at = self.model.psi.start
        progress = Progress("scores of further causes", len(parents))
        for chunk in _chunks(parents, self._rows):
            x = torch.stack([c.x for c in chunk])
            active = self._active([c.members for c in chunk])
            y = self.model.observations.y.expand(len(chunk), -1, -1)
            here = fit(self.model, y, x, iterations=0, active=active)
            projected = Projected.of(here, self.model)
            steps = {place: self._step(here, projected, place) for place in self._name}
            for row, parent in enumerate(chunk):
                names = {self._name[place] for place in parent.members}
                for name in self.causes.keys() - names:
                    places = self.causes[name]
                    place = max(places, key=lambda p: float(steps[p][0][row]))
                    gain, psi = (float(values[row]) for values in steps[place])
                    members = tuple(sorted((*parent.members, place)))
                    single = float(self.found[place,].x[at + place])
                    for value in dict.fromkeys((psi, single)):
                        start = parent.x.clone()
                        start[at + place] = value
                        grown.setdefault(members, []).append((parent.objective + gain, start))
            progress.step(count=len(chunk))
        return dict(sorted(grown.items()))

    def _step(self, here: Fit, projected: Projected, place: int):
        """Gain (M,) of the objective that one more cause promises at fits, and its coordinate
        (M,)."""
        extension, at = self.model.emulator.extensions[place], self.model.psi.start + place
        base, low, high = (v[at] for v in (self._base.x[0], self.model.low, self.model.high))
        pattern = pattern_of(self.model, extension, here.x)
        information = projected.information(pattern)[:, 0].clamp(min=1e-300)
        slope = (pattern[..., 0] * projected.residual).sum(-1)
        step = (slope / information).clamp(low - base, high - base)
        return slope * step - 0.5 * information * step.square(), base + step

    @staticmethod
    def _promising(grown: dict, most: int) -> dict:
        """The `most` sets that promise most, each with its best start."""
        best = {members: max(starts, key=lambda s: s[0]) for members, starts in grown.items()}
        ranked = sorted(best.items(), key=lambda item: -item[1][0])
        return {members: [start] for members, start in ranked[:most]}

    # ----------------------------------------------------------------------------------- fits

    def _fit_all(self, rows: list, what: str) -> None:
        """Fit every (members, start) and keep the best fit of each set."""
        progress = Progress(what, len(rows))
        for chunk in _chunks(rows, self._rows):
            members = [m for m, _ in chunk]
            active = self._active(members)
            y = self.model.observations.y.expand(len(chunk), -1, -1)
            start = torch.stack([x for _, x in chunk])
            fits = fit(self.model, y, start, iterations=ITERATIONS, active=active)
            evidence = self._evidence(fits, active) - self._reference
            for row, name in enumerate(members):
                known = self.found.get(name)
                if known is None or float(fits.objective[row]) > known.objective:
                    self.found[name] = self._candidate(name, fits, row, float(evidence[row]))
            progress.step(count=len(chunk))

    def _active(self, sets: Iterable[tuple[int, ...]]) -> torch.Tensor:
        """(M, k)."""
        sets = list(sets)
        active = torch.zeros(len(sets), len(self.model.emulator.extensions), dtype=torch.bool)
        for row, members in enumerate(sets):
            active[row, list(members)] = True
        return active

    def _evidence(self, found: Fit, active: torch.Tensor) -> torch.Tensor:
        """(M,)."""
        return log_evidence(self.model, found, active)

    @staticmethod
    def _candidate(members, fits: Fit, row: int, evidence: float) -> Candidate:
        return Candidate(members, fits.x[row].clone(), float(fits.objective[row]), evidence)


def _order(candidate: Candidate) -> tuple:
    return -candidate.objective, candidate.members


def _less_one(members: tuple[int, ...]) -> list[tuple[int, ...]]:
    return [members[:at] + members[at + 1 :] for at in range(len(members))]


def _chunks(rows: list, size: int) -> list[list]:
    return [rows[first : first + size] for first in range(0, len(rows), size)]


def log_evidence(model: Model, found: Fit, active: torch.Tensor | None = None) -> torch.Tensor:
    """Laplace's approximation (M,) at fits, as `posterior.sample` has it by importance sampling.

    active: (M, k), the extensions that are free; all if None. Cut at the ends of their ranges; at
    an end beyond which the density still rises, it falls inwards with that slope, too.
    """
    count = len(model.emulator.extensions)
    if active is None:
        active = torch.ones(len(found.x), count, dtype=torch.bool)
    free = torch.ones_like(found.x, dtype=torch.bool)
    free[:, model.psi] = active
    both = free[:, :, None] & free[:, None, :]
    identity = torch.eye(free.shape[1], dtype=found.x.dtype)
    precision = torch.where(both, precisions(model, found), identity)
    factor = torch.linalg.cholesky(precision)
    covariance = torch.cholesky_inverse(factor)
    volume = 0.5 * LOG_2PI * free.sum(-1) - factor.diagonal(dim1=-2, dim2=-1).log().sum(-1)
    means = slice(model.means)
    x, low, high = found.x[:, means], model.low[means], model.high[means]
    sd = covariance.diagonal(dim1=-2, dim2=-1)[:, means].sqrt()
    inside = torch.special.ndtr((high - x) / sd) - torch.special.ndtr((low - x) / sd)
    parts = found.whitening, found.residual, found.jacobian
    gradient, _ = normal_equations(model, *parts, found.x)
    outwards = (x >= high).double() - (x <= low).double()
    rise = (outwards * gradient[:, means] * sd).clamp(min=0.0)
    share = torch.where(rise > 0, _within(rise, (high - low) / sd), inside)
    cut = share.clamp(min=1e-12).log()
    width = (high - low).log().expand_as(cut)  # of those that are not free
    volume = volume + torch.where(free[:, means], cut, width).sum(-1)
    likelihood = found.objective - 0.5 * LOG_2PI * int(model.observations.present.sum())
    if model.first_sigma < found.x.shape[1]:
        noise, sigma = model.observations.noise, found.x[:, model.first_sigma :].exp()
        likelihood = likelihood + 0.5 * sigma.square().sum(-1) / noise.prior_scale**2
    return likelihood + model.log_prior(found.x) + volume


def _within(rise: torch.Tensor, width: torch.Tensor) -> torch.Tensor:
    """Integral of exp(-rise t) under a standard normal density, t from 0 to `width`."""
    near = torch.special.erfcx(rise / math.sqrt(2))
    far = torch.special.erfcx((rise + width) / math.sqrt(2))
    return 0.5 * (near - torch.exp(-width * (rise + width / 2)) * far)
