"""What the uncertainty of the inferred inputs comes from.

About a fit, estimates are linear in what was measured, in the emulator's errors, and in the nominal
values of measured inputs; their variances add up to that of the posterior. The rest is what the
ends of ranges leave; and models differ.
"""

import numpy as np
import pandas as pd
import torch

from regional_lv.inference.averaging import Averaged
from regional_lv.inference.evidence import Fits
from regional_lv.inference.potential import Potential

NOISE, EMULATOR, RANGES, MODELS = "noise", "emulator", "ranges", "models"


def sources_of_variance(averaged: Averaged) -> pd.DataFrame:
    """Shares of the variance of each inferred input on its scale, averaged over models; rows add up
    to 1.

    Columns: `noise` of the measurement; `emulator`, its errors; each measured input; `ranges`, what
    is known by the ends of ranges alone; `models`, between them, and departures of no listed shape.
    """
    potential = averaged.potential
    inferred = np.flatnonzero(potential.inputs.of_role("inferred"))
    weight = averaged.probability[[*averaged.drawn]]
    weight = weight / weight.sum()
    means = np.array([d.weight @ d.x[:, inferred] for d in averaged.drawn.values()])
    fits = [fit for n in averaged.drawn if (fit := averaged.models[n].fit) is not None]
    starts = range(0, len(fits), potential.chunk)
    within = torch.cat(
        [_within(potential, Fits.join(fits[i : i + potential.chunk])) for i in starts]
    )
    parts = np.tensordot(weight, within[:, :, inferred].numpy(), axes=1)
    parts, departures = parts[:-1], parts[-1]
    between = departures + weight @ (means - weight @ means) ** 2
    columns = [NOISE, EMULATOR, *(_measured(potential)), RANGES, MODELS]
    table = pd.DataFrame(
        np.vstack([parts, between]).T,
        index=pd.Index([potential.inputs.names[k] for k in inferred], name="input"),
        columns=columns,
    )
    return table.div(table.sum(axis=1), axis=0)


def _measured(potential: Potential) -> list[str]:
    return [potential.inputs.names[k] for k in potential.measured.at]


def _within(potential: Potential, fitted: Fits) -> torch.Tensor:
    """Variances (M, sources, K) of M models, in the order of the columns; the last one is that of a
    smooth departure."""
    count = len(potential.inputs)
    covariance = fitted.covariance[:, :count, :count]
    mean, slopes = potential.linearise(fitted.x)
    whitening = potential.whitening(fitted.x, fitted.error)
    error = potential.observed.dense(fitted.error)
    departure = torch.zeros_like(error)
    if potential.departure is not None:
        shape = potential.observed.dense(potential.departure[None])
        departure = fitted.amplitude[:, None, None].square() * shape
    weights = potential.weights(fitted.x, potential.y - mean, whitening)
    # d(estimate)/d(whitened residual), then back in the units of the outputs.
    white = potential.observed.dense(whitening)
    gain = covariance @ (weights[:, None] * (white @ slopes).mT) @ white
    total = torch.linalg.inv(white.mT @ white)
    parts = [((gain @ part) * gain).sum(-1) for part in (total - error, error - departure)]
    by_departure = ((gain @ departure) * gain).sum(-1)
    if len(potential.measured):
        columns = covariance[:, :, potential.measured.at].square()
        parts += (columns * potential.measured.precision(fitted.x)[:, None]).unbind(-1)
    rest = covariance.diagonal(dim1=-2, dim2=-1) - torch.stack([*parts, by_departure]).sum(0)
    return torch.stack([*parts, rest.clamp(min=0.0), by_departure], 1)
