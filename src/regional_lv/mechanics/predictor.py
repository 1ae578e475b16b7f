"""Predicts the displacement field of the next simulation from those of a first few, the anchors.

The anchors' fields and their derivatives in log theta are reduced to their proper orthogonal modes;
a Gaussian process on values and gradients (`gradient_gp`) predicts the modes' coefficients.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from regional_lv import gradient_gp

TANGENT_WEIGHT = 0.3  # a typical step in log theta: what a tangent is worth beside a field
LEAST_ENERGY, MOST_MODES = 1e-10, 200
# The kernel's hyperparameters come from the leading modes of this many anchors.
FIT_ANCHORS, FIT_MODES = 100, 10


@dataclass(frozen=True)
class Predictor:
    """Fields (size,) as a function of theta (10,).

    theta (n, 10) of the anchors; mean (size,) and modes (m, size) of their fields; coefficients
    (n, m) and slopes (n, 10, m), d(coefficients)/d(log theta); lengthscales (10,) and alpha of the
    kernel; weights (11 n, m) of the anchors' values and gradients.
    """

    theta: np.ndarray
    mean: np.ndarray
    modes: np.ndarray
    coefficients: np.ndarray
    slopes: np.ndarray
    lengthscales: np.ndarray
    alpha: float
    weights: np.ndarray

    def field(self, theta: np.ndarray) -> np.ndarray:
        """Predicted field (size,) at `theta` (10,)."""
        gap = (np.log(theta) - np.log(self.theta)) / self.lengthscales
        value, first, _ = gradient_gp.rational_quadratic((gap**2).sum(-1), self.alpha)
        slope = -2 * first[:, None] * gap / self.lengthscales
        kernel = np.concatenate([value, slope.T.ravel()])
        return self.mean + (kernel @ self.weights) @ self.modes

    def nearest(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """theta (10,), field (size,) and tangents (10, size) of the anchor nearest in log theta."""
        row = int(np.argmin(((np.log(theta) - np.log(self.theta)) ** 2).sum(axis=1)))
        field = self.mean + self.coefficients[row] @ self.modes
        return self.theta[row], field, self.slopes[row] @ self.modes

    def save(self, path: Path) -> None:
        """Write to `path` (npz)."""
        np.savez(path, **self.__dict__)

    @classmethod
    def load(cls, path: Path) -> "Predictor":
        """Read what `save` wrote."""
        with np.load(path) as saved:
            return cls(**{name: saved[name] for name in cls.__dataclass_fields__})


def fit_predictor(theta: np.ndarray, fields: np.ndarray, tangents: np.ndarray) -> Predictor:
    """Predictor from anchors theta (n, 10), fields (n, size) and tangents (n, 10, size)."""
    mean = fields.mean(axis=0)
    weighted = TANGENT_WEIGHT * tangents.reshape(-1, tangents.shape[-1])
    snapshots = np.concatenate([fields - mean, weighted])
    energies, vectors = np.linalg.eigh(snapshots @ snapshots.T)
    kept = np.flatnonzero(energies > LEAST_ENERGY * energies.sum())[::-1][:MOST_MODES]
    modes = (vectors[:, kept] / np.sqrt(energies[kept])).T @ snapshots
    coefficients, slopes = (fields - mean) @ modes.T, tangents @ modes.T

    x = np.log(theta)
    few = np.linspace(0, len(x) - 1, min(len(x), FIT_ANCHORS)).astype(int)
    h = gradient_gp.fit(x[few], coefficients[few, :FIT_MODES], slopes[few, :, :FIT_MODES])
    factor = gradient_gp.factorise(x, h)
    data = torch.as_tensor(gradient_gp.observations(coefficients, slopes))
    weights = torch.cholesky_solve(data, factor).numpy()
    return Predictor(theta, mean, modes, coefficients, slopes, h.lengthscales, h.alpha, weights)
