"""Whether what is far off are outliers: few channels that have nothing in common."""

import torch
from scipy import stats

from regional_lv.criticism.observations import contrasts

FAR = 3.0
"""Standard deviations from which a channel counts as an outlier."""

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
    patterns = [item for family in contrasts(observations).values() for item in family.items()]
    for name, pattern in patterns:
        inside = observations.present & (pattern > 0)
        share = float(inside.sum()) / count
        for side, where in (("above", z > FAR), ("below", z < -FAR)):
            hits = int((where & inside).sum())
            if hits < 2:
                continue
            chance = stats.binom.sf(hits - 1, int(far.sum()), share / 2)
            if chance * len(patterns) < COMMON:
                return f"the outliers lie together: {hits} of them are {name} and {side}"
    return ""
