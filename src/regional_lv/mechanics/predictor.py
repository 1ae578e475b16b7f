"""Predicts the field of the next simulation from solutions and their derivatives in log theta.

A Gaussian process on values and gradients interpolates them: `Known` the fields as they are, while
the first simulations, the anchors, are solved; `Predictor` their proper orthogonal modes, for all
the others.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from regional_lv.kernel import joint_covariance

# The kernel in log theta, a product over the zones. Of 24 anchors held out of 120 it misses the
# field by 2.0 % (mean; at most 4.6 %); length scales of 8 to 20 and an alpha of 0.03 to 0.4 by 1.9
# to 2.8 %. One kernel of all ten parameters missed it by 3.7 % (at most 13 %).
LENGTHSCALE, ALPHA, NUGGET = 12.0, 0.1, 1e-8
TANGENT_WEIGHT = 0.3  # a typical step in log theta: what a tangent is worth beside a field
LEAST_ENERGY, MOST_MODES = 1e-10, 200


def _covariance(logs: np.ndarray, others: np.ndarray) -> np.ndarray:
    return joint_covariance(logs, others, np.full(logs.shape[1], LENGTHSCALE), ALPHA)


def _among(logs: np.ndarray) -> np.ndarray:
    covariance = _covariance(logs, logs)
    covariance[np.diag_indices_from(covariance)] *= 1 + NUGGET
    return covariance


class Known:
    """Solutions so far, and a field guessed from them."""

    def __init__(self, size: int):
        self._logs = np.zeros((0, 10))
        self._fields = np.zeros((0, size))
        self._tangents = np.zeros((10, 0, size))

    def add(self, theta: np.ndarray, field: np.ndarray, tangents: np.ndarray) -> None:
        """Take up the solution (size,) at `theta` (10,) with d(field)/d(log theta) (10, size)."""
        self._logs = np.vstack([self._logs, np.log(theta)])
        self._fields = np.vstack([self._fields, field])
        self._tangents = np.concatenate([self._tangents, tangents[:, None]], axis=1)

    def field(self, theta: np.ndarray) -> np.ndarray:
        """Guessed field (size,) at `theta` (10,)."""
        among = _covariance(np.log(theta)[None], self._logs)[0]
        weights = np.linalg.solve(_among(self._logs), among)
        n, mean = len(self._logs), self._fields.mean(axis=0)
        from_values = weights[:n] @ (self._fields - mean)
        return mean + from_values + np.tensordot(weights[n:].reshape(10, n), self._tangents, 2)

    def nearest(self, theta: np.ndarray) -> np.ndarray:
        """The theta (10,) of the solution that is nearest to `theta` in its logarithm."""
        gap = np.log(theta) - self._logs
        return np.exp(self._logs[(gap**2).sum(axis=1).argmin()])

    def distance(self, thetas: np.ndarray) -> np.ndarray:
        """Squared distance in log theta of the rows of `thetas` (n, 10) to what is known, (n,)."""
        gap = np.log(thetas)[:, None, :] - self._logs
        return (gap**2).sum(axis=-1).min(axis=1)


@dataclass(frozen=True)
class Predictor:
    """Fields (size,) as a function of theta (10,).

    logs (n, 10) of the anchors' theta; mean (size,) and modes (m, size) of their fields; weights
    (11 n, m) of the anchors' values and gradients.
    """

    logs: np.ndarray
    mean: np.ndarray
    modes: np.ndarray
    weights: np.ndarray

    def field(self, theta: np.ndarray) -> np.ndarray:
        """Predicted field (size,) at `theta` (10,)."""
        among = _covariance(np.log(theta)[None], self.logs)[0]
        return self.mean + (among @ self.weights) @ self.modes

    def save(self, path: Path) -> None:
        """Write to `path` (npz)."""
        np.savez(path, **self.__dict__)

    @classmethod
    def load(cls, path: Path) -> "Predictor":
        """Read what `save` wrote."""
        with np.load(path) as saved:
            return cls(**{name: saved[name] for name in cls.__dataclass_fields__})

    @classmethod
    def fit(cls, theta: np.ndarray, fields: np.ndarray, tangents: np.ndarray) -> "Predictor":
        """From anchors theta (n, 10), fields (n, size) and tangents (n, 10, size)."""
        n, size = fields.shape
        mean = fields.mean(axis=0)
        snapshots = np.concatenate(
            [fields - mean, TANGENT_WEIGHT * tangents.transpose(1, 0, 2).reshape(-1, size)]
        )
        energies, vectors = np.linalg.eigh(snapshots @ snapshots.T)
        kept = np.flatnonzero(energies > LEAST_ENERGY * energies.sum())[::-1][:MOST_MODES]
        modes = (vectors[:, kept] / np.sqrt(energies[kept])).T @ snapshots
        coefficients = snapshots @ modes.T
        coefficients[n:] /= TANGENT_WEIGHT
        logs = np.log(theta)
        return cls(logs, mean, modes, np.linalg.solve(_among(logs), coefficients))


def read_anchors(paths: list[Path]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """theta (n, 10), fields (n, size) and tangents (n, 10, size) of the anchors' files."""
    parts = []
    for path in paths:
        with np.load(path) as saved:
            parts.append([saved[name].astype(float) for name in ("theta", "fields", "tangents")])
    theta, fields, tangents = (np.concatenate(column) for column in zip(*parts, strict=True))
    return theta, fields, tangents
