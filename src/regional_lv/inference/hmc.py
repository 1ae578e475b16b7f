"""Posteriors of many cases at once by Hamiltonian Monte Carlo, or of one subject.

Pyro's NUTS spends most of its time between gradients of one small posterior, and an exact
Gaussian process spends most of a gradient on its predictive variance. Here all chains of all cases
take their leapfrog steps together, along the potential of a `surrogate` that costs next to nothing;
every few trajectories the exact posterior density decides whether where they have led to is
accepted (delayed acceptance, Christen and Fox 2005, doi 10.1198/106186005X76983). Where the
surrogate is rough, a finer one decides first, several times for one look at the exact density
(Lykkegaard et al. 2023, doi 10.1137/22M1476770). The draws are those of the exact posterior; a
surrogate that fits badly costs draws, not correctness.

Every case is moved and whitened as for NUTS, which leaves a step size per chain to adapt, by dual
averaging (Hoffman and Gelman 2014). Numbers of leapfrog steps are drawn at random, which keeps
trajectories from closing (Neal 2011, doi 10.1201/b10905-6). Whoever calls sees to it that every
posterior passes the same convergence check as one of NUTS.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import torch

from regional_lv.inference.likelihood import Likelihood
from regional_lv.inference.nuts import DISPERSION, PATIENT, Draws, Settings, Target
from regional_lv.inference.surrogate import (
    Prepared,
    Surrogate,
    prepare,
    together,
)
from regional_lv.progress import Progress

LEAPFROG_STEPS = 2, 7
"""Steps of a trajectory are drawn evenly from this range, the upper end left out. In whitened space
a step is near 0.5 to 1, a quarter of a period 1.6."""

TRAJECTORIES = 3
"""Trajectories for one draw that is kept. After each of them a finer surrogate decides, if there is
one, and after all of them the exact density. Of 16 hearts with 5,541 simulations and an MRI's noise
13 pass at the first attempt, and 10 without such a look and in log theta."""

ATTEMPTS = ("hmc", "careful hmc", "patient hmc")
"""What is tried in turn with posteriors that fail the convergence check. Careful: narrow ones are
treated as if they were wide, and wide ones with twice the effort. Patient: that in smaller steps,
against divergences, and with four times the effort."""

FIRST_STEP = 0.5

DIVERGENCE = 1000.0
"""Energy error above which a trajectory counts as divergent, as in Pyro and Stan."""


def sample_batch(
    likelihoods: Sequence[Likelihood],
    theta_map: torch.Tensor,
    log_sigma_map: torch.Tensor,
    settings: Settings,
    seeds: Sequence[int],
    attempt: str = ATTEMPTS[0],
) -> list[Draws]:
    """Sample the posteriors of several cases.

    likelihoods: one per case, of one observation (D,) each, all with the same outputs and the same
    kind of noise. theta_map (C, P), log_sigma_map (C, G): their maxima. seeds: one per case.
    attempt: one of `ATTEMPTS`. The same batch gives the same draws.
    """
    started = time.monotonic()
    first, careful, patient = ATTEMPTS
    if attempt == patient:
        settings = replace(settings, target_accept=PATIENT)
    prepared = [
        prepare(Target.near(likelihood, theta, log_sigma), theta, log_sigma, seed, attempt != first)
        for likelihood, theta, log_sigma, seed in zip(
            likelihoods, theta_map, log_sigma_map, seeds, strict=True
        )
    ]
    target, (surrogate, *finer) = together(prepared)
    effort = 4 if attempt == patient else 2 if attempt == careful and likelihoods[0].noisy else 1
    chains = _Chains(surrogate, prepared, settings, seeds)
    progress = Progress(f"HMC of {len(prepared)}: draws", settings.warmup + settings.draws)
    for _ in range(settings.warmup):
        chains.step(1, adapt=True)
        progress.step()
    chains.settle()
    steps, top = effort * TRAJECTORIES, chains
    *between, exact = finer or [None]
    for density in between:
        top = _Look(density, chains, top, 1)
    if exact is not None:
        top, steps = _Look(exact, chains, top, steps), 1
    kept, acceptance, diverging, energies = [], [], [], []
    for _ in range(settings.draws):
        accepted, diverged = top.step(steps)
        progress.step()
        acceptance.append(accepted)
        diverging.append(diverged)
        kept.append(chains.positions().clone())
        energies.append(top.potential)
    # All draws of all chains as chains side by side, (C, draws x K, P).
    theta, log_sigma = target.constrain(torch.cat(kept, dim=1))
    theta, sigma = (
        values.unflatten(1, (settings.draws, settings.chains)).transpose(1, 2).numpy()
        for values in (theta, torch.exp(log_sigma))
    )
    acceptance, diverging, energies = (
        torch.stack(values, dim=2).numpy() for values in (acceptance, diverging, energies)
    )
    seconds = (time.monotonic() - started) / len(prepared)
    return [
        Draws(theta[c], sigma[c], acceptance[c], diverging[c], energies[c], seconds)
        for c in range(len(prepared))
    ]


class _Chains:
    """All chains (C cases, K chains each) in whitened coordinates z (C, K, P)."""

    def __init__(
        self,
        surrogate: Surrogate,
        prepared: Sequence[Prepared],
        settings: Settings,
        seeds: Sequence[int],
    ):
        self.surrogate = surrogate
        self.centre = torch.stack([p.centre for p in prepared])
        self.whitening = torch.stack([p.whitening for p in prepared])
        self.shape = (len(prepared), settings.chains)
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
        self.target_log_step = math.log(10 * FIRST_STEP)
        self.log_step = torch.full(self.shape, math.log(FIRST_STEP), dtype=torch.float64)
        self.mean_log_step = torch.zeros(self.shape, dtype=torch.float64)
        self.gap = torch.zeros(self.shape, dtype=torch.float64)
        self.count = 0

    def normal(self) -> torch.Tensor:
        size = (self.shape[1], self.centre.shape[-1])
        return torch.stack(
            [torch.randn(size, generator=g, dtype=torch.float64) for g in self.generators]
        )

    def uniform(self) -> torch.Tensor:
        return torch.stack(
            [torch.rand(self.shape[1], generator=g, dtype=torch.float64) for g in self.generators]
        )

    def positions(self, z: torch.Tensor | None = None) -> torch.Tensor:
        z = self.z if z is None else z
        return self.centre[:, None] + z @ self.whitening.mT

    def evaluate(self, z: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Potential (C, K), infinite where it is no number, and gradient (C, K, P) about z."""
        potential, by_position = self.surrogate.with_gradient(self.positions(z))
        gradient = by_position @ self.whitening
        potential = torch.nan_to_num(potential, nan=math.inf, posinf=math.inf)
        return potential, torch.nan_to_num(gradient, nan=0.0, posinf=0.0, neginf=0.0)

    def settle(self) -> None:
        """Keep the step sizes that the adaptation has arrived at."""
        self.log_step = self.mean_log_step

    def step(self, count: int, adapt: bool = False) -> tuple[torch.Tensor, torch.Tensor]:
        """Take `count` trajectories; their mean acceptance probability and whether any diverged,
        (C, K) both."""
        results = []
        for _ in range(count):
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
            self.move(self.uniform() < probability, (z, potential, gradient))
            results.append((probability, error > DIVERGENCE))
            if adapt:
                self._adapt(probability)
        return _summary(results)

    def state(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Where the chains are, for `move`."""
        return self.z, self.potential, self.gradient

    def move(self, where: torch.Tensor, state: tuple) -> None:
        """Go to a state `where` (C, K), stay elsewhere."""
        z, potential, gradient = state
        self.z = torch.where(where[..., None], z, self.z)
        self.gradient = torch.where(where[..., None], gradient, self.gradient)
        self.potential = torch.where(where, potential, self.potential)

    def _adapt(self, probability: torch.Tensor) -> None:
        """Dual averaging, equations (6) of Hoffman and Gelman with their constants."""
        self.count += 1
        weight = 1 / (self.count + 10)
        self.gap = (1 - weight) * self.gap + weight * (self.accept - probability)
        self.log_step = self.target_log_step - math.sqrt(self.count) / 0.05 * self.gap
        share = self.count**-0.75
        self.mean_log_step = share * self.log_step + (1 - share) * self.mean_log_step


class _Look:
    """Accepts or undoes what the chains did since it was last asked, by a finer density exp(-U).

    What they did, `steps` trajectories or looks of the level `below`, is reversible about the
    density exp(-S) of that level, so that the ratio of Metropolis and Hastings is that of
    exp(S - U) after and before.
    """

    def __init__(self, density: Surrogate, chains: _Chains, below: "_Chains | _Look", steps: int):
        self.density, self.chains, self.below, self.steps = density, chains, below, steps
        self.potential = self._evaluate()

    def _evaluate(self) -> torch.Tensor:
        with torch.no_grad():
            value = self.density(self.chains.positions())
        return torch.nan_to_num(value, nan=math.inf, posinf=math.inf)

    def step(self, count: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Look `count` times; as `_Chains.step`."""
        results = []
        for _ in range(count):
            before, potential, surrogate = self.state(), self.potential, self.below.potential
            _, diverged = self.below.step(self.steps)
            self.potential = self._evaluate()
            change = (self.below.potential - surrogate) - (self.potential - potential)
            # A start without density is left for anything that has some.
            change = torch.where(torch.isinf(potential), math.inf, change)
            change = torch.where(torch.isinf(self.potential), -math.inf, change)
            probability = torch.exp(change.clamp(max=0.0))
            self.move(self.chains.uniform() >= probability, before)
            results.append((probability, diverged))
        return _summary(results)

    def state(self) -> tuple:
        return self.potential, self.below.state()

    def move(self, where: torch.Tensor, state: tuple) -> None:
        potential, below = state
        self.potential = torch.where(where, potential, self.potential)
        self.below.move(where, below)


def _summary(results: list[tuple[torch.Tensor, torch.Tensor]]) -> tuple[torch.Tensor, torch.Tensor]:
    accepted, diverged = (torch.stack(values) for values in zip(*results, strict=True))
    return accepted.mean(0), diverged.any(0)
