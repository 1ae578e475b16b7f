"""Where and how wide a posterior is: weighted draws of a surrogate of its density.

Posteriors of simulated outputs are narrow and nearly Gaussian. Those of measured hearts are wide,
bent and, where a volume is known far better than the strains, thin: an approximation at the maximum
says little of them, and chains take hundreds of steps to cross them. A batch of two thousand
densities costs as much as a dozen gradients one after the other, so that proposals are fitted to
weighted draws instead (`importance.sample`).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch

from regional_lv.inference import importance
from regional_lv.inference.importance import Student, Weighted
from regional_lv.inference.potential import CHUNK
from regional_lv.paper.sampler.likelihood import Likelihood
from regional_lv.paper.sampler.surrogate import Potential, fit_surrogate
from regional_lv.paper.sampler.target import Target
from regional_lv.paper.sampler.transform import ThetaTransform

EFFORT = {"draws": 2000, "rounds": 4, "most_rounds": 24, "least_ess": 2500}
"""Draws of a round, rounds of one proposal, of mixtures, and the effective sample size that is
enough. Draws that proposals were fitted to are kept: the evidence, which they state too small (by
0.04 in ten dimensions), is not used, and standard deviations are right within 0.3 %; new ones would
take a third more time."""

LEAST_PLACES, PLACES_PER_COEFFICIENT = 600, 2.5
"""Evaluations that a surrogate is fitted to: the least, and for each coefficient of its quadratic
polynomial. In 34 dimensions that has 630; of the approximations of a posterior with 17 zones, 7 of
25 passed the check of their weights with 600 evaluations, and 5 of 7 with 1,500."""

NARROW = 0.7
"""Of the Gaussian at a maximum, where the first ones are made: it is too wide where the posterior
bends."""

CHECKED = 8
"""One in so many draws has its exact density computed in any case. With an exact process of 5,661
simulations the log weights of 2,400 draws have an sd of 0.0003 and take most of the time."""

REFINEMENTS = 2
"""Approximations at the end, each about the draws of the one before."""


@dataclass(frozen=True)
class Approximation:
    """Weighted draws `found` of the density exp(-surrogate), which is near that of `target`."""

    target: Target
    surrogate: Potential
    found: Weighted

    def preconditioner(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Affine map onto the posterior: its mean (S,), and M with covariance M M'."""
        return _spread(self.found.u, self.found.tempered())

    @torch.no_grad()
    def exact(self, position: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Potential of the target at positions (N, S), and log weights of draws of the surrogate
        for it: (N,) each.

        Where the weights of one draw in `CHECKED` are even, the others are not computed: the
        surrogate is the target but for a constant.
        """
        cheap = self._potential(self.surrogate, position)
        checked = torch.arange(len(position)) % CHECKED == 0
        energy = torch.empty_like(cheap)
        energy[checked] = self._potential(self.target.potential, position[checked])
        lacking = (cheap - energy)[checked]
        if lacking.std() < importance.EVEN:
            shift = lacking.mean()
            return cheap - shift, shift.expand_as(cheap)
        energy[~checked] = self._potential(self.target.potential, position[~checked])
        return energy, cheap - energy

    @staticmethod
    def _potential(potential: Potential, position: torch.Tensor) -> torch.Tensor:
        return torch.cat([potential(part) for part in position.split(CHUNK)])

    def places(self, generator: torch.Generator) -> torch.Tensor:
        """Positions (M, S) spread like the posterior, M of `count_places`."""
        count = count_places(self.found.u.shape[1])
        return self.found.u[importance.resample(self.found.weight, count, generator)]


def count_places(dimensions: int) -> int:
    """How many evaluations a surrogate in so many dimensions is fitted to."""
    coefficients = (dimensions + 1) * (dimensions + 2) // 2
    return max(LEAST_PLACES, int(PLACES_PER_COEFFICIENT * coefficients))


def approximate(
    likelihood: Likelihood,
    theta_map: torch.Tensor,
    log_sigma_map: torch.Tensor,
    generator: torch.Generator,
) -> Iterator[Approximation]:
    """Approximations of one posterior, each better than the one before; the first often suffices.

    theta_map (P,), log_sigma_map (G,): its maximum. The first is about the Gaussian at the maximum,
    the second in coordinates that fit the draws of the first.
    """
    target = Target.near(likelihood, theta_map, log_sigma_map)
    mode, scale = target.gaussian(theta_map, log_sigma_map)
    student = Student(torch.zeros_like(mode), NARROW**2 * torch.eye(len(mode), dtype=mode.dtype))
    count = count_places(len(mode))
    best = _explore(target, mode + student.draw(count, generator) @ scale.mT, generator)
    yield best

    theta, log_sigma = target.constrain(best.found.u)
    transform = ThetaTransform.around(theta, best.found.weight, likelihood.emulator)
    target = Target(likelihood, transform)
    kept = importance.resample(best.found.weight, count, generator)
    best = _explore(target, target.unconstrain(theta[kept], log_sigma[kept]), generator)
    yield best

    for _ in range(REFINEMENTS):
        best = _explore(target, best.places(generator), generator)
        yield best


def _explore(target: Target, places: torch.Tensor, generator: torch.Generator) -> Approximation:
    """The approximation from `places` (M, S), which the posterior is near."""
    even = torch.full((len(places),), 1 / len(places), dtype=places.dtype)
    centre, scale = _spread(places, even)
    surrogate = fit_surrogate(target, places, centre, scale)

    @torch.no_grad()
    def log_density(z):
        position = centre + z @ scale.mT
        return -torch.cat([surrogate(part) for part in position.split(CHUNK)])

    zero, one = torch.zeros_like(centre), torch.eye(len(centre), dtype=centre.dtype)
    found = importance.sample(log_density, zero, one, generator=generator, kept=None, **EFFORT)
    return Approximation(target, surrogate, Weighted(centre + found.u @ scale.mT, found.log_weight))


def _spread(u: torch.Tensor, weight: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Mean (S,) of weighted positions (N, S), and M with covariance M M'."""
    mean, covariance = importance.moments(u, weight)
    return mean, torch.linalg.cholesky(importance.limited(covariance, math.inf))
