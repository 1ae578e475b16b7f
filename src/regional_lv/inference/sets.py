"""The search over sets of suspected inputs: which explain the data, and with what evidence.

Every set up to three is judged. A set grows from those with one input less: the quadratic form at
the fit of such a parent says what evidence one more input would bring, and where; the sets that
promise most are fitted from there, and the others keep the evidence that is promised. Beyond three
only the best sets grow, in a floating search (Pudil et al. 1994, doi
10.1016/0167-8655(94)90127-9): each input of a set found is taken away, too, so that one that
imitated several others in small sets gives way to them in large ones.

All sizes are equally probable (Scott and Berger 2010, doi 10.1214/10-AOS792), so that a longer
catalogue does not make it more likely that something is found. Within a size all causes are, and
all places of a cause: the probability of a set is proportional to the product of the shares that
its inputs are of their causes. A smooth departure of unknown shape counts as one size more; it
takes any of `AMPLITUDES`.
"""

import itertools
import logging
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from regional_lv.emulators.gaussian import LOG_2PI
from regional_lv.inference.drawing import WeightedDraws
from regional_lv.inference.evidence import WEAK, Fits, cut, fit, held_at_ends
from regional_lv.inference.potential import Potential
from regional_lv.seeds import derive
from regional_lv.simulation.sobol import sobol

log = logging.getLogger(__name__)

EXHAUSTIVE = 3
"""Size up to which every set is judged."""

FITTED, FITTED_BEYOND = 100, 40
"""Sets of a size that are fitted, those that promise most; and of a size beyond `EXHAUSTIVE`."""

BEAM = 10
"""Sets from which larger ones than `EXHAUSTIVE` grow, and that are tried with one input less."""

ROUNDS = 3
"""Of growing and taking away, for each size, while that finds further sets to grow."""

LARGEST_DEFICIT = 15.0
"""Log posterior probability behind the best set, at which the best one of a size beyond
`EXHAUSTIVE` ends the search."""

SHARES = (0.1, 0.5, 0.9)
"""Of the range of a single input: where its fits start, beside where the parent says."""

STARTS = 4
"""Of one set, of which the most probable is followed."""

SCREENED, FOLLOWED = 256, 8
"""Sobol points from which the model as it is starts: points tried, and followed."""

ITERATIONS, LEAST_GAIN = 25, 5e-2
"""Of a fit in the search, and of its last step; what counts is fitted to the end later."""

AMPLITUDES = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Of a smooth departure, in units of its covariance; all equally probable."""

Members = tuple[int, ...]


@dataclass(frozen=True)
class Candidate:
    """A model: the places of its suspected inputs among all inputs, ascending, or the `amplitude`
    of a smooth departure in their place; log prior probability, log evidence and fit (M = 1). A set
    without fit has the log evidence that the search expects. `drawn` later, if at all."""

    members: Members
    log_prior: float
    log_evidence: float
    fit: Fits | None = None
    amplitude: float = 0.0
    drawn: WeightedDraws | None = None

    @property
    def log_posterior(self) -> float:
        """Not normalised."""
        return self.log_evidence + self.log_prior

    @property
    def departs(self) -> bool:
        """Whether it is another one than the model as it is."""
        return bool(self.members or self.amplitude)


def fit_base(potential: Potential, seed: int) -> Fits:
    """The model as it is (M = 1), fitted from its nominal values and from the most probable Sobol
    points."""
    inferred = np.flatnonzero(potential.inputs.of_role("inferred"))
    x, zero = potential.nominal[None], potential.nominal.new_zeros(1)
    error = potential.settle(x, zero)
    if len(inferred):
        low, high = (end[inferred].numpy() for end in (potential.low, potential.high))
        others = x.repeat(SCREENED, 1)
        points = sobol(SCREENED, low, high, "natural", derive(seed, "starts"))
        others[:, inferred] = torch.as_tensor(points)
        value = potential.log_density(potential.mean(others), others, error)
        x = torch.cat([x, others[value.topk(FOLLOWED).indices]])
    free = potential.free().expand_as(x)
    for _ in range(2):  # the second time with the covariance where the first one ended
        fits = fit(
            potential,
            free,
            zero.expand(len(x)),
            x,
            error,
            3 * ITERATIONS,
            LEAST_GAIN,
        )
        best = fits.row(int(fits.log_evidence.argmax()))
        x, error, free = best.x, best.error, free[:1]
    return best


def search(potential: Potential, largest: int, base: Fits) -> list[Candidate]:
    """All models that were judged, the most probable first.

    largest: of the sets. base: the model as it is (`fit_base`).
    """
    return _Search(potential, largest, base).run()


class Prior:
    """Log prior probability of sets of suspected inputs.

    causes: places of the inputs of each. largest: of the sets. departs: whether a smooth departure
    competes with them.
    """

    def __init__(self, causes: Mapping[str, Collection[int]], largest: int, departs: bool):
        self._shares = {name: dict.fromkeys(p, 1 / len(p)) for name, p in causes.items() if p}
        self._share = {k: share for own in self._shares.values() for k, share in own.items()}
        self._total = _sums(self._share.values(), largest)
        self._sizes = largest + 1 + departs

    @classmethod
    def of(cls, potential: Potential, largest: int) -> "Prior":
        """Over the inputs that a posterior's models may free."""
        searched = set(potential.searched)
        causes = {c: searched.intersection(places) for c, places in potential.causes.items()}
        return cls(causes, min(largest, len(searched)), potential.departure is not None)

    def __call__(self, members: Members) -> float:
        shares = math.prod(self._share[k] for k in members)
        return -math.log(self._sizes) - math.log(self._total[len(members)] / shares)

    def of_cause(self, name: str) -> float:
        """Prior probability that any input of a cause is free; 0 of one that no model may free."""
        others = (own.values() for cause, own in self._shares.items() if cause != name)
        without = _sums(itertools.chain(*others), len(self._total) - 1)
        return float((1 - without / self._total).sum() / self._sizes)


