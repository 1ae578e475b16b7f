"""Cheap stand-ins for the posterior of one case, for trajectories that the exact density corrects.

Two kinds, both fitted to a thousand exact evaluations around the maximum, drawn first from the
Gaussian that the information matrix makes of it, then from what the first surrogate says:

- Without measurement noise posteriors are narrow. There the whitened residual of the emulator's
  mean is a quadratic polynomial r(z), and what |r|^2 / 2 lacks of the potential another; errors
  that are not Gaussian have something else there (`Likelihood.of_length`).
- With noise they are wide, and no polynomial of low degree follows the mean. The mean is cheap,
  though, and that of the rough emulator more so: only the log variance becomes a quadratic
  polynomial. Where the noise is inferred, but one output counts as exact, that makes a thin shell
  of the posterior, which a `Shell` makes flat first.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from regional_lv.emulators.base import join
from regional_lv.inference import importance
from regional_lv.inference.likelihood import Likelihood
from regional_lv.inference.nuts import Place, Target, refine
from regional_lv.inference.shell import Shell, products
from regional_lv.seeds import derive

ROUNDS = (300, 300, 500)
"""Exact evaluations of each round."""

SCALE = 10.0
"""Excess potential at which an evaluation weighs a quarter of one at the maximum."""

RIDGE = 1e-6
"""Relative penalty that keeps a fit to nearly dependent columns regular."""


class Surrogate(ABC):
    """A potential (..., K) of positions (..., K, P): of one case, or of C cases stacked."""

    @abstractmethod
    def __call__(self, position: torch.Tensor) -> torch.Tensor: ...

    @staticmethod
    def follows(target: Target) -> Target:
        """What is evaluated in place of the `target` of one case."""
        return target

    @staticmethod
    @abstractmethod
    def together(parts: Sequence["Surrogate"], target: Target) -> "Surrogate":
        """That of several cases, to follow `target`."""

    def with_gradient(self, position: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The potential and its gradient (..., K, P)."""
        position = position.detach().requires_grad_()
        potential = self(position)
        (gradient,) = torch.autograd.grad(potential.sum(), position)
        return potential.detach(), gradient


@dataclass(frozen=True)
class Itself(Surrogate):
    """The potential of the target itself, where nothing cheaper stands in for it."""

    target: Target

    def __call__(self, position):
        return self.target.potential(position)

    @staticmethod
    def together(parts, target):
        return Itself(target)


@dataclass(frozen=True)
class Frame:
    """Coordinates z in which polynomials are fitted: z = (position - origin) inverse'.

    origin (..., 1, P), inverse (..., P, P): one case, or several stacked.
    """

    origin: torch.Tensor
    inverse: torch.Tensor

    def coordinates(self, position: torch.Tensor) -> torch.Tensor:
        return (position - self.origin) @ self.inverse.mT

    def features(self, position: torch.Tensor) -> torch.Tensor:
        """1, z and all products of two, (..., K, F), at positions (..., K, P)."""
        return products(self.coordinates(position))


@dataclass(frozen=True)
class Quadratic:
    """Polynomials constant + linear z + z' square z: (..., 1, D), (..., P, D), (..., P P, D)."""

    constant: torch.Tensor
    linear: torch.Tensor
    square: torch.Tensor

    @classmethod
    def of(cls, coefficients: torch.Tensor, size: int) -> "Quadratic":
        """From the coefficients (F, D) of the features of a `Frame` with `size` coordinates."""
        first, second = torch.triu_indices(size, size)
        half = 0.5 * coefficients[1 + size :]
        square = coefficients.new_zeros(size, size, coefficients.shape[1])
        square[first, second] += half
        square[second, first] += half
        return cls(coefficients[:1], coefficients[1 : 1 + size], square.flatten(0, 1))

    @staticmethod
    def stack(parts: Sequence["Quadratic"]) -> "Quadratic":
        keys = ("constant", "linear", "square")
        return Quadratic(*(torch.stack([getattr(part, key) for part in parts]) for key in keys))

    def __call__(self, z: torch.Tensor) -> torch.Tensor:
        """Values (..., K, D) at z (..., K, P)."""
        products = (z[..., :, None] * z[..., None, :]).flatten(-2)
        return self.constant + z @ self.linear + products @ self.square

    def pull_back(self, by_value: torch.Tensor, z: torch.Tensor) -> torch.Tensor:
        """Gradient (..., K, P) about z of a function whose gradient about the values is given."""
        by_products = (by_value @ self.square.mT).unflatten(-1, (z.shape[-1], z.shape[-1]))
        return by_value @ self.linear.mT + 2 * (by_products @ z[..., None])[..., 0]


