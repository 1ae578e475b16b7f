"""Point estimates: the maximum of the posterior density of theta, for many cases at once.

The prior is uniform, so this is the maximum of the likelihood within the bounds, with the
predictive covariance and its determinant. It is sought in theta itself (steps are taken in log
theta, which only scales them): the maximum of a density depends on the variable it is a density
of, and the unconstrained variable of the sampler would move it.
"""

import logging
from dataclasses import dataclass

import numpy as np
import torch

from regional_lv.emulators.base import Emulator, join
from regional_lv.inference.noise import LOG_SIGMA_BOUNDS
from regional_lv.inference.optimise import maximise
from regional_lv.inference.potential import CHUNK
from regional_lv.paper.sampler.likelihood import Likelihood
from regional_lv.seeds import derive
from regional_lv.simulation.sobol import sobol

log = logging.getLogger(__name__)

SCREENED_PER_START = 64
"""Sobol points tried for each start that is kept."""

TEMPERING = (0.3, 0.03)
"""Noise (in training sd) added in the first passes: without it the accurate emulator's likelihood
is a narrow curved ridge, and three starts in four end on the bounds of the box far from it. In the
first pass the sparse emulator will do; in the second it led two hearts of 120 astray."""

FOLLOWED = 6
"""Starts per case that are followed to the end: most have met by then."""

MERGE_DISTANCE = 0.01
"""Distance in log theta and log sigma below which starts of a case go on as one."""

LEAST_GAIN, ENOUGH = 1e-9, 1e-6
"""Gains of log density at which a climb ends: the last pass's, and those of the passes before."""


@dataclass(frozen=True)
class PointEstimate:
    """Maxima of C cases: theta (C, P), log_sigma (C, G), log density (C,), and the share (C,) of
    the starts followed to the end that came within 0.01 of the best log density."""

    theta: torch.Tensor
    log_sigma: torch.Tensor
    log_density: torch.Tensor
    agreement: torch.Tensor

    def each(self) -> list["PointEstimate"]:
        """One estimate, of one case, for every case."""
        parts = [getattr(self, key).split(1) for key in self.__dataclass_fields__]
        return [PointEstimate(*one) for one in zip(*parts, strict=True)]


def starting_points(emulator: Emulator, count: int, seed: int) -> torch.Tensor:
    """Sobol points (2 count, P) between the bounds: `count` on the natural scale, then as many on
    the log scale."""
    bounds = emulator.lower.numpy(), emulator.upper.numpy()
    return torch.as_tensor(
        np.concatenate(
            [
                sobol(count, *bounds, scale, derive(seed, "starts", scale))
                for scale in ("natural", "log")
            ]
        )
    )


def log_bounds(emulator: Emulator) -> tuple[torch.Tensor, torch.Tensor]:
    """Lower and upper bounds (P,) of log theta."""
    # NumPy's logarithm is that of the standard library to the last digit, torch's is not.
    return tuple(torch.as_tensor(np.log(b.numpy())) for b in (emulator.lower, emulator.upper))


