"""Draws of a posterior by the No-U-Turn Sampler (Hoffman and Gelman 2014) of Pyro.

Chains run in coordinates in which an approximation of the posterior has mean zero and unit
covariance, so that warm-up is left with the step size. They follow the surrogate of that
approximation, whose gradient costs a fraction of the exact one's; weights put right what it lacks,
and Pareto smoothing tells whether they can.
"""

import time

import numpy as np
import torch

from regional_lv.inference import importance
from regional_lv.paper.sampler.approximation import Approximation, approximate
from regional_lv.paper.sampler.draws import Draws, Settings
from regional_lv.paper.sampler.likelihood import Likelihood
from regional_lv.seeds import derive
from regional_lv.study.progress import Progress

DISPERSION = 1.5
"""Chains start from draws this many times as wide as the approximation."""

THIN = 2
"""Draws made for one that is kept. The energy, and with it the tails, moves once per trajectory:
1,200 draws in a row have a tail size near 400, the least that passes."""


def sample_by_nuts(
    likelihood: Likelihood,
    theta_map: torch.Tensor,
    log_sigma_map: torch.Tensor,
    settings: Settings,
    seed: int,
) -> Draws:
    """Draws of one posterior; theta_map (P,), log_sigma_map (G,): its maximum. The same seed gives
    the same draws."""
    import pyro  # slow to load, and most posteriors are sampled otherwise
    from pyro.infer import MCMC, NUTS

    started = time.monotonic()
    generator = torch.Generator().manual_seed(seed)
    *_, found = approximate(likelihood, theta_map, log_sigma_map, generator)
    centre, scale = found.preconditioner()
    made = THIN * settings.draws
    progress = Progress("NUTS: iterations", settings.chains * (settings.warmup + made))
    chains = []
    for chain in range(settings.chains):
        start = DISPERSION * torch.randn(len(centre), generator=generator, dtype=centre.dtype)
        mcmc = MCMC(
            NUTS(
                potential_fn=lambda at: found.surrogate(centre + at["z"] @ scale.mT),
                full_mass=True,
                adapt_mass_matrix=False,
                target_accept_prob=settings.target_accept,
                max_tree_depth=settings.max_tree_depth,
            ),
            num_samples=made,
            warmup_steps=settings.warmup,
            initial_params={"z": start},
            hook_fn=lambda *_: progress.step(),
            disable_progbar=True,
        )
        # Pyro checks distributions unless told otherwise, and draws from the global generator.
        with pyro.validation_enabled(False), torch.random.fork_rng(devices=[]):
            torch.manual_seed(derive(seed, chain))
            mcmc.run()
        chains.append(mcmc)
    return _weighted(found, centre, scale, chains, settings, started)


@torch.no_grad()
def _weighted(
    found: Approximation, centre, scale, chains, settings: Settings, started: float
) -> Draws:
    """Draws of the exact density: every chain thinned, weighted and resampled in its order."""
    z = torch.stack([chain.get_samples()["z"][THIN - 1 :: THIN] for chain in chains])
    position = (centre + z @ scale.mT).flatten(0, 1)
    energy, lacking = found.exact(position)
    log_weight, k = importance.smooth(lacking)
    weight = torch.softmax(log_weight, 0)
    shape = settings.chains, settings.draws
    chosen = torch.cat(
        [
            i * settings.draws + importance.resample(of_chain / of_chain.sum(), settings.draws)
            for i, of_chain in enumerate(weight.reshape(shape))
        ]
    )
    diverging, acceptance = np.zeros(shape, dtype=bool), np.empty(shape)
    for i, chain in enumerate(chains):
        diagnostics = chain.diagnostics()
        # A divergence counts, whether its draw is kept or not.
        diverging[i, np.array(diagnostics["divergences"]["chain 0"], dtype=int) // THIN] = True
        acceptance[i] = diagnostics["acceptance rate"]["chain 0"]
    return Draws.of(
        found.target.constrain(position[chosen]),
        energy[chosen],
        acceptance_rate=acceptance,
        diverging=diverging,
        pareto_k=k,
        weighted_ess=importance.effective(weight),
        seconds=time.monotonic() - started,
    )
