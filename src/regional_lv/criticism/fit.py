"""Thousands of fits of one model at once, with exact Jacobians (`inference.optimise`)."""

import math
from dataclasses import dataclass

import numpy as np
import torch

from regional_lv.criticism.model import Model
from regional_lv.design import sobol
from regional_lv.inference.optimise import maximise
from regional_lv.seeds import derive

ITERATIONS = 60
STARTS, SCREENED = 12, 512
"""Fits of the data themselves: points kept, and points tried."""

LEAST_GAIN, LEAST_MOVE = 1e-6, 1e-8
"""Of the objective and of a coordinate, at which a fit ends."""

FIRST_SIGMA = 0.3
"""Noise scale that fits start from, in training sd."""


@dataclass(frozen=True)
class Fit:
    """M fits: x (M, P), objective (M,), residual y - mean (M, S, D), jacobian (M, S, D, R) and
    whitening (M or 1, S, D, D) where they ended."""

    x: torch.Tensor
    objective: torch.Tensor
    residual: torch.Tensor
    jacobian: torch.Tensor
    whitening: torch.Tensor

    @property
    def deviance(self) -> torch.Tensor:
        """Squared length of the whitened residual (M,): chi-squared if the model is right."""
        return white(self.whitening, self.residual[..., None]).square().sum((-3, -2, -1))


def white(whitening: torch.Tensor, columns: torch.Tensor) -> torch.Tensor:
    """W c for columns (..., S, D, K)."""
    return whitening @ columns


def fit(
    model: Model,
    y: torch.Tensor,
    start: torch.Tensor,
    mask: torch.Tensor | None = None,
    iterations: int = ITERATIONS,
    active: torch.Tensor | None = None,
) -> Fit:
    """Maximise the density of theta, psi and noise scales for every row of y (M, S, D).

    start: (M, P). mask: (M, S, D) or (1, S, D), channels to fit to; all that were observed if None.
    active: (M, k), which extensions are fitted in each row, the others staying at their base value;
    all if None.
    The prior is uniform in the box and half-normal in the noise scales; the maximum is that of
    the density of theta, psi and sigma themselves, as in `inference.point`.
    """
    shared = None
    if model.first_sigma == start.shape[1]:
        shared = model.whitening(start[:1], mask)
    residual = torch.empty_like(y)
    jacobian = y.new_empty(*y.shape, model.means)
    # A psi counts in shares of its range: degrees and pressures are no logarithms.
    unit = torch.ones_like(model.low)
    unit[model.psi] = (model.high - model.low)[model.psi]
    low, high = (edge.expand_as(start).clone() for edge in (model.low, model.high))
    if active is not None:
        fixed = torch.zeros_like(start, dtype=torch.bool)
        fixed[:, model.psi] = ~active
        low, high = torch.where(fixed, start, low), torch.where(fixed, start, high)

    def value(rows, u):
        x = u * unit
        w = _whitening(model, shared, mask, rows, x)
        return _objective(model, w, y[rows] - model.mean(x), x)

    def derivatives(rows, u):
        x = u * unit
        mean, jacobian[rows] = model.linearise(x, None if active is None else active[rows])
        residual[rows] = y[rows] - mean
        w = _whitening(model, shared, mask, rows, x)
        gradient, curvature = normal_equations(model, w, residual[rows], jacobian[rows], x)
        return gradient * unit, curvature * unit[:, None] * unit

    u, objective, _ = maximise(
        *(value, derivatives, start / unit, low / unit, high / unit),
        *(iterations, LEAST_GAIN, LEAST_MOVE),
    )
    x = torch.minimum(torch.maximum(u * unit, model.low), model.high)
    if active is not None:
        x = torch.where(fixed, start, x)  # to the last digit
    w = _whitening(model, shared, mask, torch.arange(len(x)), x)
    return Fit(x, objective, residual, jacobian, w)


