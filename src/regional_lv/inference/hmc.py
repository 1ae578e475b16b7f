"""Posteriors of many cases at once by Hamiltonian Monte Carlo, for sets of simulated cases.

Pyro's NUTS spends most of its time between gradients of one small posterior. Here all chains of
all cases take their leapfrog steps together, so that one pass through the emulator serves them all.
Every case is moved and whitened as for NUTS, which leaves a step size per chain to adapt, by dual
averaging (Hoffman and Gelman 2014). Numbers of leapfrog steps are drawn at random, which keeps
trajectories from closing (Neal 2011, doi 10.1201/b10905-6). Whoever calls sees to it that every
posterior passes the same gate as one of NUTS.
"""

import math
import time
from collections.abc import Sequence

import numpy as np
import torch

from regional_lv.inference.likelihood import Likelihood
from regional_lv.inference.nuts import DISPERSION, Draws, Settings, Target, refine
from regional_lv.seeds import derive

LEAPFROG_STEPS = (2, 7)
"""Steps of a trajectory are drawn evenly from this range, the upper end left out. In whitened
space a step is near 0.5 to 1, a quarter of a period 1.6."""

THIN = 3
"""Draws made for one that is kept: gradients are cheap here, what is kept goes to disk."""

FIRST_STEP = 0.5

DIVERGENCE = 1000.0
"""Energy error above which a trajectory counts as divergent, as in Pyro and Stan."""


def sample_batch(
    likelihood: Likelihood, theta_map: torch.Tensor, settings: Settings, seeds: Sequence[int]
) -> list[Draws]:
    """Sample the posteriors of all rows of `likelihood.y` (C, D), known noise only.

    theta_map: (C, 10), where the Laplace approximations are sought. seeds: one per case. The same
    batch gives the same draws.
    """
    started = time.monotonic()
    none = torch.zeros(0, dtype=torch.float64)
    centres, whitenings = [], []
    for y, theta, seed in zip(likelihood.y, theta_map, seeds, strict=True):
        target = Target(likelihood.at(y))
        mode, whitening = target.laplace(target.unconstrain(theta, none))
        centre, whitening = refine(target, mode, whitening, derive(seed, "refine"))
        centres.append(centre)
        whitenings.append(whitening)
    target = Target(likelihood.at(likelihood.y[:, None]))
    chains = _Chains(target, torch.stack(centres), torch.stack(whitenings), settings, seeds)

    chains.run(settings.warmup, adapt=True)
    chains.settle()
    kept, acceptance, diverging, energies = [], [], [], []
    for _ in range(settings.draws):
        drawn = chains.run(THIN, adapt=False)
        kept.append(target.constrain(chains.positions())[0])
        acceptance.append(torch.stack([d[0] for d in drawn]).mean(0))
        diverging.append(torch.stack([d[1] for d in drawn]).any(0))
        energies.append(chains.potential)
    seconds = (time.monotonic() - started) / len(centres)
    theta, acceptance, diverging, energies = (
        torch.stack(values, dim=2).numpy() for values in (kept, acceptance, diverging, energies)
    )
    no_sigma = np.zeros((settings.chains, settings.draws, 0))
    return [
        Draws(theta[c], no_sigma, acceptance[c], diverging[c], energies[c], seconds)
        for c in range(len(centres))
    ]


class _Chains:
    """All chains (C cases, K chains each) in whitened coordinates z (C, K, P)."""

    def __init__(self, target: Target, origin, whitening, settings: Settings, seeds):
        self.target, self.origin, self.whitening = target, origin, whitening
        self.shape = (len(origin), settings.chains)
        self.accept = settings.target_accept
        self.generators = [torch.Generator().manual_seed(seed) for seed in seeds]
        # One common number of steps per iteration lets all chains move together.
        self.common = torch.Generator().manual_seed(seeds[0])
        self.z = DISPERSION * self.normal()
        self.potential, self.gradient = self.evaluate(self.z)
        for _ in range(20):
            lost = ~torch.isfinite(self.potential)
            if not lost.any():
                break
            self.z[lost] *= 0.5
            self.potential, self.gradient = self.evaluate(self.z)
        self.centre = math.log(10 * FIRST_STEP)
        self.log_step = torch.full(self.shape, math.log(FIRST_STEP), dtype=torch.float64)
        self.mean_log_step = torch.zeros(self.shape, dtype=torch.float64)
        self.gap = torch.zeros(self.shape, dtype=torch.float64)
        self.count = 0

    def normal(self) -> torch.Tensor:
        size = (self.shape[1], self.origin.shape[-1])
        return torch.stack(
            [torch.randn(size, generator=g, dtype=torch.float64) for g in self.generators]
        )

    def uniform(self) -> torch.Tensor:
        return torch.stack(
            [torch.rand(self.shape[1], generator=g, dtype=torch.float64) for g in self.generators]
        )

    def positions(self, z: torch.Tensor | None = None) -> torch.Tensor:
        z = self.z if z is None else z
        return self.origin[:, None] + z @ self.whitening.mT

    def evaluate(self, z: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Potential (C, K), infinite where it is no number, and gradient (C, K, P) about z."""
        z = z.detach().requires_grad_()
        potential = self.target.potential(self.positions(z))
        (gradient,) = torch.autograd.grad(potential.sum(), z)
        potential = torch.nan_to_num(potential.detach(), nan=math.inf, posinf=math.inf)
        return potential, torch.nan_to_num(gradient, nan=0.0, posinf=0.0, neginf=0.0)

    def settle(self) -> None:
        """Keep the step sizes that the adaptation has arrived at."""
        self.log_step = self.mean_log_step

    def run(self, iterations: int, adapt: bool) -> list[tuple[torch.Tensor, torch.Tensor]]:
        """Take iterations; return acceptance probability and divergence (C, K) of each."""
        results = []
        for _ in range(iterations):
            steps = int(torch.randint(*LEAPFROG_STEPS, (1,), generator=self.common))
            size = torch.exp(self.log_step)[..., None]
            momentum = self.normal()
            before = self.potential + 0.5 * momentum.square().sum(-1)
            z, potential, gradient = self.z, self.potential, self.gradient
            momentum = momentum - 0.5 * size * gradient
            for i in range(steps):
                z = z + size * momentum
                potential, gradient = self.evaluate(z)
                momentum = momentum - (0.5 if i == steps - 1 else 1.0) * size * gradient
            error = potential + 0.5 * momentum.square().sum(-1) - before
            error = torch.nan_to_num(error, nan=math.inf)
            probability = torch.exp(-error.clamp(min=0.0))
            taken = self.uniform() < probability
            self.z = torch.where(taken[..., None], z, self.z)
            self.gradient = torch.where(taken[..., None], gradient, self.gradient)
            self.potential = torch.where(taken, potential, self.potential)
            results.append((probability, error > DIVERGENCE))
            if adapt:
                self._adapt(probability)
        return results

    def _adapt(self, probability: torch.Tensor) -> None:
        """Dual averaging, equations (6) of Hoffman and Gelman with their constants."""
        self.count += 1
        weight = 1 / (self.count + 10)
        self.gap = (1 - weight) * self.gap + weight * (self.accept - probability)
        self.log_step = self.centre - math.sqrt(self.count) / 0.05 * self.gap
        share = self.count**-0.75
        self.mean_log_step = share * self.log_step + (1 - share) * self.mean_log_step
