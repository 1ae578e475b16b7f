"""Tests of one fitted model against directions in which it may be wrong, calibrated by bootstrap.

All of them are score tests: with whitened residual r, whitened Jacobian J and a whitened pattern c,
z = c'Q r / sqrt(c'Q c), Q = I - J (J'J + L)^-1 J': what is left of the pattern after the parameters
took what they can. L is a weak prior precision, so that flat directions stay finite.
"""

import math
from dataclasses import dataclass

import torch

from regional_lv.criticism.fit import Fit, fit, white
from regional_lv.criticism.model import Model
from regional_lv.criticism.observations import contrasts
from regional_lv.progress import Progress

BATCH = 250
"""Data sets that are fitted at once, at most."""

LARGEST_MATRICES = 5e7
"""Numbers in the projections of those fitted at once: several hearts together make them large."""

TAILS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4)
"""Values of 1 / nu that the test for heavy tails tries."""

MENTIONED = 5
"""Largest departures of each family that are named."""

ALIKE = 0.02
"""Share of two signatures' information that is not common, below which they count as one."""

FEWEST_FOR_TAILS = 20
"""Number of channels below which the tails of the noise are not tested."""


@dataclass(frozen=True)
class Projected:
    """Fits with what the parameters can take projected out.

    residual: Q r (M, n). precision: Q (M, n, n), both back in natural units: W'Q W and W'Q W e,
    over n = S D channels, zero where nothing was observed. plain: W'W (M or 1, n, n).
    gain: (J'J + L)^-1 J'W (M, R, n), what a change of the outputs does to the parameters.
    """

    residual: torch.Tensor
    precision: torch.Tensor
    plain: torch.Tensor
    gain: torch.Tensor

    @classmethod
    def of(cls, found: Fit, model: Model, prior: float = 1.0) -> "Projected":
        """`prior` multiplies the weak prior precision."""
        m, s, d = found.residual.shape
        w = _block_diagonal(found.whitening)
        slopes = white(found.whitening, found.jacobian).reshape(m, s * d, -1)
        information = slopes.mT @ slopes + torch.diag(prior * model.prior_precision)
        solved = torch.linalg.solve(information, slopes.mT)  # (M, R, n)
        q = torch.eye(s * d, dtype=w.dtype) - slopes @ solved
        precision = w.mT @ q @ w
        error = found.residual.reshape(m, -1, 1)
        return cls((precision @ error)[..., 0], precision, w.mT @ w, solved @ w)

    def score(self, pattern: torch.Tensor) -> torch.Tensor:
        """z (M, K) of patterns (n, K) or (M, n, K); zero for one of which nothing is left."""
        explained = (pattern * self.residual[..., None]).sum(-2)
        left = self.information(pattern)
        whole = (pattern * (self.plain @ pattern)).sum(-2)
        return torch.where(left > 1e-10 * whole, explained / left.clamp(min=1e-300).sqrt(), 0.0)

    def information(self, pattern: torch.Tensor) -> torch.Tensor:
        """c'Q c (M, K): one over the variance of the pattern's amplitude."""
        return (pattern * (self.precision @ pattern)).sum(-2)

    def absorbed(self, pattern: torch.Tensor) -> torch.Tensor:
        """Share (M, K) of a pattern's information that the parameters take up."""
        whole = (pattern * (self.plain @ pattern)).sum(-2)
        return 1 - self.information(pattern) / whole.clamp(min=1e-300)

    def left_out(self, groups: list[torch.Tensor]) -> tuple[torch.Tensor, torch.Tensor]:
        """Errors of predicting each group of channels (indices) from all others, and their sd.

        (M, n) each: the linear form of a refit, [Q_gg^-1 (Q r)_g] with covariance Q_gg^-1.
        """
        error, variance = torch.zeros_like(self.residual), torch.ones_like(self.residual)
        for at in groups:
            block = torch.linalg.inv(self.precision[:, at[:, None], at])
            error[:, at] = (block @ self.residual[:, at, None])[..., 0]
            variance[:, at] = block.diagonal(dim1=-2, dim2=-1)
        return error, variance.sqrt()


def _block_diagonal(w: torch.Tensor) -> torch.Tensor:
    """(..., S, D, D) -> (..., S D, S D)."""
    s, d = w.shape[-3:-1]
    full = w.new_zeros(*w.shape[:-3], s, d, s, d)
    for i in range(s):
        full[..., i, :, i, :] = w[..., i, :, :]
    return full.reshape(*w.shape[:-3], s * d, s * d)


