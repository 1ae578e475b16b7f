"""Cheap stand-ins for the posterior of one case, for trajectories that the exact density corrects.

Two kinds, both fitted to a thousand exact evaluations around the maximum, drawn first from the
Gaussian that the information matrix makes of it, then from what the first surrogate says:

- Without measurement noise posteriors are narrow. There the whitened residual of the emulator's
  mean is a quadratic polynomial r(z), and what |r|^2 / 2 lacks of the potential another.
- With noise they are wide, and no polynomial of low degree follows the mean. The emulator's mean
  itself is cheap, though: only its log variance becomes a quadratic polynomial.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from regional_lv.emulators.base import join
from regional_lv.inference.nuts import Target, refine, student
from regional_lv.seeds import derive

ROUNDS = (300, 300, 500)
"""Exact evaluations of each round."""

SCALE = 10.0
"""Excess potential at which an evaluation weighs a quarter of one at the maximum."""

RIDGE = 1e-6
"""Relative penalty that keeps a fit to nearly dependent columns regular."""


@dataclass(frozen=True)
class Frame:
    """Coordinates z in which polynomials are fitted: position = origin + z inverse'^-1.

    origin (..., 1, P), inverse (..., P, P): one case, or several stacked.
    """

    origin: torch.Tensor
    inverse: torch.Tensor

    def features(self, position: torch.Tensor) -> torch.Tensor:
        """1, z and all products of two, (..., K, F), at positions (..., K, P)."""
        z = (position - self.origin) @ self.inverse.mT
        first, second = torch.triu_indices(z.shape[-1], z.shape[-1])
        return torch.cat([torch.ones_like(z[..., :1]), z, z[..., first] * z[..., second]], dim=-1)


@dataclass(frozen=True)
class Polynomial:
    """Potential |r|^2 / 2 + q with r (..., F, D) and q (..., F, 1) polynomials in `frame`."""

    frame: Frame
    residual: torch.Tensor
    rest: torch.Tensor

    @classmethod
    def fit(cls, target: Target, frame: Frame, position, potential, prediction) -> "Polynomial":
        """From exact evaluations: `potential` (M,) and `prediction` at `position` (M, P)."""
        best = potential.argmin()
        likelihood = target.likelihood
        spread = prediction.covariance[best] + torch.diag(likelihood.noise.sd.square())
        factor = torch.linalg.cholesky(spread)
        white = torch.linalg.solve_triangular(
            factor, (likelihood.y - prediction.mean).T, upper=False
        ).T
        features, weight = frame.features(position), _weights(potential)
        residual = _least_squares(features, white, weight)
        lacking = potential - 0.5 * (features @ residual).square().sum(-1)
        return cls(frame, residual, _least_squares(features, lacking[:, None], weight))

    @staticmethod
    def together(parts: Sequence["Polynomial"], target: Target) -> "Polynomial":
        return Polynomial(
            _stack([part.frame for part in parts]),
            torch.stack([part.residual for part in parts]),
            torch.stack([part.rest for part in parts]),
        )

    def __call__(self, position: torch.Tensor) -> torch.Tensor:
        """The potential (..., K) at positions (..., K, P)."""
        features = self.frame.features(position)
        return 0.5 * (features @ self.residual).square().sum(-1) + (features @ self.rest)[..., 0]


@dataclass(frozen=True)
class OwnMean:
    """The exact potential, but for the emulator's log variance: a polynomial in `frame`, kept
    between the smallest and largest value that it was fitted to.

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
        coefficients = _least_squares(frame.features(position), logs[:, None], _weights(potential))
        return cls(target, frame, coefficients, torch.stack([logs.min(), logs.max()])[None])

    @staticmethod
    def together(parts: Sequence["OwnMean"], target: Target) -> "OwnMean":
        return OwnMean(
            target,
            _stack([part.frame for part in parts]),
            torch.stack([part.log_variance for part in parts]),
            torch.stack([part.ends for part in parts]),
        )

    def __call__(self, position: torch.Tensor) -> torch.Tensor:
        """The potential (..., K) at positions (..., K, P)."""
        logs = (self.frame.features(position) @ self.log_variance)[..., 0]
        logs = torch.minimum(torch.maximum(logs, self.ends[..., 0]), self.ends[..., 1])
        return self.target.potential(position, torch.exp(logs))


@dataclass(frozen=True)
class Prepared:
    """A posterior to sample: position = centre + whitening z, with z close to standard normal."""

    target: Target
    centre: torch.Tensor
    whitening: torch.Tensor
    surrogate: Polynomial | OwnMean | None


def prepare(
    target: Target, theta: torch.Tensor, log_sigma: torch.Tensor, seed: int, careful: bool = False
) -> Prepared:
    """Centre, whitening and surrogate of one case; theta (10,), log_sigma (G,): its maximum.

    careful: no polynomial of the mean. There is no surrogate at all where the noise is inferred, or
    where the mean is needed and the emulator's covariance is not separable.
    """
    likelihood = target.likelihood
    wide = careful or likelihood.noisy
    if likelihood.noise.groups or (wide and not likelihood.separable):
        mode, whitening = target.laplace(target.unconstrain(theta, log_sigma))
        centre, whitening = refine(target.potential, mode, whitening, derive(seed, "refine"))
        return Prepared(target, centre, whitening, None)
    kind = OwnMean if wide else Polynomial
    centre, whitening = target.gaussian(theta, log_sigma)
    generator = torch.Generator().manual_seed(derive(seed, "places"))
    places, potentials, predictions = [], [], []
    for size in ROUNDS:
        deviates, _ = student(size, target.size, generator)
        position = centre + deviates @ whitening.T
        with torch.no_grad():
            potential, prediction = target.evaluate(position)
        places.append(position)
        potentials.append(potential)
        predictions.append(prediction)
        frame = Frame(centre, torch.linalg.inv(whitening))
        surrogate = kind.fit(
            target, frame, torch.cat(places), torch.cat(potentials), join(predictions)
        )
        centre, whitening = refine(
            surrogate, centre, whitening, derive(seed, "refine", len(places))
        )
    return Prepared(target, centre, whitening, surrogate)


def together(prepared: Sequence[Prepared]):
    """Exact potential of all cases, and that of their surrogates, about positions (C, K, P).

    The second is None where there are no surrogates.
    """
    targets = [p.target for p in prepared]
    exact = Target.together(targets)
    if prepared[0].surrogate is None:
        return exact, None
    surrogates = [p.surrogate for p in prepared]
    return exact, type(surrogates[0]).together(surrogates, exact)


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
