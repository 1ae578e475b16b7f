"""Tests of one fitted model against directions in which it may be wrong, calibrated by bootstrap.

Most are score tests: with the errors e of a fit, their precision P and a pattern c of departures,
z = c'P e / sqrt(c'Q c), Q = P - P J (J'P J)^-1 J'P: what is left of the pattern after parameters
took what they can. Data and replicates are treated alike (`LinearModel.fit`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from regional_lv.criticism.contract import Largest
from regional_lv.criticism.identifiable import Identified, identify
from regional_lv.criticism.linear_model import LinearFit, LinearModel
from regional_lv.criticism.patterns import contrasts, groups_of
from regional_lv.inputs.base import Input

TAILS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4)
"""Values of 1 / nu that the test for heavy tails tries."""

MENTIONED = 5
"""Largest departures of each family that are named."""

ALIKE = 0.02
"""Share of two signatures' information that is not common, below which they count as one."""

ROUND_OFF = 1e-9
"""Share of a pattern's information, below which what the parameters leave of it is nothing."""

DEPARTURES, CAUSES = "departures", "causes"
"""The two groups of families."""


@dataclass(frozen=True)
class CauseTested:
    """What the tests say of a cause, in the place where it is most conspicuous.

    at: of the suspected input among all inputs. z: signed; p_single by itself; p_value over all
    causes together.
    """

    at: int
    name: str
    z: float
    p_single: float
    p_value: float
    identified: Identified


@dataclass(frozen=True)
class Tested:
    """p_value: over all families together, NaN with too few channels; families: p-value of the
    largest departure of each; causes: the most conspicuous first. largest_of_replicates (M,):
    largest |z| of any cause in data without."""

    p_value: float
    families: dict[str, float]
    largest: list[Largest]
    causes: tuple[CauseTested, ...]
    largest_of_replicates: torch.Tensor

    def critical_z(self, level: float) -> float:
        """|z| of a cause that the test over all of them asks for; 0 if none is tested."""
        null = self.largest_of_replicates
        return float(null.quantile(1 - level)) if len(null) else 0.0


def test(linear: LinearModel, causes: Sequence[int], replicates: int, seed: int) -> Tested:
    """Test a fitted model on its data, and the suspected inputs at the places `causes`.

    replicates: data sets of the bootstrap; the smallest p-value is one over one more than these.
    """
    here = linear.fit(linear.y[None])
    identified = {k: identify(linear, here, k) for k in causes}
    usable = [k for k, found in identified.items() if found.identifiable]
    battery = _Battery(linear, usable)
    if not linear.testable:
        tested, null = _of_causes(linear.inputs, identified, {})
        return Tested(math.nan, {}, [], tuple(tested), null)
    data = linear.replicates(here, replicates, seed)
    parts = [battery(here), *(battery(linear.fit(y)) for y in linear.batches(data))]
    values = {family: torch.cat([part[family] for part in parts]) for family in parts[0]}
    p_value, families, largest = _judge(values, battery.names)
    tested, null = _of_causes(linear.inputs, identified, battery.by_place(values))
    return Tested(p_value, families, largest, tuple(tested), null)


# ------------------------------------------------------------------------------- statistics


