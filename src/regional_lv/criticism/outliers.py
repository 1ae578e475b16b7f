"""Whether what is far off are outliers: few channels that stand alone, with nothing in common."""

import itertools

import torch
from scipy import stats

from regional_lv import aha
from regional_lv.criticism.observations import contrasts

FAR = 3.0
"""Standard deviations from which a channel counts as an outlier."""

BESIDE = 2.0
"""Standard deviations from which a channel beside an outlier is off as well: of the same segment in
another direction, or of a neighbouring segment in the same one."""

MOST = 0.15
"""Share of the channels that outliers are, at most."""

COMMON = 0.01
"""Chance below which so many outliers of one direction, level or wall are no accident."""


def why_not(sampled) -> str:
    """Why the departures from a fit with heavy tails are no outliers; empty if they are.

    sampled: `verdict.Sampled` with tails.
    """
    model, observations = sampled.model, sampled.model.observations
    residual, _ = sampled.posterior.moments(sampled.posterior.residual)
    x, _ = sampled.posterior.moments(sampled.posterior.x)
    variance = model.error.diagonal(dim1=-2, dim2=-1) + model.noise_variance(x[None])[0]
    z = torch.where(observations.present, residual / variance.sqrt(), 0.0)
    far, count = z.abs() > FAR, int(observations.present.sum())
    if int(far.sum()) > max(1, MOST * count):
        return f"{int(far.sum())} of {count} channels are off: too many for outliers"
    for quantity in observations.channels.quantities:
        own = observations.present & torch.as_tensor(observations.channels.of_quantity(quantity))
        if own.any() and bool(far[own].all()):
            return f"all of the {quantity} is off, which is no outlier"
    for heart in z:
        company = _company(heart, observations.channels)
        if company:
            return f"{company[0]} and {company[1]} are off together"
    patterns = [item for family in contrasts(observations).values() for item in family.items()]
    for name, pattern in patterns:
        inside = observations.present & (pattern > 0)
        share = float(inside.sum()) / count
        for side, where in (("above", z > FAR), ("below", z < -FAR)):
            hits = int((where & inside).sum())
            if hits < 2:
                continue
            chance = stats.binom.sf(hits - 1, int(far.sum()), share / 2)
            if chance * 2 * len(patterns) < COMMON:  # of either sign
                return f"the outliers lie together: {hits} of them are {name} and {side}"
    return ""


def _company(z: torch.Tensor, channels) -> tuple[str, str] | None:
    """Names of an outlier and of a channel beside it that is off as well; z (D,) of one heart."""
    for far in torch.nonzero(z.abs() > FAR)[:, 0].tolist():
        for other in torch.nonzero(z.abs() > BESIDE)[:, 0].tolist():
            one, two = channels[far], channels[other]
            if far == other or not (one.segment and two.segment):
                continue
            same = one.quantity == two.quantity
            if one.segment == two.segment or (same and _neighbours(one.segment, two.segment)):
                return one.name, two.name
    return None


def _neighbours(one: int, two: int) -> bool:
    """Whether two segments share a border: in one ring, or in one wall of adjacent levels."""
    rings = [list(ring) for ring in aha.LEVELS.values()]
    for ring in rings:
        if one in ring and two in ring:
            apart = abs(ring.index(one) - ring.index(two))
            return apart in (1, len(ring) - 1)
    adjacent = any(
        {one, two} & set(upper) and {one, two} & set(lower)
        for upper, lower in itertools.pairwise(rings)
    )
    return adjacent and any({one, two} <= set(wall) for wall in aha.WALLS.values())
