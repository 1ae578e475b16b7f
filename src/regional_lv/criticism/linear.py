"""Posterior, evidence and leave-one-segment-out prediction by Laplace approximation.

For several hearts of unknown theta together: so many coordinates are too many to sample by
importance. Exact where the model is linear in its coordinates and no bound is near.
"""

import math
from dataclasses import fields

import torch

from regional_lv.criticism.fit import Fit, fit
from regional_lv.criticism.model import Model
from regional_lv.criticism.posterior import LeftOut, Posterior, laplace, put
from regional_lv.criticism.search import log_evidence


def approximate(model: Model, best: Fit, draws: int, seed: int) -> Posterior:
    """Draws from the normal approximation at a fit (M = 1), cut at the bounds; its evidence."""
    centre, covariance = laplace(model, best)
    factor = torch.linalg.cholesky(covariance)
    generator = torch.Generator().manual_seed(seed)
    deviates = torch.randn(draws, len(centre), generator=generator, dtype=torch.float64)
    x = torch.minimum(torch.maximum(centre + deviates @ factor.mT, model.low), model.high)
    evidence = float(log_evidence(model, best)[0])
    weight = torch.full((draws,), -math.log(draws), dtype=torch.float64)
    return Posterior(model, x, weight, evidence, math.nan, float(draws), best.residual)


def leave_out_linearly(model: Model, best: Fit) -> LeftOut:
    """Each fold refitted; the prediction of what is left out is normal, given the residuals of the
    others, with the covariance of the parameters carried through the Jacobian."""
    o = model.observations
    mean, sd = torch.zeros_like(o.y), torch.ones_like(o.y)
    numbers = list(o.groups)
    masks = torch.stack([(~o.groups[n]).expand_as(o.present) for n in numbers])
    count = len(numbers)
    found = fit(model, o.y.expand(count, -1, -1), best.x.repeat(count, 1), masks)
    elpd, joint = [], []
    for i, number in enumerate(numbers):
        at = torch.nonzero(o.groups[number])[:, 0]
        single = Fit(*(getattr(found, field.name)[i : i + 1] for field in fields(Fit)))
        _, covariance = laplace(model, single)
        r = model.means
        # Errors of the emulator are common to channels: those of the others tell of these.
        precision = torch.cholesky_inverse(torch.linalg.cholesky(model.covariance(single.x)[0]))
        own = torch.linalg.inv(precision[:, at[:, None], at])
        both = torch.cat([found.residual[i][..., None], found.jacobian[i]], dim=-1)
        both = torch.where(o.present[..., None], both, 0.0)
        given = (own @ (precision @ both)[:, at]).flatten(0, 1)
        here = o.present[:, at].flatten()
        flat = given[:, 1:]
        spread = torch.block_diag(*own) + flat @ covariance[:r, :r] @ flat.mT
        error = given[:, 0][here]
        kept = spread[here][:, here]
        normal = torch.distributions.MultivariateNormal(torch.zeros_like(error), kept)
        elpd.append(normal.log_prob(error))
        observed = o.y[:, at].flatten()[here]
        joint.append((observed - error, kept))
        put(mean, at, o.present, observed - error)
        put(sd, at, o.present, kept.diagonal().sqrt())
    return LeftOut(tuple(numbers), torch.stack(elpd), tuple(joint), mean, sd, 1.0, math.inf)
