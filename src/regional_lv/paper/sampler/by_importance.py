"""Independent draws of a posterior by importance sampling.

Weighted draws of a cheap density are found first (`approximation`); the exact density weights a
subset of them once more, and Pareto-smoothed weights tell whether the result can be trusted
(Vehtari et al. 2024, JMLR 25:72). Where they say no, there is NUTS.
"""

import time

import numpy as np
import torch

from regional_lv.inference import importance
from regional_lv.paper.sampler.approximation import Approximation, approximate
from regional_lv.paper.sampler.draws import Draws, Settings
from regional_lv.paper.sampler.likelihood import Likelihood

CORRECTED = 2
"""Draws that are weighted by the exact density for each one that is kept."""

EVEN = 0.5
"""Share of the log weights by which draws are chosen for the exact density. The rest remains for
the final weights, so that these tell where the surrogate is too small."""


def sample_by_importance(
    likelihood: Likelihood,
    theta_map: torch.Tensor,
    log_sigma_map: torch.Tensor,
    settings: Settings,
    seed: int,
) -> Draws:
    """Draws of one posterior, as many as `settings` asks chains for, in random order.

    theta_map (P,), log_sigma_map (G,): its maximum. The approximation is refined until the draws
    pass the convergence check, or for as long as there are refinements. The same seed gives the
    same draws.
    """
    started = time.monotonic()
    generator = torch.Generator().manual_seed(seed)
    for found in approximate(likelihood, theta_map, log_sigma_map, generator):
        draws = _draw(found, settings, generator, started)
        if draws.verdict(settings) == "passed":
            break
    return draws


@torch.no_grad()
def _draw(
    approximation: Approximation, settings: Settings, generator: torch.Generator, started: float
) -> Draws:
    found = approximation.found
    log_weight, first_k = importance.smooth(found.log_weight)
    kept = importance.resample(
        torch.softmax(EVEN * log_weight, 0), CORRECTED * settings.total, generator
    )
    position = found.u[kept]
    energy, lacking = approximation.exact(position)
    log_weight, k = importance.smooth((1 - EVEN) * log_weight[kept] + lacking)
    weight = torch.softmax(log_weight, 0)
    # Draws that were chosen twice are one.
    each = torch.zeros(len(found.u), dtype=weight.dtype).index_add(0, kept, weight)
    chosen = importance.resample(weight, settings.total, generator)
    chosen = chosen[torch.randperm(settings.total, generator=generator)]
    shape = settings.chains, settings.draws
    return Draws.of(
        approximation.target.constrain(position[chosen]),
        energy[chosen],
        acceptance_rate=np.ones(shape),
        diverging=np.zeros(shape, dtype=bool),
        pareto_k=float(np.fmax(first_k, k)),
        weighted_ess=1 / (1 / importance.effective(each) + 1 / settings.total),
        seconds=time.monotonic() - started,
    )
