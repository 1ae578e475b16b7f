"""Posteriors by the No-U-Turn Sampler (Hoffman and Gelman 2014) of Pyro.

The sampler works in a space without bounds: `box.Box` bends a power of theta near the bounds, and
sigma is exp(s). In it the ridges along which the factors of a zone compensate are nearly straight.
There the space is moved and whitened, (v, s) = centre + M z, by the Laplace approximation at the
mode, made better by a few rounds of importance sampling: those are batches, for which emulators are
fast. The parameters of one case differ in scale by a factor of a hundred and are strongly
correlated; warm-up would spend its few hundred draws on finding that out with tiny steps. In z the
posterior is close to a standard normal, M M' is the dense mass matrix, and warm-up is left with the
step size: a dense matrix estimated from a hundred correlated draws serves less well (18,700 to
20,500 gradients per posterior instead of 13,200 for the same effective sample size, mean of six
posteriors on published simulations). Where the convergence check shows that this was not good
enough, the second attempt adapts the dense matrix too.
"""

import logging
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyro
import torch
from pyro.infer import NUTS
from scipy.optimize import minimize

from regional_lv.emulators.base import Prediction
from regional_lv.inference import importance
from regional_lv.inference.box import POWER, Box
from regional_lv.inference.diagnostics import check_convergence
from regional_lv.inference.in_step import Ask, run_in_step
from regional_lv.inference.likelihood import Likelihood
from regional_lv.inference.point import CHUNK
from regional_lv.inference.shell import Shell, flatten
from regional_lv.progress import Progress
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

DISPERSION = 1.5
"""Chains start from draws this many times as wide as the Laplace approximation."""

WEAKEST_CURVATURE = 0.3
"""Where the data say nothing, a parameter has about this curvature from its soft bounds; flatter
directions (or bent ones) are whitened as if they had it."""


ROUNDS, ROUND_SIZE = 4, 2000
"""Importance sampling: rounds, draws in each."""

BLUR = 0.03
"""An output that is known to less training sd than this, about 1 mL of volume, makes a thin shell.
`Likelihood.blurred` so far for where and how wide the whole is: widths at one point say little."""

PATIENT = 0.95
"""Acceptance that the second attempt aims at: smaller steps, for what made the first one fail."""

THIN = 2
"""Draws made for one that is kept. The energy, and with it the tails, moves once per trajectory:
1,200 draws in a row have a tail size near 400, the least that passes, and half of the posteriors
would have to be sampled a second time."""


@dataclass(frozen=True)
class Settings:
    """Section `nuts` of the config."""

    chains: int = 2
    warmup: int = 300
    draws: int = 600
    target_accept: float = 0.8
    max_tree_depth: int = 10
    rhat_max: float = 1.01
    ess_min: float = 400.0

    @classmethod
    def from_config(cls, nuts: dict) -> "Settings":
        """Read the section; its keys that are no setting of the sampler are left aside."""
        return cls(**{key: nuts[key] for key in cls.__dataclass_fields__ if key in nuts})


@dataclass(frozen=True)
class Draws:
    """One case: theta (chain, draw, P), sigma (chain, draw, G), sampler statistics
    (chain, draw), seconds, and whether the case was sampled a second time."""

    theta: np.ndarray
    sigma: np.ndarray
    acceptance_rate: np.ndarray
    diverging: np.ndarray
    energy: np.ndarray
    seconds: float
    repeated: bool = False