def find_map(
    likelihood: Likelihood,
    starts: int,
    iterations: int,
    seed: int,
) -> PointEstimate:
    """Maximise the posterior density for every row of `likelihood.y` (C, D).

    `starts` points per case, the most likely ones of `SCREENED_PER_START` times as many Sobol
    points, half of them on the natural, half on the log scale; each improved by at most
    `iterations` projected Levenberg-Marquardt steps with exact gradients and the expected
    information as curvature; in the last pass the best `FOLLOWED`.
    """
    emulator, noise = likelihood.emulator, likelihood.noise
    y = likelihood.y
    cases, groups = len(y), len(noise.groups)
    points = starting_points(emulator, SCREENED_PER_START * starts // 2, seed)
    middle = np.log(0.3 * noise.prior_scale)
    log_sigma = torch.full((len(points), groups), middle, dtype=torch.float64)
    broad = likelihood.tempered(TEMPERING[0])
    with torch.no_grad():
        prediction = join([emulator.predict(part) for part in points.split(CHUNK)])
        screened = torch.stack([broad.at(row).of_prediction(prediction, log_sigma) for row in y])
    chosen = screened.topk(min(starts, len(points)), dim=1).indices
    first = torch.cat([points.log()[chosen], log_sigma[chosen]], dim=-1)
    flat = first.reshape(-1, first.shape[-1])
    owner = torch.arange(cases).repeat_interleave(chosen.shape[1])
    low, high = (
        torch.cat([bound, torch.full((groups,), of_sigma, dtype=torch.float64)])
        for bound, of_sigma in zip(log_bounds(emulator), LOG_SIGMA_BOUNDS, strict=True)
    )
    for level in (*TEMPERING, 0.0):
        stage = likelihood.tempered(level) if level else likelihood
        if level == TEMPERING[0]:
            stage = stage.sparse
        least = ENOUGH if level else LEAST_GAIN
        first, met = _merge(owner, flat)
        found = climb(stage, y[owner[first]], flat[first], low, high, iterations, least)
        flat, values = (part[met] for part in found)
        if level == TEMPERING[-1]:
            best = values.reshape(cases, -1).topk(min(FOLLOWED, chosen.shape[1])).indices
            kept = (best + chosen.shape[1] * torch.arange(cases)[:, None]).flatten()
            flat, owner = flat[kept], owner[kept]
    ends, values = flat.reshape(cases, -1, flat.shape[-1]), values.reshape(cases, -1)
    best = values.argmax(dim=1)
    row = torch.arange(cases)
    p = likelihood.inputs
    place = ends[row, best, :p]
    # exp(log(bound)) misses the bound by round-off
    theta = torch.where(place <= low[:p], emulator.lower, place.exp())
    theta = torch.where(place >= high[:p], emulator.upper, theta)
    return PointEstimate(
        theta,
        ends[row, best, p:],
        values[row, best],
        (values > values[row, best, None] - 0.01).double().mean(1),
    )


def _merge(owner: torch.Tensor, position: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """One row number for each place where starts of a case are, and every row's place."""
    place = torch.cat([owner[:, None], (position / MERGE_DISTANCE).round()], dim=1)
    _, met = torch.unique(place, dim=0, return_inverse=True)
    first = torch.full((int(met.max()) + 1,), len(met))
    return first.scatter_reduce(0, met, torch.arange(len(met)), "amin"), met


def climb(likelihood, y, position, low, high, iterations, least=LEAST_GAIN):
    """Levenberg-Marquardt from every row of `position` (M, P): where it ends, and values (M,)."""
    found, values, left = maximise(
        lambda rows, at: _density(likelihood, y[rows], at),
        lambda rows, at: _derivatives(likelihood, y[rows], at),
        position,
        low,
        high,
        iterations,
        least,
    )
    if len(left):
        log.info("maximum: %d of %d starts had iterations left to do", len(left), len(position))
    return found, values


@torch.no_grad()
def _density(likelihood, y, position) -> torch.Tensor:
    """Log posterior density (M,) at (log theta, log sigma), in chunks."""
    return _with_gradient(likelihood, y, position)


def _with_gradient(likelihood, y, position) -> torch.Tensor:
    parts = []
    for i in range(0, len(position), CHUNK):
        theta, log_sigma = _split(likelihood, position[i : i + CHUNK])
        part = likelihood.at(y[i : i + CHUNK]).log_density(theta, log_sigma)
        parts.append(part + likelihood.noise.log_prior(log_sigma))
    return torch.cat(parts)


def _derivatives(likelihood, y, position):
    """Gradient (M, P) and curvature (M, P, P) of the log posterior density."""
    gradients, curvatures = [], []
    for i in range(0, len(position), CHUNK):
        here = position[i : i + CHUNK].detach().requires_grad_(True)
        value = _with_gradient(likelihood, y[i : i + CHUNK], here)
        gradients.append(torch.autograd.grad(value.sum(), here)[0])
        theta, log_sigma = _split(likelihood, here.detach())
        curvature = likelihood.at(y[i : i + CHUNK]).information(theta, log_sigma)
        p = theta.shape[-1]
        for k in range(log_sigma.shape[-1]):
            prior = 2 * torch.exp(2 * log_sigma[:, k]) / likelihood.noise.prior_scale**2
            curvature[:, p + k, p + k] += prior
        curvatures.append(curvature)
    return torch.cat(gradients), torch.cat(curvatures)


def _split(likelihood, position) -> tuple[torch.Tensor, torch.Tensor]:
    p = likelihood.inputs
    return position[..., :p].exp(), position[..., p:]
