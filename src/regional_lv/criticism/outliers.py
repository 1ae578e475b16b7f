"""Whether what is far off are outliers: few channels that stand alone, with nothing in common."""

from collections.abc import Sequence

import numpy as np
import torch
from scipy import stats

from regional_lv import aha
from regional_lv.channels import Channel
from regional_lv.criticism.patterns import contrasts, hearts_of
from regional_lv.inference.evidence import Fits
from regional_lv.inference.observed import Observed
from regional_lv.inference.potential import Potential

FAR = 3.0
"""Standard deviations from which a channel counts as an outlier."""

NEIGHBOUR_FAR = 2.0
"""Standard deviations from which a channel beside an outlier is off as well: of the same segment in
another direction, or of a neighbouring segment in the same one."""

MOST = 0.15
"""Share of the channels that outliers are, at most."""

COMMON = 0.01
"""Chance below which so many outliers of one direction, level or wall are no accident."""


def standardised(potential: Potential, fitted: Fits) -> torch.Tensor:
    """Errors (D,) of a fit (M = 1) in the scale of their noise and the emulator's errors."""
    log_sigma = fitted.x[0, len(potential.inputs) :]
    variance = potential.observed.dense(fitted.error)[0].diagonal() + potential.noise.variance(
        log_sigma
    )
    return (potential.y - potential.mean(fitted.x)[0]) / variance.sqrt()


def why_not(z: torch.Tensor, observed: Observed) -> str:
    """Why the departures from a fit with heavy tails are no outliers; empty if they are.

    z (D,): `standardised` errors of the fit.
    """
    far, channels = z.abs() > FAR, observed.channels
    outliers = int(far.sum())
    if outliers > max(1, MOST * len(z)):
        return f"{outliers} of {len(z)} channels are off: too many for outliers"
    quantities = np.array([channel.quantity for channel in channels])
    for quantity in dict.fromkeys(quantities.tolist()):
        if bool(far[torch.as_tensor(quantities == quantity)].all()):
            return f"all of the {quantity} is off, which is no outlier"
    for at in hearts_of(observed):
        pair = _pair_of_outliers(z[at], channels[at])
        if pair:
            return f"{pair[0]} and {pair[1]} are off together"
    return _together(z, channels)


def _together(z: torch.Tensor, channels: Sequence[Channel]) -> str:
    """In which direction, level or wall, and on which side, too many outliers lie; or empty."""
    far = int((z.abs() > FAR).sum())
    patterns = [item for family in contrasts(channels).values() for item in family.items()]
    for name, pattern in patterns:
        share = float(pattern.sum()) / len(z)
        for side, where in (("above", z > FAR), ("below", z < -FAR)):
            hits = int((where & (pattern > 0)).sum())
            if hits < 2:
                continue
            chance = stats.binom.sf(hits - 1, far, share / 2)
            if chance * 2 * len(patterns) < COMMON:  # of either sign
                return f"the outliers lie together: {hits} of them are {name} and {side}"
    return ""


def _pair_of_outliers(z: torch.Tensor, channels: Sequence[Channel]) -> tuple[str, str] | None:
    """Names of an outlier and of a channel beside it that is off as well; z (D,) of one heart."""
    for far in torch.nonzero(z.abs() > FAR)[:, 0].tolist():
        for other in torch.nonzero(z.abs() > NEIGHBOUR_FAR)[:, 0].tolist():
            one, two = channels[far], channels[other]
            if far == other or not (one.segment and two.segment):
                continue
            same = one.quantity == two.quantity
            if one.segment == two.segment or (same and aha.adjoin(one.segment, two.segment)):
                return one.name, two.name
    return None