@dataclass(frozen=True)
class Polynomial(Surrogate):
    """Potential h(|r|^2) + q with polynomials r (D values) and q (1 value) in `frame`, h that of
    `likelihood`, half its argument if it is Gaussian."""

    likelihood: Likelihood
    frame: Frame
    residual: Quadratic
    rest: Quadratic

    @classmethod
    def fit(cls, target: Target, frame: Frame, position, potential, prediction) -> "Polynomial":
        """From exact evaluations: `potential` (M,) and `prediction` at `position` (M, P)."""
        best, likelihood = potential.argmin(), target.likelihood
        factor = torch.linalg.cholesky(likelihood.covariance(prediction)[best])
        residual = (likelihood.y - prediction.mean).T
        white = torch.linalg.solve_triangular(factor, residual, upper=False).T
        features, weight = frame.features(position), _weights(potential)
        residual = _least_squares(features, white, weight)
        square = (features @ residual).square().sum(-1)
        lacking = potential - likelihood.of_length(square)
        rest = _least_squares(features, lacking[:, None], weight)
        return cls(
            likelihood, frame, *(Quadratic.of(c, position.shape[-1]) for c in (residual, rest))
        )

    @staticmethod
    def together(parts, target):
        return Polynomial(
            parts[0].likelihood,
            _stack([part.frame for part in parts]),
            Quadratic.stack([part.residual for part in parts]),
            Quadratic.stack([part.rest for part in parts]),
        )

    def __call__(self, position):
        return self._values(self.frame.coordinates(position))[0]

    def _values(self, z) -> tuple[torch.Tensor, torch.Tensor]:
        """Potential, and its gradient about the residual."""
        residual = self.residual(z)
        square = residual.square().sum(-1)
        value = self.likelihood.of_length(square) + self.rest(z)[..., 0]
        return value, self.likelihood.of_length_slope(square)[..., None] * residual

    def with_gradient(self, position):
        z = self.frame.coordinates(position)
        value, by_residual = self._values(z)
        one = torch.ones_like(z[..., :1])
        slope = self.residual.pull_back(by_residual, z) + self.rest.pull_back(one, z)
        return value, slope @ self.frame.inverse


@dataclass(frozen=True)
class OwnMean(Surrogate):
    """The potential of the emulator's own mean, or with noise of the rough emulator's, and of a log
    variance that is a polynomial in `frame`, kept between the smallest and largest value that it
    was fitted to.

    log_variance (..., F, 1); ends (..., 1, 2).
    """

    target: Target
    frame: Frame
    log_variance: torch.Tensor
    ends: torch.Tensor

    @classmethod
    def fit(cls, target: Target, frame: Frame, position, potential, prediction) -> "OwnMean":
        """From exact evaluations: `potential` (M,) and `prediction` at `position` (M, P)."""
        logs = torch.log(prediction.variance)
        fitted = _least_squares(frame.features(position), logs[:, None], _weights(potential))
        ends = torch.stack([logs.min(), logs.max()])[None]
        return cls(cls.follows(target), frame, fitted, ends)

    @staticmethod
    def follows(target):
        """That of the rough emulator, where there is more noise than that lacks in all outputs."""
        shell = isinstance(target.box, Shell)
        return target.rough if target.likelihood.noisy and not shell else target

    @staticmethod
    def together(parts, target):
        return OwnMean(
            target,
            _stack([part.frame for part in parts]),
            torch.stack([part.log_variance for part in parts]),
            torch.stack([part.ends for part in parts]),
        )

    def __call__(self, position):
        logs = (self.frame.features(position) @ self.log_variance)[..., 0]
        logs = torch.minimum(torch.maximum(logs, self.ends[..., 0]), self.ends[..., 1])
        return self.target.potential(position, torch.exp(logs))