class _Battery:
    """All tests of a model: from fits to statistics (M, k) by family, large where it is wrong."""

    def __init__(self, linear: LinearModel, usable: Sequence[int]):
        self.linear = linear
        self.tails = linear.tails if linear.tails in usable else None
        self.causes = [k for k in usable if k != self.tails]
        self.signatures = linear.by_input[:, self.causes]
        self.cause_names = [linear.inputs[k].cause for k in self.causes]
        # A parameter whose nominal value is an end of its range can go one way only.
        x, low, high = (v[self.causes] for v in (linear.x, linear.lower, linear.upper))
        self._least = torch.where(x <= low, 0.0, -math.inf)
        self._most = torch.where(x >= high, 0.0, math.inf)
        self._groups = groups_of(linear.observed)
        structured = contrasts(linear.observed.channels)
        self._contrasts = {f: torch.stack([*found.values()], -1) for f, found in structured.items()}
        self.names: dict[str, Sequence[str]] = {
            "overall": ["all channels together"],
            "channel": linear.observed.names,
            **{family: list(found) for family, found in structured.items()},
        }

    def __call__(self, found: LinearFit) -> dict[str, torch.Tensor]:
        values = {}
        if not self.linear.noise.groups:
            values["overall"] = found.deviance[:, None]
        values["channel"] = self._by_channel(found)
        for family, patterns in self._contrasts.items():
            values[family] = score(found, patterns)
        if self.causes:
            z = score(found, self.signatures)
            z = torch.minimum(torch.maximum(z, self._least), self._most)
            values["cause"] = self._with_smaller_noise(found, z)
        if len(set(self.cause_names)) > 1:
            values["pair"] = pair_score(found, self.signatures, self.cause_names)[:, None]
        if self.tails is not None:
            sd = found.diagonal().clamp(min=1e-300).sqrt()
            values["tails"] = tail_score(found.pulled / sd)[:, None]
        return values

    def by_place(self, values: dict[str, torch.Tensor]) -> dict[int, torch.Tensor]:
        """Statistics (M,) of the suspected inputs, by their place among all inputs."""
        found = dict(zip(self.causes, values["cause"].T, strict=True)) if self.causes else {}
        return found if self.tails is None else {**found, self.tails: values["tails"][:, 0]}

    def _by_channel(self, found: LinearFit) -> torch.Tensor:
        """Errors (M, D) of predicting each channel from those outside its group, in their sds."""
        z = torch.zeros_like(found.pulled)
        for at in self._groups:
            whole = found.precision[:, at[:, None], at].diagonal(dim1=-2, dim2=-1)
            block = found.block(at) + ROUND_OFF * torch.diag_embed(whole)
            covariance = torch.linalg.inv(block)
            error = (covariance @ found.pulled[:, at, None])[..., 0]
            z[:, at] = error / covariance.diagonal(dim1=-2, dim2=-1).sqrt()
        return z

    def _with_smaller_noise(self, found: LinearFit, z: torch.Tensor) -> torch.Tensor:
        """Signed roots (M, k) of likelihood ratios of causes with scores z (M, k).

        Noise that is inferred has grown until the model without the cause fits; with it, each scale
        shrinks to what is left. If q is the square sum of a group's errors in its sds before, and
        q r after, the log likelihood gains q (r - 1 - log r) / 2 by that, beside z^2 / 2.
        """
        if not self.linear.noise.groups:
            return z
        information = found.information(self.signatures).clamp(min=1e-300)
        amplitude = z / information.sqrt()
        after = found.pulled[..., None] - amplitude[:, None] * found.left(self.signatures)
        variances = self.linear.variances(found)
        before = (variances @ found.pulled.square()[..., None]).clamp(min=1e-300)
        ratio = (variances @ after.square() / before).clamp(min=1e-300)
        gain = (before * (ratio - 1 - ratio.log())).sum(1)
        return z.sign() * (z.square() + gain).sqrt()


def score(found: LinearFit, patterns: torch.Tensor) -> torch.Tensor:
    """z (M, k) of patterns (D, k); zero for one of which the parameters leave nothing."""
    left, whole = found.information(patterns), found.whole(patterns)
    z = found.pulled @ patterns / left.clamp(min=1e-300).sqrt()
    return torch.where(left > ROUND_OFF * whole, z, 0.0)


def pair_score(found: LinearFit, patterns: torch.Tensor, names: Sequence[str]) -> torch.Tensor:
    """Root of the largest chi-squared (M,) of any two of the patterns (D, k) together, of different
    causes (`names`)."""
    slope, gram = found.pulled @ patterns, found.gram(patterns)
    size = gram.diagonal(dim1=-2, dim2=-1)
    determinant = size[:, :, None] * size[:, None] - gram.square()
    chi = (
        slope[:, :, None].square() * size[:, None]
        + slope[:, None].square() * size[:, :, None]
        - 2 * slope[:, :, None] * slope[:, None] * gram
    )
    apart = torch.tensor([[one != other for other in names] for one in names])
    # Two signatures that are all but the same say nothing together.
    known = apart & (determinant > ALIKE * size[:, :, None] * size[:, None])
    chi = torch.where(known, chi / determinant.clamp(min=1e-300), 0.0)
    return chi.flatten(1).amax(1).clamp(min=0.0).sqrt()