def _sums(shares: Iterable[float], largest: int) -> np.ndarray:
    """Elementary symmetric polynomials (largest + 1,): sums over all sets of each size."""
    total = np.zeros(largest + 1)
    total[0] = 1.0
    for share in shares:
        total[1:] += share * total[:-1]
    return total


class _Search:
    def __init__(self, potential: Potential, largest: int, base: Fits):
        self.potential = potential
        self.largest = min(largest, len(potential.searched))
        self.prior = Prior.of(potential, largest)
        self.found: dict[Members, Fits] = {(): base}
        self.expected: dict[Members, float] = {(): float(base.log_evidence)}
        self._grown: set[Members] = set()
        self._reduced: set[tuple[Members, Members]] = set()

    def run(self) -> list[Candidate]:
        for size in range(1, self.largest + 1):
            beam, most = (None, FITTED) if size <= EXHAUSTIVE else (BEAM, FITTED_BEYOND)
            for _ in range(ROUNDS):
                parents = [m for m in self._best(size - 1)[:beam] if m not in self._grown]
                self._enlarge(parents, most)
                self._shrink(size)
            best = max(map(self._log_posterior, self.found))
            if (
                size > EXHAUSTIVE
                and self._log_posterior(self._best(size)[0]) < best - LARGEST_DEFICIT
            ):
                break
        departures = self._departures() if self.potential.departure is not None else []
        sets = [
            Candidate(members, self.prior(members), evidence, self.found.get(members))
            for members, evidence in self.expected.items()
        ]
        log.info("models: %d of %d sets fitted", len(self.found), len(sets))
        return sorted([*sets, *departures], key=lambda c: -c.log_posterior)

    def _log_posterior(self, members: Members) -> float:
        return self.expected[members] + self.prior(members)

    def _best(self, size: int) -> list[Members]:
        """The fitted sets of one size, the most probable first."""
        return sorted(
            (m for m in self.found if len(m) == size), key=lambda m: -self._log_posterior(m)
        )

    # ----------------------------------------------------------------------------------- fits

    def _departures(self) -> list[Candidate]:
        base = self.found[()]
        amplitude = torch.tensor(AMPLITUDES, dtype=base.x.dtype)
        x = base.x.repeat(len(amplitude), 1)
        fits = fit(
            self.potential,
            base.free.expand_as(x),
            amplitude,
            x,
            self.potential.settle(x, amplitude),
            3 * ITERATIONS,
            LEAST_GAIN,
        )
        prior = self.prior(()) - math.log(len(amplitude))
        return [
            Candidate((), prior, float(fits.log_evidence[m]), fits.row(m), a)
            for m, a in enumerate(AMPLITUDES)
        ]

    def _fit(self, rows: list[tuple[Members, torch.Tensor, Fits]]) -> None:
        """Fit sets from starts (P,) with the covariance of their parents; what is found replaces
        what was worse."""
        if not rows:
            return
        free = torch.stack([self.potential.free(members) for members, _, _ in rows])
        x = torch.stack([start for _, start, _ in rows])
        errors = torch.cat([parent.error for _, _, parent in rows])
        amplitude = torch.zeros(len(rows), dtype=x.dtype)
        fits = fit(self.potential, free, amplitude, x, errors, ITERATIONS, LEAST_GAIN)
        for row, (members, _, _) in enumerate(rows):
            evidence = float(fits.log_evidence[row])
            if members not in self.found or evidence > self.expected[members]:
                self.found[members], self.expected[members] = fits.row(row), evidence

    def _most_probable(self, rows: list[tuple[Members, torch.Tensor, Fits]]) -> list:
        """One start of each set."""
        x = torch.stack([start for _, start, _ in rows])
        value = self.potential.log_density(self.potential.mean(x), x, self.found[()].error)
        best: dict[Members, int] = {}
        for row, (members, _, _) in enumerate(rows):
            if members not in best or value[row] > value[best[members]]:
                best[members] = row
        return [rows[row] for row in best.values()]

    # -------------------------------------------------------------------------------- growing

    def _enlarge(self, parents: Sequence[Members], most: int) -> None:
        """Judge all sets with one input more than `parents`, and fit the `most` promising ones."""
        grown: dict[Members, list[tuple[float, torch.Tensor, Fits]]] = {}
        for members, evidence, start, parent in self._grow(parents):
            grown.setdefault(members, []).append((evidence, start, parent))
        self._grown.update(parents)
        for members, starts in grown.items():
            starts.sort(key=lambda s: -s[0])
            if members not in self.found:
                known = self.expected.get(members, -math.inf)
                self.expected[members] = max(known, starts[0][0])
        promised = {m: starts[0][0] + self.prior(m) for m, starts in grown.items()}
        ranked = sorted(grown, key=lambda m: -promised[m])[:most]
        rows = [(m, x, parent) for m in ranked for _, x, parent in grown[m][:STARTS]]
        if () in parents:  # what single effects are like is not known yet
            rows += [row for members, x, parent in rows for row in self._spread(members, x, parent)]
        elif rows:
            rows = self._most_probable(rows)
        self._fit(rows)

    def _spread(self, members: Members, x: torch.Tensor, parent: Fits) -> Iterable:
        for share in SHARES:
            start = x.clone()
            start[members[0]] = (self.potential.low + share * self.potential.width)[members[0]]
            yield members, start, parent

    def _grow(self, parents: Sequence[Members]) -> Iterable:
        """(members, expected log evidence, start, parent) for every further input of each parent.

        The parent's coordinates follow the new one, but for those that are held at an end.
        """
        if not parents:
            return
        potential, width = self.potential, self.potential.width
        fits = Fits.join([self.found[m] for m in parents])
        x, gradient = fits.x, fits.gradient * width
        held = held_at_ends(potential, fits.free, x, gradient)
        inner = (fits.free & ~held).to(x.dtype)
        curvature = fits.curvature * width[:, None] * width
        coupled = curvature * inner[:, :, None]
        own = coupled * inner[:, None, :] + torch.diag_embed(1 - inner + WEAK * inner)
        follow = torch.linalg.solve(own, coupled)
        steps = torch.linalg.solve(own, (gradient * inner)[..., None])[..., 0]
        precision = (curvature.diagonal(dim1=-2, dim2=-1) - (coupled * follow).sum(1)).clamp(
            min=WEAK
        )
        slope = gradient - (coupled * steps[..., None]).sum(1)
        low, high = (potential.low - x) / width, (potential.high - x) / width
        centre = slope / precision
        log_mass, _, _ = cut(centre, 1 / precision, low, high)
        gain = 0.5 * (slope * centre - precision.log() + LOG_2PI) + log_mass
        move = torch.minimum(torch.maximum(centre, low), high)
        for row, members in enumerate(parents):
            parent = self.found[members]
            for k in set(potential.searched) - set(members):
                grown = tuple(sorted((*members, k)))
                evidence = self.expected[members] + float(gain[row, k])
                start = x[row] + (steps[row] - follow[row, :, k] * move[row, k]) * width
                start[k] = x[row, k] + move[row, k] * width[k]
                start = torch.minimum(torch.maximum(start, potential.low), potential.high)
                yield grown, evidence, start, parent

    def _shrink(self, size: int) -> None:
        """Take each input of the best sets of `size` away, and go on while that betters the best
        set of the smaller size."""
        while size > 0 and self._best(size):
            before = max(map(self._log_posterior, self._best(size - 1)), default=-math.inf)
            rows = []
            for members in self._best(size)[:BEAM]:
                for k in members:
                    left = tuple(m for m in members if m != k)
                    if (left, members) not in self._reduced:
                        self._reduced.add((left, members))
                        x = self.found[members].x[0].clone()
                        x[k] = self.potential.nominal[k]
                        rows.append((left, x, self.found[members]))
            self._fit(rows)
            size -= 1
            if self._log_posterior(self._best(size)[0]) <= before + LEAST_GAIN:
                break
