"""The posterior of many models at once, over the scaled coordinates of their inputs.

A model is a set of suspected inputs that are free beside the inferred and the measured ones; all
others are at their nominal values. Coordinates x (P,) are the scaled coordinates of all K inputs,
then the log noise scale of each of the G quantities whose noise is inferred.
"""

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import torch
from scipy import stats

from regional_lv.emulators.gaussian import LOG_2PI
from regional_lv.inference.noise import LOG_SIGMA_BOUNDS, Noise
from regional_lv.inference.observed import Observed
from regional_lv.inputs.closed_forms import HeavyTails
from regional_lv.inputs.scales import Linear
from regional_lv.inputs.space import Inputs

CHUNK = 256
"""Points evaluated together: their kernel rows and Jacobians stay in the cache."""

FIRST_SIGMA = 0.3
"""Noise scale that fits start from, in its unit."""

LEAST_TAIL = 1e-5
"""Added to the inverse of the degrees of freedom: at 0 the noise is normal but for 1e-5."""


class Emulated(Protocol):
    """The simulator as a posterior sees it: D observed outputs in natural units, at scaled
    coordinates (M, K) of all inputs, float64. Points are asked for by `CHUNK` at most."""

    def mean(self, x: torch.Tensor) -> torch.Tensor:
        """(M, D)."""

    def linearise(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean (M, D) and its derivatives (M, D, K) with respect to the scaled coordinates."""

    @property
    def simulated_names(self) -> tuple[str, ...]:
        """Of the k inputs that the simulator has."""

    def of_each(self, x: torch.Tensor) -> torch.Tensor:
        """Scaled coordinates (M, S, K of one heart) of the inputs of each of S hearts."""

    def simulated_at(self, x: torch.Tensor) -> torch.Tensor:
        """Values (n, k) of these at which the simulator stands behind most of the outputs: a row
        for each heart of each point."""

    def predict(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean (M, D) and the covariance of its errors, (M, D, D), or (1, D, D) if it is the same
        everywhere; of several hearts in blocks (`Observed`)."""


class Measured:
    """Priors of the m measured inputs: normal, of `mean` and `sd` (m,) in their units, cut at their
    ranges.

    at (m,): their coordinates. log_mass (m,): log probabilities of the ranges.
    """

    def __init__(self, inputs: Inputs):
        chosen = inputs.of_role("measured")
        places = np.flatnonzero(chosen)
        self._scales = inputs.subset(chosen).coordinates
        mean, sd = inputs.nominal[places], np.array([inputs.roles[k].sd for k in places], float)
        low, high = ((end[places] - mean) / sd for end in (inputs.lower, inputs.upper))
        log_mass = np.log(stats.norm.cdf(high) - stats.norm.cdf(low))
        self.at, self.mean, self.sd, self.log_mass = map(
            torch.as_tensor, (places, mean, sd, log_mass)
        )

    def __len__(self) -> int:
        return len(self.at)

    def log_density(self, x: torch.Tensor) -> torch.Tensor:
        """(M,) of the scaled coordinates together, at x (M, P)."""
        value, slope = self._value_and_slope(x)
        square = ((value - self.mean) / self.sd).square()
        each = slope.log() - 0.5 * (square + LOG_2PI) - self.sd.log() - self.log_mass
        return each.sum(-1)

    @property
    def nominal(self) -> torch.Tensor:
        """(m,): scaled coordinates of the means."""
        return self._scales.scaled(self.mean)

    def precision(self, x: torch.Tensor) -> torch.Tensor:
        """(M, m)."""
        return (self._value_and_slope(x)[1] / self.sd).square()

    def _value_and_slope(self, x):
        value = self._scales.natural(x[:, self.at])
        return value, self._scales.slope(value)


@dataclass(frozen=True)
class Quadratic:
    """Log densities (M,), their gradients (M, P), and curvatures (M, P, P), which are positive
    semi-definite: the expected information, about all coordinates, free or not."""

    value: torch.Tensor
    gradient: torch.Tensor
    curvature: torch.Tensor


class Potential:
    """Log posterior densities of observations y (D,) for any point of any model.

    Inferred inputs are uniform in their units within their ranges, as in the paper, suspected ones
    uniform on their scales, measured ones normal in their units, scales of the noise half-normal.
    Errors are normal; with `heavy_tails` among the inputs each channel's, given those before it, is
    Student's t.

    The emulator's covariance is an argument, `error` (M or 1, D, D), of several hearts (M or 1, S,
    U, U): fits and the evidence of a search keep it while inputs move, so that no estimate is drawn
    to where the emulator is least certain; draws have their own (`settle`).

    Attributes: low, high, nominal (P,); always (P,), what is free in every model; suspected, the
    places of the suspected inputs; causes, these by cause; searched, those of them that models may
        free (`without`); measured, the priors of the measured
    ones; tails, the place of `heavy_tails`, or None.

    Parameters
    ----------
    emulated: of the D outputs that were observed.
    inputs: K of them, with roles.
    departure: covariance of a smooth departure of unknown shape, at an amplitude of one: (D, D), of
        several hearts (S, U, U).
    observed: what the outputs are; None: of one heart, and nobody asks.
    """

    def __init__(
        self,
        emulated: Emulated,
        inputs: Inputs,
        y: torch.Tensor,
        noise: Noise,
        departure: torch.Tensor | None = None,
        observed: Observed | None = None,
    ):
        self.emulated, self.inputs, self.y = emulated, inputs, y
        self.noise, self.departure = noise, departure
        self.observed = observed or Observed.unnamed(len(y))
        self.chunk = max(1, CHUNK // self.observed.count)
        groups = len(noise.groups)
        self.low, self.high, self.nominal = (
            torch.as_tensor(np.append(inputs.coordinates.scaled(values), [of_sigma] * groups))
            for values, of_sigma in (
                (inputs.lower, LOG_SIGMA_BOUNDS[0]),
                (inputs.upper, LOG_SIGMA_BOUNDS[1]),
                (inputs.nominal, np.log(FIRST_SIGMA)),
            )
        )
        doubted = inputs.of_role("suspected")
        known = doubted | inputs.of_role("fixed")
        self.always = torch.as_tensor(np.append(~known, np.ones(groups, dtype=bool)))
        self.suspected = tuple(np.flatnonzero(doubted).tolist())
        self.searched = self.suspected
        linear = np.array([isinstance(each.scale, Linear) for each in inputs])
        curved = inputs.of_role("inferred") & ~linear
        self._curved = torch.as_tensor(np.flatnonzero(curved))
        self._scales = inputs.subset(curved).coordinates
        self.measured = Measured(inputs)
        tails = [k for k, each in enumerate(inputs) if isinstance(each, HeavyTails)]
        self.tails = tails[0] if tails else None

    @property
    def width(self) -> torch.Tensor:
        """Of the ranges, (P,)."""
        return self.high - self.low

    def free(self, members: Sequence[int] = ()) -> torch.Tensor:
        """Mask (P,) of what is free where the suspected inputs at the places `members` are."""
        free = self.always.clone()
        free[list(members)] = True
        return free

    def without(self, places: Iterable[int]) -> "Potential":
        """The same, without models in which the suspected inputs at some places are free."""
        fewer, left = copy.copy(self), set(places)
        fewer.searched = tuple(k for k in self.searched if k not in left)
        return fewer

    @cached_property
    def causes(self) -> dict[str, tuple[int, ...]]:
        """Suspected causes, and the places of their inputs."""
        found: dict[str, tuple[int, ...]] = {}
        for k in self.suspected:
            cause = self.inputs[k].cause
            found[cause] = (*found.get(cause, ()), k)
        return found

    def log_uniform(self, free: torch.Tensor) -> torch.Tensor:
        """Log density (M,) of all uniform priors of models whose coordinates `free` (M, P) are,
        each on what it is uniform on."""
        return -(free[:, self._uniform] * self._range[self._uniform].log()).sum(-1)

    @cached_property
    def _range(self) -> torch.Tensor:
        """Widths (P,) of the ranges on what the priors are uniform on."""
        found, at = self.width.clone(), self._curved
        found[at] = torch.as_tensor(self.inputs.upper - self.inputs.lower)[at]
        return found

    @cached_property
    def _uniform(self) -> torch.Tensor:
        uniform = torch.arange(len(self.low)) < len(self.inputs)
        uniform[self.measured.at] = False
        return uniform

    # ----------------------------------------------------------------------------- evaluation

    def settle(self, x: torch.Tensor, amplitude: torch.Tensor) -> torch.Tensor:
        """Covariance (M or 1, D, D) of all errors but the noise at x (M, P), with a departure of
        `amplitude` (M or 1,)."""
        return self.predict(x, amplitude)[1]

    def predict(
        self, x: torch.Tensor, amplitude: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """`mean` and `settle`."""
        means, errors = zip(*(self.emulated.predict(part) for part in self._points(x)), strict=True)
        error = errors[0] if len(errors[0]) == 1 else torch.cat(errors)
        if self.departure is not None:
            shape = (-1, *[1] * self.departure.dim())
            error = error + amplitude.square().reshape(shape) * self.departure
        return torch.cat(means), error

    @torch.no_grad()
    def mean(self, x: torch.Tensor) -> torch.Tensor:
        """Of the outputs (M, D) at x (M, P)."""
        return torch.cat([self.emulated.mean(part) for part in self._points(x)])

    @torch.no_grad()
    def linearise(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The same, and its derivatives (M, D, K)."""
        parts = [self.emulated.linearise(part) for part in self._points(x)]
        means, slopes = zip(*parts, strict=True)
        return torch.cat(means), torch.cat(slopes)

    def _points(self, x):
        return x[:, : len(self.inputs)].split(self.chunk)

    # -------------------------------------------------------------------------------- density

    def log_density(self, mean: torch.Tensor, x: torch.Tensor, error: torch.Tensor) -> torch.Tensor:
        """Log posterior density (M,), not normalised, at x (M, P) where outputs have the mean
        (M, D); without what normalises uniform priors (`log_uniform`)."""
        whitening = self.whitening(x, error)
        logs = whitening.diagonal(dim1=-2, dim2=-1).log().flatten(1).sum(-1)
        errors = self._white(whitening, self.y - mean)
        return self._of_errors(errors, x).sum(-1) + logs + self._log_prior(x)

    def quadratic(
        self, mean: torch.Tensor, slopes: torch.Tensor, x: torch.Tensor, error: torch.Tensor
    ) -> Quadratic:
        """The same with derivatives, from those of the mean, `slopes` (M, D, K)."""
        mean, at = mean.detach().requires_grad_(), x.detach().requires_grad_()
        value = self.log_density(mean, at, error)
        by_mean, gradient = torch.autograd.grad(
            value.sum(), (mean, at), allow_unused=True, materialize_grads=True
        )
        count = len(self.inputs)
        gradient[:, :count] += (by_mean[:, None] @ slopes)[:, 0]
        curvature = x.new_zeros(*x.shape, x.shape[1])
        whitening = self.whitening(x, error)
        weight = self.weights(x, self.y - mean.detach(), whitening)
        root = self.observed.split(weight.sqrt())[..., None]
        white = (root * (whitening @ self.observed.columns(slopes))).flatten(1, -2)
        diagonal = curvature.diagonal(dim1=-2, dim2=-1)
        curvature[:, :count, :count] += white.mT @ white
        if self.tails is not None:
            information = _information_of_tails(self._freedom(x)[:, 0])
            diagonal[:, self.tails] += len(self.y) * information
        if len(self.measured):
            diagonal[:, self.measured.at] += self.measured.precision(x)
        if self.noise.groups:
            sigma = x[:, count:].exp()
            change = 2 * sigma.square()[..., None] * self.noise.units.square()
            squares = (whitening.mT @ whitening).square() / 2
            moved = squares @ self.observed.columns(change.mT)
            curvature[:, count:, count:] += change @ self.observed.join(moved.movedim(-1, 1)).mT
            diagonal[:, count:] += 2 * (sigma / self.noise.prior_scale).square()
        return Quadratic(value.detach(), gradient, curvature)

    def whitening(self, x: torch.Tensor, error: torch.Tensor) -> torch.Tensor:
        """W (M or 1, D, D), lower triangular, with W S W' = I for the covariance S of errors and
        noise at x (M, P); of several hearts in blocks (M or 1, S, U, U)."""
        log_sigma = x[:, len(self.inputs) :] if self.noise.groups else x.new_zeros(1, 0)
        variance = self.observed.split(self.noise.variance(log_sigma), absent=1.0)
        factor = torch.linalg.cholesky(error + torch.diag_embed(variance))
        identity = torch.eye(factor.shape[-1], dtype=x.dtype).expand_as(factor)
        return torch.linalg.solve_triangular(factor, identity, upper=False)

    @torch.no_grad()
    def replicates(self, x: torch.Tensor, amplitude: torch.Tensor, generator) -> torch.Tensor:
        """Measurements (M, D) as they may be at x (M, P): with the emulator's error, a departure of
        `amplitude` (M,), and normal noise or that of heavy tails."""
        deviates = torch.randn(len(x), len(self.y), generator=generator, dtype=x.dtype)
        if self.tails is not None:
            heavy = x[:, self.tails] > 0
            # Student's t of normal deviates that have as much chance to be so large.
            share = torch.special.ndtr(deviates[heavy]).numpy()
            freedom = self._freedom(x[heavy]).numpy()
            deviates[heavy] = torch.as_tensor(stats.t.ppf(share, freedom))
        # Draws of importance sampling repeat points.
        points = torch.cat([x, amplitude[:, None]], dim=1)
        points, owner = torch.unique(points, dim=0, return_inverse=True)
        y = torch.empty_like(deviates)
        for first, part in enumerate(points.split(self.chunk)):
            here = (owner // self.chunk == first).nonzero()[:, 0]
            at = owner[here] % self.chunk
            mean, error = self.predict(part[:, :-1], part[:, -1])
            whitening = self.whitening(part[:, :-1], error)
            whitening = whitening.expand(len(part), *whitening.shape[1:])[at]
            split = self.observed.split(deviates[here])[..., None]
            missed = torch.linalg.solve_triangular(whitening, split, upper=False)[..., 0]
            y[here] = mean[at] + self.observed.join(missed)
        return y

    def weights(
        self, x: torch.Tensor, residual: torch.Tensor, whitening: torch.Tensor
    ) -> torch.Tensor:
        """What each whitened residual (M, D) counts at x (M, P): 1 if errors are normal, less far
        off if their tails are heavy."""
        white = self._white(whitening, residual)
        if self.tails is None:
            return torch.ones_like(white)
        nu = self._freedom(x)
        return (nu + 1) / (nu + white.square())

    def _white(self, whitening, residual):
        residual = self.observed.split(residual)
        if len(whitening) == 1:
            white = (residual.movedim(0, -2) @ whitening[0].mT).movedim(-2, 0)
        else:
            white = (whitening @ residual[..., None])[..., 0]
        return self.observed.join(white)

    def _of_errors(self, white, x) -> torch.Tensor:
        """Log density (M, D) of whitened errors."""
        if self.tails is None:
            return -0.5 * (white.square() + LOG_2PI)
        return torch.distributions.StudentT(self._freedom(x)).log_prob(white)

    def _freedom(self, x) -> torch.Tensor:
        return 1 / (x[:, self.tails, None] + LEAST_TAIL)

    def _log_prior(self, x) -> torch.Tensor:
        total = x.new_zeros(len(x))
        if len(self.measured):
            total = total + self.measured.log_density(x)
        if len(self._curved):  # uniform in the unit, not on the scale
            value = self._scales.natural(x[:, self._curved])
            total = total + self._scales.slope(value).log().sum(-1)
        if self.noise.groups:
            log_sigma = x[:, len(self.inputs) :]
            total = total + self.noise.log_prior(log_sigma) + log_sigma.sum(-1)
        return total


def _information_of_tails(nu: torch.Tensor) -> torch.Tensor:
    """Expected information (M,) of one error about 1 / nu (Lange, Little and Taylor 1989,
    doi 10.1080/01621459.1989.10478852, appendix B); its limit is 3.5."""
    nu = nu.clamp(max=1e3)  # beyond, digits cancel
    halves = torch.special.polygamma(1, nu / 2) - torch.special.polygamma(1, (nu + 1) / 2)
    return nu**4 * (halves / 4 - (nu + 5) / (2 * nu * (nu + 1) * (nu + 3)))
