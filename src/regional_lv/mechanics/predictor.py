"""Predicts the field of the next simulation from solutions and their derivatives in log theta.

A Gaussian process on values and gradients interpolates them: `Known` the fields as they are, while
the first simulations, the anchors, are solved; `Predictor` their proper orthogonal modes, for all
the others. There is one of either for each load.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from regional_lv.channels import Channels
from regional_lv.derivative_kernel import joint_covariance
from regional_lv.parameters import Parameterisation

# The kernel in log theta, a product over the zones. Of 24 anchors held out of 120 it misses the
# field by 2.0 % (mean; at most 4.6 %); length scales of 8 to 20 and an alpha of 0.03 to 0.4 by 1.9
# to 2.8 %. One kernel of all ten parameters missed it by 3.7 % (at most 13 %).
LENGTHSCALE, ALPHA, NUGGET = 12.0, 0.1, 1e-8
TANGENT_WEIGHT = 0.3  # a typical step in log theta: what a tangent is worth beside a field
LEAST_ENERGY, MOST_MODES = 1e-10, 200


def _covariance(logs: np.ndarray, others: np.ndarray, blocks: Sequence[slice]) -> np.ndarray:
    return joint_covariance(logs, others, np.full(logs.shape[1], LENGTHSCALE), ALPHA, blocks)


def _among(logs: np.ndarray, blocks: Sequence[slice]) -> np.ndarray:
    covariance = _covariance(logs, logs, blocks)
    covariance[np.diag_indices_from(covariance)] *= 1 + NUGGET
    return covariance


class Known:
    """Solutions so far at one load, and a field guessed from them.

    size: degrees of freedom of a field. blocks: places in theta of the zones' parameters.
    """

    def __init__(self, size: int, blocks: Sequence[slice]):
        parameters = blocks[-1].stop
        self._blocks = blocks
        self._logs = np.zeros((0, parameters))
        self._fields = np.zeros((0, size))
        self._tangents = np.zeros((parameters, 0, size))

    def add(self, theta: np.ndarray, field: np.ndarray, tangents: np.ndarray) -> None:
        """Take up the solution (size,) at `theta` (P,) with d(field)/d(log theta) (P, size)."""
        self._logs = np.vstack([self._logs, np.log(theta)])
        self._fields = np.vstack([self._fields, field])
        self._tangents = np.concatenate([self._tangents, tangents[:, None]], axis=1)

    def field(self, theta: np.ndarray) -> np.ndarray:
        """Guessed field (size,) at `theta` (P,)."""
        among = _covariance(np.log(theta)[None], self._logs, self._blocks)[0]
        weights = np.linalg.solve(_among(self._logs, self._blocks), among)
        n, mean = len(self._logs), self._fields.mean(axis=0)
        from_values = weights[:n] @ (self._fields - mean)
        return mean + from_values + np.tensordot(weights[n:].reshape(-1, n), self._tangents, 2)

    def nearest(self, theta: np.ndarray) -> np.ndarray:
        """The theta (P,) of the solution that is nearest to `theta` in its logarithm."""
        gap = np.log(theta) - self._logs
        return np.exp(self._logs[(gap**2).sum(axis=1).argmin()])

    def distance(self, thetas: np.ndarray) -> np.ndarray:
        """Squared distance in log theta of the rows of `thetas` (n, P) to what is known, (n,)."""
        gap = np.log(thetas)[:, None, :] - self._logs
        return (gap**2).sum(axis=-1).min(axis=1)


@dataclass(frozen=True)
class Predictor:
    """Fields (size,) at one load as a function of theta (P,).

    logs (n, P) of the anchors' theta; mean (size,) and modes (m, size) of their fields; weights
    ((1 + P) n, m) of the anchors' values and gradients; edges (Z + 1,) of the zones' parameters.
    """

    logs: np.ndarray
    mean: np.ndarray
    modes: np.ndarray
    weights: np.ndarray
    edges: np.ndarray

    @property
    def _blocks(self) -> list[slice]:
        return [slice(a, b) for a, b in zip(self.edges, self.edges[1:], strict=False)]

    def field(self, theta: np.ndarray) -> np.ndarray:
        """Predicted field (size,) at `theta` (P,)."""
        among = _covariance(np.log(theta)[None], self.logs, self._blocks)[0]
        return self.mean + (among @ self.weights) @ self.modes

    @classmethod
    def fit(
        cls, theta: np.ndarray, fields: np.ndarray, tangents: np.ndarray, blocks: Sequence[slice]
    ) -> "Predictor":
        """From anchors theta (n, P), fields (n, size) and tangents (n, P, size)."""
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
        weights = np.linalg.solve(_among(logs, blocks), coefficients)
        return cls(logs, mean, modes, weights, np.array([0, *(b.stop for b in blocks)]))


_FIELDS = tuple(Predictor.__dataclass_fields__)


def save_predictors(predictors: dict[float, Predictor], path: str | Path) -> None:
    """Write the predictors of all loads, by load fraction, to one file (npz)."""
    arrays = {
        f"{k}@{float(load)!r}": getattr(p, k) for load, p in predictors.items() for k in _FIELDS
    }
    np.savez(path, **arrays)


def load_predictors(path: str | Path) -> dict[float, Predictor]:
    """What `save_predictors` wrote."""
    with np.load(path) as saved:
        loads = dict.fromkeys(name.partition("@")[2] for name in saved.files)
        return {
            float(load): Predictor(**{k: saved[f"{k}@{load}"] for k in _FIELDS}) for load in loads
        }


def read_anchors(
    paths: Sequence[str | Path], load: float = 1.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """theta (n, P), fields (n, size) and tangents (n, P, size) at a load, of the anchors' files."""
    parts = []
    for path in paths:
        with np.load(path) as saved:
            names = "theta", f"fields@{load:g}", f"tangents@{load:g}"
            parts.append([saved[name].astype(float) for name in names])
    theta, fields, tangents = (np.concatenate(column) for column in zip(*parts, strict=True))
    return theta, fields, tangents


def fit_predictor(anchors: Sequence[str | Path], physics: dict, predictor: str | Path) -> None:
    """Fit a predictor for every load to the anchors' files; write them (npz)."""
    blocks = Parameterisation.from_spec(physics["parameters"]).blocks
    loads = Channels.from_config(physics).load_fractions
    found = {load: Predictor.fit(*read_anchors(anchors, load), blocks) for load in loads}
    save_predictors(found, predictor)