@dataclass(frozen=True)
class Statistics:
    """Values of every test for M data sets, large when the model is wrong.

    misfit: family -> (M, K). names: family -> what each column is. causes: (M, C), signed z of
    each candidate; for one whose parameter can go one way only, the other way counts as zero.
    pairs: (M,), root of the largest chi-squared of any two causes together. tails: (M,); None with
    few channels.
    """

    misfit: dict[str, torch.Tensor]
    names: dict[str, tuple[str, ...]]
    causes: torch.Tensor
    pairs: torch.Tensor
    tails: torch.Tensor | None


def statistics(model: Model, found: Fit, extensions) -> Statistics:
    """All tests of the fits in `found`; `extensions`: the candidate causes with a signature."""
    projected = Projected.of(found, model)
    o = model.observations
    misfit: dict[str, torch.Tensor] = {}
    names: dict[str, tuple[str, ...]] = {}
    if not o.noise.groups:
        misfit["overall"] = found.deviance[:, None]
        names["overall"] = ("all channels together",)
    error, sd = projected.left_out(_channel_groups(model))
    here = o.present.flatten()
    misfit["channel"] = (error / sd)[:, here]
    names["channel"] = tuple(
        name if len(o.subjects) == 1 else f"{subject}: {name}"
        for subject, row in zip(o.subjects, o.present, strict=True)
        for name, seen in zip(o.outputs, row, strict=True)
        if seen
    )
    for family, patterns in contrasts(o).items():
        columns = torch.stack([*patterns.values()], dim=-1).repeat(len(o.subjects), 1)
        columns = torch.where(here[:, None], columns, 0.0)
        misfit[family], names[family] = projected.score(columns), tuple(patterns)
    tails = None
    if here.sum() >= FEWEST_FOR_TAILS:
        diagonal = projected.precision.diagonal(dim1=-2, dim2=-1)[:, here]
        standard = projected.residual[:, here] / diagonal.clamp(min=1e-300).sqrt()
        tails = tail_score(standard)
    signatures = [pattern_of(model, e, found.x) for e in extensions]
    scores = [
        _one_way(projected.score(signature)[:, 0], e.hypothesis)
        for signature, e in zip(signatures, extensions, strict=True)
    ]
    none = torch.zeros(len(found.x), 0).double()
    causes = torch.stack(scores, -1) if scores else none
    pairs = pair_score(projected, signatures, [e.hypothesis.name for e in extensions])
    return Statistics(misfit, names, causes, pairs, tails)


def pattern_of(model: Model, extension, x: torch.Tensor) -> torch.Tensor:
    """Signature of an extension as a pattern (M, n, 1), zero where nothing was observed."""
    signature = model.signature(extension, x)
    return torch.where(model.observations.present, signature, 0.0).flatten(1)[..., None]


def cause_score(model: Model, projected: Projected, x: torch.Tensor, extension) -> torch.Tensor:
    """Signed z (M,) of one cause; a parameter at an end of its range moves one way only."""
    z = projected.score(pattern_of(model, extension, x))[:, 0]
    return _one_way(z, extension.hypothesis)


def _one_way(z: torch.Tensor, hypothesis) -> torch.Tensor:
    if hypothesis.base <= hypothesis.low:
        return z.clamp(min=0.0)
    return z.clamp(max=0.0) if hypothesis.base >= hypothesis.high else z


def pair_score(projected: Projected, patterns: list, names: list[str]) -> torch.Tensor:
    """Root of the largest chi-squared (M,) of any two of the `patterns` (M, n, 1) together, of
    different causes (`names`); zero if there are no two."""
    largest = torch.zeros(len(projected.residual), dtype=projected.residual.dtype)
    if len(set(names)) < 2:
        return largest
    together = torch.cat(patterns, dim=-1)
    slope = (together * projected.residual[..., None]).sum(-2)
    gram = together.mT @ (projected.precision @ together)
    size = gram.diagonal(dim1=-2, dim2=-1)
    determinant = size[:, :, None] * size[:, None, :] - gram.square()
    chi = (
        slope[:, :, None].square() * size[:, None, :]
        + slope[:, None, :].square() * size[:, :, None]
        - 2 * slope[:, :, None] * slope[:, None, :] * gram
    )
    apart = torch.tensor([[one != other for other in names] for one in names])
    # Two signatures that are all but the same say nothing together.
    known = apart & (determinant > ALIKE * size[:, :, None] * size[:, None, :])
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