class Target:
    """Posterior of one case as a potential in a space without bounds.

    Or of several: `likelihood.y` and `box.width` have leading dimensions then, (C, 1, ...).
    box: a `Shell`, where an output is exact and the posterior thin.
    """

    def __init__(self, likelihood: Likelihood, box: Box | Shell):
        self.likelihood, self.box = likelihood, box
        self.inputs = likelihood.inputs
        self.size = self.inputs + len(likelihood.noise.groups)

    @classmethod
    def together(cls, targets: Sequence["Target"]) -> "Target":
        """All of them as one, about positions (C, K, P + G)."""
        first, box = targets[0].likelihood, targets[0].box
        one_emulator = all(t.likelihood.emulator is first.emulator for t in targets)
        if isinstance(box, Shell) or not one_emulator:
            return _Separate(targets)
        likelihood = Likelihood.together([target.likelihood for target in targets])
        width = torch.stack([target.box.width for target in targets])[:, None]
        return cls(likelihood, Box(box.lower, box.upper, width))

    @classmethod
    def near(cls, likelihood: Likelihood, theta: torch.Tensor, log_sigma: torch.Tensor) -> "Target":
        """With soft bounds as wide as the posterior around `theta` (P,), `log_sigma` (G,) is."""
        emulator = likelihood.emulator
        information = likelihood.information(theta, log_sigma)
        # A parameter of which the data say nothing has the variance of the box; a scale of the
        # noise has about as wide a prior.
        span = np.log((emulator.upper / emulator.lower).numpy())
        spans = np.concatenate([span, np.full(len(log_sigma), span.max())])
        covariance = torch.linalg.inv(information + torch.diag(torch.as_tensor(12 / spans**2)))
        width = covariance.diagonal()[: len(theta)].sqrt() * theta**POWER
        return cls(likelihood, Box(emulator.lower, emulator.upper, width))

    def broadened(self, theta: torch.Tensor) -> "Target":
        """Itself, or, if it is a thin shell at `theta` (P,), that which is `blurred`."""
        likelihood = self.likelihood
        # Of one parameter the shell is a short interval: there is nothing to make flat.
        if self.inputs == 1 or not likelihood.exact.any():
            return self
        with torch.no_grad():
            prediction = likelihood.emulator.predict(theta)
        variance = prediction.covariance.diagonal() + likelihood.noise.sd.square()
        thin = likelihood.exact & (variance.sqrt() < BLUR * likelihood.emulator.output_sd)
        thin = thin & likelihood.emulator.linearise(theta)[1].any(-1)  # what never moves has none
        return Target(likelihood.blurred(BLUR), self.box) if thin.any() else self

    def flat(self, centre, whitening, seed: int) -> tuple["Target", torch.Tensor, torch.Tensor]:
        """In the coordinates of a `Shell`, with centre and whitening there; the arguments: centre
        (P + G,) and whitening of the posterior that is `blurred`."""
        generator = torch.Generator().manual_seed(derive(seed, "shell"))
        shell, *place = flatten(self.likelihood, self.box, centre, whitening, generator)
        return Target(self.likelihood, shell), *place

    @property
    def rough(self) -> "Target":
        """That of the rough emulator; itself if there is none."""
        likelihood = self.likelihood.rough
        return self if likelihood is self.likelihood else Target(likelihood, self.box)

    def unconstrain(self, theta: torch.Tensor, log_sigma: torch.Tensor) -> torch.Tensor:
        """Position (..., P + G)."""
        return torch.cat([self.box.position(theta), log_sigma], dim=-1)

    def constrain(self, position: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Theta (..., P) and log sigma (..., G)."""
        return self.box.theta(position[..., : self.inputs]), position[..., self.inputs :]

    def potential(
        self, position: torch.Tensor, variance: torch.Tensor | None = None
    ) -> torch.Tensor:
        """-log posterior density (...) of positions (..., P + G), with the Jacobian of the map.

        variance: (...), in place of the emulator's own if its covariance is separable.
        """
        if variance is None:
            return self.evaluate(position)[0]
        return self._value(
            position, lambda theta: self.likelihood.emulator.with_variance(theta, variance)
        )[0]

    def evaluate(self, position: torch.Tensor) -> tuple[torch.Tensor, Prediction]:
        """The potential (...) and the emulator's prediction at positions (..., P + G)."""
        return self._value(position, self.likelihood.emulator.predict)

    def _value(self, position, predict) -> tuple[torch.Tensor, Prediction]:
        log_sigma = position[..., self.inputs :]
        theta, jacobian = self.box.open(position[..., : self.inputs])
        prediction = predict(theta)
        if log_sigma.shape[-1]:
            jacobian = jacobian + log_sigma.sum(-1) + self.likelihood.noise.log_prior(log_sigma)
        return -(self.likelihood.of_prediction(prediction, log_sigma) + jacobian), prediction

    def gaussian(
        self, theta: torch.Tensor, log_sigma: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Position (P + G,) of the maximum of the density of theta, and a whitening M from the
        expected information there and from the curvature of the soft bounds."""
        position, p = self.unconstrain(theta, log_sigma), self.inputs
        here = position.clone().requires_grad_(True)

        def jacobian(v):
            return self.box.log_jacobian(v[:p])

        bounds = -torch.autograd.functional.hessian(jacobian, here.detach())
        slope = torch.autograd.functional.jacobian(
            lambda v: torch.cat([torch.log(self.box.theta(v[:p])), v[p:]]), position
        )
        precision = slope.T @ self.likelihood.information(theta, log_sigma) @ slope
        precision = precision + torch.diag(bounds.diagonal().clamp(min=0))
        return position, _whitening(precision)

    def value_and_gradient(self, position: np.ndarray) -> tuple[float, np.ndarray]:
        """The potential and its gradient as SciPy wants them."""
        here = torch.tensor(position, dtype=torch.float64, requires_grad=True)
        value = self.potential(here)
        (gradient,) = torch.autograd.grad(value, here)
        return value.item(), np.nan_to_num(gradient.numpy())

    def laplace(self, start: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Mode (P + G,) near `start` and whitening M (P + G, P + G), M M' the covariance there."""
        result = minimize(
            self.value_and_gradient,
            start.numpy(),
            jac=True,
            method="L-BFGS-B",
            bounds=self._ends(),
            options={"maxiter": 500, "maxfun": 1000, "ftol": 1e-13, "gtol": 1e-6},
        )
        mode = result.x
        # Central differences of the exact gradient, scaled to each parameter's own curvature.
        hessian = np.empty((self.size, self.size))
        for i in range(self.size):
            step = np.zeros(self.size)
            step[i] = 1e-4
            forward, backward = (self.value_and_gradient(mode + s)[1] for s in (step, -step))
            hessian[i] = (forward - backward) / 2e-4
        return torch.as_tensor(mode), _whitening(torch.as_tensor(hessian))

    def _ends(self) -> list[tuple[float, float]]:
        """Where a search for the mode has to stay, per coordinate."""
        margin = 6 * self.box.width
        low, high = (self.box.low - margin).tolist(), (self.box.high + margin).tolist()
        return [*zip(low, high, strict=True), *[(-8.0, 8.0)] * (self.size - self.inputs)]


class _Separate:
    """Cases whose emulators differ, as one target about positions (C, K, P + G)."""

    def __init__(self, targets: Sequence[Target]):
        self.targets = targets

    def potential(self, position, variance=None) -> torch.Tensor:
        if variance is None:
            variance = [None] * len(self.targets)
        return torch.stack(
            [t.potential(*at) for t, *at in zip(self.targets, position, variance, strict=True)]
        )

    def constrain(self, position) -> tuple[torch.Tensor, torch.Tensor]:
        parts = [t.constrain(at) for t, at in zip(self.targets, position, strict=True)]
        return tuple(torch.stack(values) for values in zip(*parts, strict=True))


def _whitening(precision: torch.Tensor) -> torch.Tensor:
    """M with M M' the inverse of `precision`, whose flat and bent directions are made round."""
    values, vectors = torch.linalg.eigh(0.5 * (precision + precision.T))
    return vectors / values.clamp(min=WEAKEST_CURVATURE).sqrt()


def refine(
    potential: Callable[[torch.Tensor], torch.Tensor], mode, whitening, seed: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Centre and M from the posterior's own mean and covariance, by importance sampling.

    The weights are flattened, so that one draw far out does not decide: a biased M costs speed, not
    correctness.
    """
    size = len(mode)
    zero, one = torch.zeros(size, dtype=torch.float64), torch.eye(size, dtype=torch.float64)

    @torch.no_grad()
    def log_density(z):
        return -torch.cat([potential(part) for part in (mode + z @ whitening.T).split(CHUNK)])

    found = importance.sample(
        log_density,
        *(zero, one, ROUND_SIZE, torch.Generator().manual_seed(seed)),
        rounds=ROUNDS,
    )
    centre, covariance = importance.moments(found.u, found.tempered())
    factor = torch.linalg.cholesky(covariance + 1e-6 * one)
    return mode + whitening @ centre, whitening @ factor


def sample_in_step(
    likelihoods: Sequence[Likelihood],
    theta_map: torch.Tensor,
    log_sigma_map: torch.Tensor,
    settings: Settings,
    seeds: Sequence[int],
    names: Sequence[str],
) -> list[Draws]:
    """Sample posteriors; those that fail the convergence check once more, with a doubled warm-up,
    smaller steps and twice the thinning.

    likelihoods: one per case, of one observation (D,) each, all with the same kind of noise.
    theta_map (C, P), log_sigma_map (C, G): where to start. All chains of all cases go on in step,
    their gradients made in one batch. The same seeds give the same draws; the last digits depend
    on which cases are sampled together.
    """
    started = time.monotonic()
    places = [
        Place.find(Target.near(likelihood, theta, log_sigma), theta, log_sigma, seed)
        for likelihood, theta, log_sigma, seed in zip(
            likelihoods, theta_map, log_sigma_map, seeds, strict=True
        )
    ]
    draws = _run(places, settings, [derive(seed, "first") for seed in seeds])
    outcomes = [verdict(one, settings) for one in draws]
    failed = [i for i, outcome in enumerate(outcomes) if outcome != "passed"]
    for i in failed:
        log.warning("case %s %s; sampled again, longer", names[i], outcomes[i])
    if failed:
        longer = replace(settings, warmup=2 * settings.warmup, target_accept=PATIENT)
        again = _run(
            [places[i] for i in failed],
            longer,
            [derive(seeds[i], "second") for i in failed],
            again=True,
        )
        for i, one in zip(failed, again, strict=True):
            outcome = verdict(one, settings)
            if outcome != "passed":
                log.warning("case %s %s, the second time too", names[i], outcome)
            draws[i] = replace(one, repeated=True)
    seconds = (time.monotonic() - started) / len(draws)
    return [replace(one, seconds=seconds) for one in draws]


def verdict(draws: Draws, settings: Settings) -> str:
    """`passed`, or `failed:` and which of R-hat, ESS and divergences did not pass."""
    chains = np.concatenate([draws.theta, draws.sigma], axis=-1)
    names = range(chains.shape[-1])
    return check_convergence(chains, names, draws.diverging, settings.rhat_max, settings.ess_min)[1]


@dataclass(frozen=True)
class Place:
    """Where and how wide a posterior is: position = centre + whitening z, z near standard normal.

    centre: (P + G,). whitening: (P + G, P + G).
    """

    target: Target
    centre: torch.Tensor
    whitening: torch.Tensor

    @classmethod
    def find(cls, target: Target, theta, log_sigma, seed: int) -> "Place":
        """From the density itself; theta (P,), log_sigma (G,): its maximum. A thin shell is made
        flat on the way."""
        broad = target.broadened(theta)
        mode, whitening = broad.laplace(target.unconstrain(theta, log_sigma))
        place = refine(broad.potential, mode, whitening, derive(seed, "refine"))
        if broad is not target:
            target, *place = target.flat(*place, seed)
            place = refine(target.potential, *place, derive(seed, "refine", "flat"))
        return cls(target, *place)


class _Asked(torch.autograd.Function):
    """A potential whose value and gradient come together, from `ask`."""

    @staticmethod
    def forward(ctx, z, ask):
        value, gradient = ask(z.detach())
        ctx.save_for_backward(gradient)
        return value

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, by_value):
        (gradient,) = ctx.saved_tensors
        return by_value * gradient, None


def _evaluate(places: Sequence[Place], z: torch.Tensor) -> list[tuple[torch.Tensor, torch.Tensor]]:
    """Potential and its gradient (P + G,) about z, of each place at its row of z (M, P + G)."""
    z = z.detach().requires_grad_(True)
    centre = torch.stack([place.centre for place in places])
    whitening = torch.stack([place.whitening for place in places])
    position = centre[:, None] + z[:, None] @ whitening.mT
    value = Target.together([place.target for place in places]).potential(position)[:, 0]
    (gradient,) = torch.autograd.grad(value.sum(), z)
    return list(zip(value.detach(), gradient, strict=True))


@dataclass(frozen=True)
class _Chain:
    """Of one chain: z (draws made, P + G) and statistics (draws made,)."""

    z: torch.Tensor
    acceptance: np.ndarray
    energy: np.ndarray
    diverging: np.ndarray


def _run(
    places: Sequence[Place], settings: Settings, seeds: Sequence[int], again=False
) -> list[Draws]:
    """All chains of all cases, in step.

    again: second attempt, which adapts the mass matrix as well and thins twice as much.
    """
    made = settings.draws * (2 * THIN if again else THIN)

    def task_of(place: Place):
        return lambda ask: _chain(place, settings, made, again, ask, progress)

    of_chain = [place for place in places for _ in range(settings.chains)]
    progress = Progress("NUTS: iterations", len(of_chain) * (settings.warmup + made))
    of_seed = [derive(seed, chain) for seed in seeds for chain in range(settings.chains)]
    # Pyro checks distributions unless told otherwise, and what tells it is global.
    with pyro.validation_enabled(False):
        chains = run_in_step(
            [task_of(place) for place in of_chain],
            lambda which, z: _evaluate([of_chain[i] for i in which], torch.stack(z)),
            of_seed,
        )
    size = settings.chains
    return [
        _thinned(place, chains[i * size : (i + 1) * size], settings.draws)
        for i, place in enumerate(places)
    ]


def _chain(
    place: Place, settings: Settings, made: int, again: bool, ask: Ask, progress: Progress
) -> _Chain:
    """One chain of Pyro's NUTS, which `ask`s for its gradients."""
    kernel = NUTS(
        potential_fn=lambda z: _Asked.apply(z["z"], ask),
        full_mass=True,
        adapt_mass_matrix=again,
        target_accept_prob=settings.target_accept,
        max_tree_depth=settings.max_tree_depth,
    )
    kernel.initial_params = {"z": _start(place, ask)}
    kernel.setup(settings.warmup)
    state = kernel.initial_params
    for _ in range(settings.warmup):
        state = kernel.sample(state)
        progress.step()
    kept, energies, acceptance, before = [], [], [], 0.0
    for i in range(made):
        state = kernel.sample(state)
        kept.append(state["z"].detach())
        energies.append(float(kernel._potential_energy_last))
        # The kernel keeps the running mean over the draws so far.
        mean = kernel._mean_accept_prob
        acceptance.append(mean * (i + 1) - before * i)
        before = mean
        progress.step()
    diverging = np.zeros(made, dtype=bool)
    diverging[kernel.diagnostics()["divergences"]] = True
    kernel.cleanup()
    return _Chain(torch.stack(kept), np.array(acceptance), np.array(energies), diverging)


def _thinned(place: Place, chains: Sequence[_Chain], draws: int) -> Draws:
    """The chains of one case, one draw in so many kept, in natural coordinates."""
    thin = len(chains[0].z) // draws
    z = torch.stack([chain.z[thin - 1 :: thin] for chain in chains])
    theta, log_sigma = place.target.constrain(place.centre + z @ place.whitening.T)
    acceptance, energy, diverging = (
        np.stack([getattr(chain, key).reshape(draws, thin) for chain in chains])
        for key in ("acceptance", "energy", "diverging")
    )
    return Draws(
        theta=theta.numpy(),
        sigma=torch.exp(log_sigma).numpy(),
        acceptance_rate=acceptance.mean(axis=-1),
        # A divergence counts, whether its draw is kept or not.
        diverging=diverging.any(axis=-1),
        energy=energy[..., -1],
        seconds=math.nan,
    )


def _start(place: Place, ask: Ask) -> torch.Tensor:
    """An overdispersed start: drawn wide, and pulled in until the density there is a number."""
    z = DISPERSION * torch.randn(place.target.size, dtype=torch.float64)
    for _ in range(20):
        value, gradient = ask(z)
        if torch.isfinite(value) and torch.isfinite(gradient).all():
            return z
        z = 0.5 * z
    return torch.zeros(place.target.size, dtype=torch.float64)