@dataclass(frozen=True)
class Prepared(Place):
    """A posterior to sample, and what its trajectories follow."""

    surrogate: Surrogate


def prepare(
    target: Target, theta: torch.Tensor, log_sigma: torch.Tensor, seed: int, careful: bool = False
) -> Prepared:
    """Centre, whitening and surrogate of one case; theta (P,), log_sigma (G,): its maximum.

    careful: no polynomial of the mean. Nothing stands in for the exact potential where the mean is
    needed and the emulator's covariance is not separable, or where the emulator leaves the scale of
    its errors to the likelihood: its mean is all it has.
    """
    likelihood = target.likelihood
    wide = careful or likelihood.noisy
    if likelihood.one_scale or (wide and not likelihood.separable):
        place = Place.find(target, theta, log_sigma, seed)
        return Prepared(place.target, place.centre, place.whitening, Itself(place.target))
    kind = OwnMean if wide else Polynomial
    broad = target.broadened(theta)
    found = _fit(kind, broad, *broad.gaussian(theta, log_sigma), seed)
    if broad is target:
        return found
    flat, *place = target.flat(found.centre, found.whitening, seed)
    return _fit(kind, flat, *place, derive(seed, "flat"))


def _fit(kind: type[Surrogate], target: Target, centre, whitening, seed: int) -> Prepared:
    """A surrogate of the target, and centre and whitening by it, from those that are given."""
    generator = torch.Generator().manual_seed(derive(seed, "places"))
    standard = torch.zeros(target.size, dtype=torch.float64), torch.eye(target.size).double()
    student = importance.Student(*standard)
    places, potentials, predictions = [], [], []
    for size in ROUNDS:
        position = centre + student.draw(size, generator) @ whitening.T
        with torch.no_grad():
            potential, prediction = target.evaluate(position)
        places.append(position)
        potentials.append(potential)
        predictions.append(prediction)
        frame = Frame(centre, torch.linalg.inv(whitening))
        evaluated = torch.cat(places), torch.cat(potentials), join(predictions)
        surrogate = kind.fit(target, frame, *evaluated)
        centre, whitening = refine(
            surrogate, centre, whitening, derive(seed, "refine", len(places))
        )
    return Prepared(target, centre, whitening, surrogate)


def together(prepared: Sequence[Prepared]) -> tuple[Target, list[Surrogate]]:
    """Exact target of all cases, about positions (C, K, P), and what stands in for its density.

    Trajectories follow the first; the last is the exact density, if the first is not. Between a
    rough mean and that stands the emulator's own mean, far cheaper than its variance.
    """
    surrogates, targets = [p.surrogate for p in prepared], [p.target for p in prepared]
    kind = type(surrogates[0])
    target = Target.together(targets)
    followed = [kind.follows(target) for target in targets]
    levels = [kind.together(surrogates, Target.together(followed))]
    if any(f is not t for f, t in zip(followed, targets, strict=True)):
        levels.append(kind.together(surrogates, target))
    if kind is not Itself:
        levels.append(Itself(target))
    return target, levels


def _stack(frames: Sequence[Frame]) -> Frame:
    return Frame(
        torch.stack([frame.origin for frame in frames])[:, None],
        torch.stack([frame.inverse for frame in frames]),
    )


def _weights(potential: torch.Tensor) -> torch.Tensor:
    """(M, 1): what lies far above the smallest potential matters less."""
    return 1 / (1 + (potential - potential.min()) / SCALE).square()[:, None]


def _least_squares(features, values, weight) -> torch.Tensor:
    """Coefficients (F, D) of the weighted fit of `values` (M, D) by `features` (M, F)."""
    weighted = weight * features
    gram = features.T @ weighted
    gram = gram + RIDGE * torch.diag(gram.diagonal())
    return torch.linalg.solve(gram, weighted.T @ values)