def _channel_groups(model: Model) -> list[torch.Tensor]:
    """Indices into the S D channels of each group that is left out together, heart by heart."""
    o = model.observations
    d = len(o.outputs)
    found = []
    for mask in o.groups.values():
        for i in range(len(o.subjects)):
            at = torch.nonzero(mask & o.present[i])[:, 0]
            if len(at):
                found.append(i * d + at)
    return found


def replicates_of(model: Model, best: Fit, count: int, seed: int) -> torch.Tensor:
    """Data sets (count, S, D) drawn from the fitted model, zero where nothing was observed."""
    generator = torch.Generator().manual_seed(seed)
    factor = torch.linalg.cholesky(model.covariance(best.x))
    mean = model.observations.y - best.residual[0]
    deviates = torch.randn(count, *mean.shape, generator=generator, dtype=torch.float64)
    y = mean + (factor @ deviates[..., None])[..., 0]
    return torch.where(model.observations.present, y, 0.0)


def bootstrap(model: Model, best: Fit, extensions, replicates: int, seed: int) -> Statistics:
    """`statistics` of data drawn from the fitted model, each fitted anew (M = replicates)."""
    data = replicates_of(model, best, replicates, seed)
    batch = max(1, min(BATCH, int(LARGEST_MATRICES / data[0].numel() ** 2)))
    parts, progress = [], Progress("bootstrap", replicates)
    for y in data.split(batch):
        found = fit(model, y, best.x.repeat(len(y), 1))
        parts.append(statistics(model, found, extensions))
        progress.step(count=len(y))
    return Statistics(
        {k: torch.cat([part.misfit[k] for part in parts]) for k in parts[0].misfit},
        parts[0].names,
        torch.cat([part.causes for part in parts]),
        torch.cat([part.pairs for part in parts]),
        None if parts[0].tails is None else torch.cat([part.tails for part in parts]),
    )


def share_beyond(value: float, null: torch.Tensor) -> float:
    """Bootstrap p-value: the share of `null` at least as large, the data among them."""
    return (1 + int((null >= value - 1e-12).sum())) / (1 + len(null))


@dataclass(frozen=True)
class Misfit:
    """Calibrated verdict on a fit: p-values per family (each of its largest departure), over all
    families together, and the largest departures: (family, name, z, p over its family)."""

    p_value: float
    families: dict[str, float]
    largest: list[tuple[str, str, float, float]]


def judge_misfit(observed: Statistics, null: Statistics, tails: bool = False) -> Misfit:
    """Families are tested by their largest |z|; those of one of two groups together, by the largest
    of these in sds of their replicates: smallest p-values, being ranks, would need many more
    replicates. The groups are what the listed causes do (the causes and their pairs), and
    departures of any kind (the others; if `tails`, with the tails of the noise). The smaller
    p-value of the two, calibrated, is that of the whole search: a listed cause need not stand out
    among more families than its own.
    """
    families, largest = {}, []
    departures: list[torch.Tensor] = []
    causes: list[torch.Tensor] = []

    def judge(family: str, seen: torch.Tensor, extreme: torch.Tensor, group: list) -> None:
        families[family] = share_beyond(float(seen), extreme)
        # The data and the replicates are one sample if the model is right, and scaled alike.
        pool = torch.cat([seen[None], extreme])
        group.append((pool - extreme.mean()) / extreme.std())

    for family, values in null.misfit.items():
        extreme = values.abs().amax(-1)
        seen = observed.misfit[family][0]
        judge(family, seen.abs().max(), extreme, departures)
        for at in seen.abs().argsort(descending=True)[:MENTIONED]:
            p = share_beyond(float(seen[at].abs()), extreme)
            largest.append((family, null.names[family][at], float(seen[at]), p))
    if null.causes.shape[1]:
        judge("cause", observed.causes[0].abs().max(), null.causes.abs().amax(-1), causes)
    if null.pairs.any():  # else there are no two causes that differ
        judge("pair", observed.pairs[0], null.pairs, causes)
    if tails:
        assert observed.tails is not None
        judge("tails", observed.tails[0], null.tails, departures)
    groups = [torch.stack(group).amax(0) for group in (departures, causes) if group]
    smallest = torch.stack([_ranks(values) for values in groups]).amin(0)
    p_value = float((smallest <= smallest[0]).double().mean())
    return Misfit(p_value, families, largest)


def _ranks(values: torch.Tensor) -> torch.Tensor:
    """How many of `values` (n,) are at least as large as each of them (n,)."""
    ordered = values.sort().values
    return len(values) - torch.searchsorted(ordered, values - 1e-12)