def _whitening(model, shared, mask, rows, x):
    if shared is None:
        part = mask[rows] if mask is not None and len(mask) > 1 else mask
        return model.whitening(x, part)
    return shared[rows] if len(shared) > 1 else shared


def _objective(model, w, residual, x):
    distance = white(w, residual[..., None]).square().sum((-3, -2, -1))
    diagonal = w.diagonal(dim1=-2, dim2=-1)
    logs = torch.where(diagonal > 0, diagonal, 1.0).log().sum((-2, -1))
    noise, scales = model.observations.noise, torch.exp(2 * x[:, model.first_sigma :]).sum(-1)
    return -0.5 * distance + logs - 0.5 * scales / noise.prior_scale**2


def normal_equations(model, w, residual, jacobian, x):
    """Gradient (M, P) and expected information (M, P, P) of the objective."""
    m, p, r = len(x), x.shape[1], jacobian.shape[-1]
    slopes = white(w, jacobian).flatten(1, 2)
    error = white(w, residual[..., None])
    gradient, curvature = x.new_zeros(m, p), x.new_zeros(m, p, p)
    gradient[:, :r] = (slopes.mT @ error.flatten(1, 2))[..., 0]
    curvature[:, :r, :r] = slopes.mT @ slopes
    first, noise = model.first_sigma, model.observations.noise
    if first < p:
        precision = w.mT @ w
        alpha = (w.mT @ error)[..., 0]
        change = 2 * torch.exp(2 * x[:, first:])[:, :, None] * noise.units.square()  # (M, G, D)
        by_change = 0.5 * (alpha.square() - precision.diagonal(dim1=-2, dim2=-1)).sum(1)
        gradient[:, first:] = (change * by_change[:, None, :]).sum(-1)
        shared = 0.5 * precision.square().sum(1)  # sum over hearts of P_ij^2 / 2
        curvature[:, first:, first:] = change @ shared @ change.mT
        prior = torch.exp(2 * x[:, first:]) / noise.prior_scale**2
        gradient[:, first:] -= prior
        curvature.diagonal(dim1=-2, dim2=-1)[:, first:] += 2 * prior
    return gradient, curvature


def fit_best(model: Model, starts: torch.Tensor) -> Fit:
    """The best of fits of the observations from `starts` (M, P), a `Fit` with M = 1.

    The emulator's covariance is settled at the best of a first round, then at that of a second.
    """
    model.settle(starts[0])
    for _ in range(2):
        y = model.observations.y.expand(len(starts), -1, -1)
        found = fit(model, y, starts)
        starts = found.x[found.objective.argmax()][None].clone()
        model.settle(starts[0])
    return fit(model, model.observations.y[None], starts)


def fit_from_nothing(model: Model, seed: int) -> Fit:
    """As `fit_best`, from the most likely ones of Sobol points, for models without extensions.

    Several hearts whose theta is unknown are first fitted one by one.
    """
    count = len(model.layout.names)
    x = torch.full((SCREENED, len(model.low)), math.log(FIRST_SIGMA), dtype=torch.float64)
    if not model.layout.uniform_in_theta:
        x[:, :count] = 0.0
        return fit_best(model, x[:1])
    parameters = model.layout.parameters
    p = len(parameters)
    if count > p:
        alone = [fit_from_nothing(single, seed).x[0] for single in model.apart()]
        x = torch.cat([part[:p] for part in alone] + [torch.stack(alone).mean(0)[p:]])
        return fit_best(model, x[None])
    points = [
        sobol(
            *(SCREENED // 2, parameters.lower, parameters.upper, scale),
            derive(seed, "starts", scale),
        )
        for scale in ("natural", "log")
    ]
    x[:, :p] = torch.as_tensor(np.concatenate(points)).log()
    model.settle(x[0])
    w = model.whitening(x)
    values = _objective(model, w, model.observations.y - model.mean(x), x)
    return fit_best(model, x[values.topk(STARTS).indices])
