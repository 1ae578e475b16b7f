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

FEWEST_FOR_TAILS = 20
"""Channels below which nothing is said about the tails of the noise."""


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
    tails: (M,), and the log evidence (M,) of heavy tails against none; None with few channels.
    """

    misfit: dict[str, torch.Tensor]
    names: dict[str, tuple[str, ...]]
    causes: torch.Tensor
    tails: torch.Tensor | None
    tail_evidence: torch.Tensor | None


def statistics(model: Model, found: Fit, extensions) -> Statistics:
    """All tests of the fits in `found`; `extensions`: the candidate causes with a signature."""
    projected = Projected.of(found, model)
    o = model.observations
    misfit, names = {}, {}
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
    tails = tail_evidence = None
    if here.sum() >= FEWEST_FOR_TAILS:
        diagonal = projected.precision.diagonal(dim1=-2, dim2=-1)[:, here]
        standard = projected.residual[:, here] / diagonal.clamp(min=1e-300).sqrt()
        tails, tail_evidence = tail_score(standard)
    scores = [cause_score(model, projected, found.x, e) for e in extensions]
    causes = torch.stack(scores, -1) if scores else torch.zeros(len(found.x), 0).double()
    return Statistics(misfit, names, causes, tails, tail_evidence)


def pattern_of(model: Model, extension, x: torch.Tensor) -> torch.Tensor:
    """Signature of an extension as a pattern (M, n, 1), zero where nothing was observed."""
    signature = model.signature(extension, x)
    return torch.where(model.observations.present, signature, 0.0).flatten(1)[..., None]


def cause_score(model: Model, projected: Projected, x: torch.Tensor, extension) -> torch.Tensor:
    """Signed z (M,) of one cause; a parameter at an end of its range moves one way only."""
    z = projected.score(pattern_of(model, extension, x))[:, 0]
    h = extension.hypothesis
    if h.base <= h.low:
        return z.clamp(min=0.0)
    return z.clamp(max=0.0) if h.base >= h.high else z


def tail_score(z: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Of Student's t against the normal, from standardised residuals z (M, n), over `TAILS`: signed
    root of the largest likelihood ratio (M,), zero if no heavy tail fits better; and the log of
    the mean ratio (M,), the evidence under a uniform prior on 1 / nu."""
    normal = (-0.5 * z.square() - 0.5 * math.log(2 * math.pi)).sum(-1)
    ratios = [torch.zeros(len(z), dtype=z.dtype)]
    for inverse in TAILS:
        student = torch.distributions.StudentT(torch.tensor(1 / inverse, dtype=z.dtype))
        ratios.append(student.log_prob(z).sum(-1) - normal)
    ratios = torch.stack(ratios)
    edges = torch.tensor((0.0, *TAILS), dtype=z.dtype)
    return (2 * ratios.amax(0)).sqrt(), torch.trapezoid(ratios.exp(), edges, dim=0).log() - (
        edges[-1].log()
    )


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
        None if parts[0].tails is None else torch.cat([part.tails for part in parts]),
        None,
    )


def share_beyond(value: float, null: torch.Tensor) -> float:
    """Bootstrap p-value: the share of `null` at least as large, the data among them."""
    return float((1 + (null >= value - 1e-12).sum()) / (1 + len(null)))


@dataclass(frozen=True)
class Misfit:
    """Calibrated verdict on a fit: p-values per family (each of its largest departure), over all
    families together, and the largest departures: (family, name, z, p over its family)."""

    p_value: float
    families: dict[str, float]
    largest: list[tuple[str, str, float, float]]


def judge_misfit(observed: Statistics, null: Statistics) -> Misfit:
    """Families are tested by their largest |z|; together, by the largest of these in sds of their
    replicates: smallest p-values, being ranks, would need many more replicates."""
    families, scaled, largest = {}, [], []
    for family, values in null.misfit.items():
        extreme = values.abs().amax(-1)
        seen = observed.misfit[family][0]
        families[family] = share_beyond(float(seen.abs().max()), extreme)
        # The data and the replicates are one sample if the model is right, and scaled alike.
        pool = torch.cat([seen.abs().max()[None], extreme])
        scaled.append((pool - extreme.mean()) / extreme.std())
        for at in seen.abs().argsort(descending=True)[:MENTIONED]:
            p = share_beyond(float(seen[at].abs()), extreme)
            largest.append((family, null.names[family][at], float(seen[at]), p))
    together = torch.stack(scaled).amax(0)
    return Misfit(share_beyond(float(together[0]), together[1:]), families, largest)