def tail_score(z: torch.Tensor) -> torch.Tensor:
    """Of Student's t against the normal, from standardised residuals z (M, n), over `TAILS`: signed
    root of the largest likelihood ratio (M,), zero if no heavy tail fits better."""
    normal = (-0.5 * z.square() - 0.5 * math.log(2 * math.pi)).sum(-1)
    ratios = [torch.zeros(len(z), dtype=z.dtype)]
    for inverse in TAILS:
        student = torch.distributions.StudentT(torch.tensor(1 / inverse, dtype=z.dtype))
        ratios.append(student.log_prob(z).sum(-1) - normal)
    return (2 * torch.stack(ratios).amax(0)).sqrt()


# ---------------------------------------------------------------------------------- p-values


def share_beyond(values: torch.Tensor) -> float:
    """Bootstrap p-value of the first of `values` (1 + M,), the others being those of replicates:
    the share at least as large, the first among them."""
    return float((values >= values[0] - 1e-12).double().mean())


def _judge(values: dict[str, torch.Tensor], names: dict[str, Sequence[str]]):
    """Overall p-value, that of each family, and the largest departures.

    Each family's statistic is its largest |z|, in sds of its replicates: p-values, being ranks,
    would need many more of these. There are two groups of families: what the listed causes do (the
    causes and their pairs), and departures of any kind. A group's statistic is the largest of its
    families'. The overall p-value is the smaller one of the groups', calibrated by the same
    replicates: a listed cause need not stand out among more families than its own.
    """
    families, largest = {}, []
    groups: dict[str, list[torch.Tensor]] = {}
    for family, found in values.items():
        size = found.abs()
        extreme = size.amax(-1)
        null = extreme[1:]
        if null.std() <= 0:  # nothing is left of any pattern
            continue
        families[family] = share_beyond(extreme)
        # The data and the replicates are one sample if the model is right, and scaled alike.
        group = CAUSES if family in ("cause", "pair") else DEPARTURES
        groups.setdefault(group, []).append((extreme - null.mean()) / null.std())
        for at in size[0].argsort(descending=True)[:MENTIONED] if family in names else ():
            p = share_beyond(torch.cat([size[:1, at], null]))
            z = float(found[0, at])
            largest.append(Largest(family=family, what=names[family][at], z=z, p_value=p))
    ranks = [_ranks(torch.stack(group).amax(0)) for group in groups.values()]
    smallest = torch.stack(ranks).amin(0)
    return float((smallest <= smallest[0]).double().mean()), families, largest


def _ranks(values: torch.Tensor) -> torch.Tensor:
    """How many of `values` (n,) are at least as large as each of them (n,)."""
    ordered = values.sort().values
    return len(values) - torch.searchsorted(ordered, values - 1e-12)


def _of_causes(
    inputs: Sequence[Input], identified: dict[int, Identified], z: dict[int, torch.Tensor]
) -> tuple[list[CauseTested], torch.Tensor]:
    """What the tests say of each cause among the places `identified`, and the largest |z| (M,) of
    any in the replicates. z (1 + M,): of the places that were tested."""
    largest = torch.stack([*z.values()]).abs().amax(0) if z else torch.zeros(0)
    places: dict[str, list[int]] = {}
    for k in identified:
        places.setdefault(inputs[k].cause, []).append(k)
    found = []
    for members in places.values():
        tried = [k for k in members if k in z]
        at, own, p = members[0], torch.zeros(1), (1.0, 1.0)
        if tried:
            at = max(tried, key=lambda k: abs(float(z[k][0])))
            own = torch.stack([z[k] for k in tried]).abs().amax(0)
            p = share_beyond(own), share_beyond(torch.cat([own[:1], largest[1:]]))
        score_there = float(z[at][0]) if tried else 0.0
        found.append(CauseTested(at, inputs[at].cause, score_there, *p, identified[at]))
    found.sort(key=lambda c: (not c.identified.identifiable, c.p_value, -abs(c.z)))
    return found, largest[1:]
