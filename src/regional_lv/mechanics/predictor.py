"""Predicts the field of the next simulation from solutions and their derivatives.

A Gaussian process on values and gradients interpolates them: `Known` the fields as they are, while
the first simulations, the anchors, are solved; `Predictor` their proper orthogonal modes, for all
the others. There is one of either for each load.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from regional_lv.channels import Channels
from regional_lv.inputs.coordinates import Coordinates
from regional_lv.inputs.space import coordinates_of
from regional_lv.mechanics.derivative_kernel import joint_covariance

# The kernel in log theta (other inputs: `Coordinates.place`), a product over the zones. Of 24
# anchors held out of 120 it misses the field by 2.0 % (mean; at most 4.6 %); length scales of 8 to
# 20 and an alpha of 0.03 to 0.4 by 1.9 to 2.8 %. One kernel of all ten parameters missed it by
# 3.7 % (at most 13 %).
LENGTHSCALE, ALPHA, NUGGET = 12.0, 0.1, 1e-8
TANGENT_WEIGHT = 0.3  # a typical step in log theta: what a tangent is worth beside a field
MOST_OBSERVED = 3000  # fields and tangents that a field is guessed from, those of the nearest
LEAST_ENERGY, MOST_MODES = 1e-10, 200


def _covariance(logs: np.ndarray, others: np.ndarray, blocks: Sequence[slice]) -> np.ndarray:
    return joint_covariance(logs, others, np.full(logs.shape[1], LENGTHSCALE), ALPHA, blocks)


def _among(logs: np.ndarray, blocks: Sequence[slice]) -> np.ndarray:
    covariance = _covariance(logs, logs, blocks)
    covariance[np.diag_indices_from(covariance)] *= 1 + NUGGET
    return covariance


def _gaps(places: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Squared distances (n,) of places (n, K) to one (K,)."""
    return ((place - places) ** 2).sum(axis=-1)


def _nearest(places: np.ndarray, coordinates: Coordinates, theta: np.ndarray) -> np.ndarray:
    """Theta (K,) of the one of places (n, K) that is nearest to `theta`."""
    nearest = places[_gaps(places, coordinates.place(theta)).argmin()]
    return coordinates.natural(nearest * coordinates.units)


class Known:
    """Solutions so far at one load, and a field guessed from them.

    size: degrees of freedom of a field. coordinates: of the K inputs theta.
    """

    def __init__(self, size: int, coordinates: Coordinates):
        self._coordinates = coordinates
        self._places = np.zeros((0, len(coordinates)))
        self._fields = np.zeros((0, size))
        self._tangents = np.zeros((0, len(coordinates), size))

    def add(self, theta: np.ndarray, field: np.ndarray, tangents: np.ndarray) -> None:
        """Take up the solution (size,) at `theta` (K,) with its derivatives (K, size) with respect
        to the scaled coordinates."""
        units = self._coordinates.units
        self._places = np.vstack([self._places, self._coordinates.place(theta)])
        self._fields = np.vstack([self._fields, field])
        self._tangents = np.concatenate([self._tangents, (tangents * units[:, None])[None]])

    def field(self, theta: np.ndarray) -> np.ndarray:
        """Guessed field (size,) at `theta` (K,)."""
        here, blocks = self._coordinates.place(theta), self._coordinates.blocks
        most = max(1, MOST_OBSERVED // (1 + len(here)))
        near = np.sort(np.argsort(_gaps(self._places, here), kind="stable")[:most])
        places = self._places[near]
        among = _covariance(here[None], places, blocks)[0]
        weights = np.linalg.solve(_among(places, blocks), among)
        n, fields = len(near), self._fields[near]
        mean = fields.mean(axis=0)
        by_tangent = weights[n:].reshape(-1, n).T
        from_tangents = sum(by_tangent[i] @ self._tangents[at] for i, at in enumerate(near))
        return mean + weights[:n] @ (fields - mean) + from_tangents

    def nearest(self, theta: np.ndarray) -> np.ndarray:
        """The theta (K,) of the solution that is nearest to `theta`."""
        return _nearest(self._places, self._coordinates, theta)

    def distance(self, thetas: np.ndarray) -> np.ndarray:
        """Squared distance of the rows of `thetas` (n, K) to what is known, (n,)."""
        places = self._coordinates.place(thetas)
        return np.array([_gaps(self._places, place).min() for place in places])


@dataclass(frozen=True)
class Predictor:
    """Fields (size,) at one load as a function of the K inputs theta.

    coordinates: of the inputs. places (n, K) of the anchors; mean (size,) and modes (m, size) of
    their fields; weights ((1 + K) n, m) of the anchors' values and gradients.
    """

    coordinates: Coordinates
    places: np.ndarray
    mean: np.ndarray
    modes: np.ndarray
    weights: np.ndarray

    def field(self, theta: np.ndarray) -> np.ndarray:
        """Predicted field (size,) at `theta` (K,)."""
        here, blocks = self.coordinates.place(theta)[None], self.coordinates.blocks
        among = _covariance(here, self.places, blocks)[0]
        return self.mean + (among @ self.weights) @ self.modes

    def nearest(self, theta: np.ndarray) -> np.ndarray:
        """Theta (K,) of the nearest anchor."""
        return _nearest(self.places, self.coordinates, theta)

    @classmethod
    def fit(
        cls,
        theta: np.ndarray,
        fields: np.ndarray,
        tangents: np.ndarray,
        coordinates: Coordinates,
    ) -> "Predictor":
        """From anchors theta (n, K), fields (n, size) and tangents (n, K, size), derivatives with
        respect to the scaled coordinates."""
        n, size = fields.shape
        mean = fields.mean(axis=0)
        tangents = tangents * coordinates.units[:, None]
        snapshots = np.concatenate(
            [fields - mean, TANGENT_WEIGHT * tangents.transpose(1, 0, 2).reshape(-1, size)]
        )
        energies, vectors = np.linalg.eigh(snapshots @ snapshots.T)
        kept = np.flatnonzero(energies > LEAST_ENERGY * energies.sum())[::-1][:MOST_MODES]
        modes = (vectors[:, kept] / np.sqrt(energies[kept])).T @ snapshots
        coefficients = snapshots @ modes.T
        coefficients[n:] /= TANGENT_WEIGHT
        places = coordinates.place(theta)
        weights = np.linalg.solve(_among(places, coordinates.blocks), coefficients)
        return cls(coordinates, places, mean, modes, weights)


_FIELDS = ("places", "mean", "modes", "weights")


def save_predictors(predictors: dict[float, Predictor], path: str | Path) -> None:
    """Write the predictors of all loads, by load fraction, to one file (npz)."""
    arrays = {
        f"{k}@{float(load)!r}": getattr(p, k) for load, p in predictors.items() for k in _FIELDS
    }
    np.savez(path, **arrays)


def load_predictors(path: str | Path, coordinates: Coordinates) -> dict[float, Predictor]:
    """What `save_predictors` wrote, of inputs with these coordinates."""
    with np.load(path) as saved:
        loads = dict.fromkeys(name.partition("@")[2] for name in saved.files)
        return {
            float(load): Predictor(coordinates, *(saved[f"{k}@{load}"] for k in _FIELDS))
            for load in loads
        }


def read_anchors(
    paths: Sequence[str | Path], load: float = 1.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """theta (n, K), fields (n, size) and tangents (n, K, size) at a load, of the anchors' files."""
    parts = []
    for path in paths:
        with np.load(path) as saved:
            names = "theta", f"fields@{load:g}", f"tangents@{load:g}"
            parts.append([saved[name].astype(float) for name in names])
    theta, fields, tangents = (np.concatenate(column) for column in zip(*parts, strict=True))
    return theta, fields, tangents


def fit_predictor(anchors: Sequence[str | Path], physics: dict, predictor: str | Path) -> None:
    """Fit a predictor for every load to the anchors' files; write them (npz)."""
    coordinates = coordinates_of(physics)
    loads = Channels.from_config(physics).load_fractions
    found = {load: Predictor.fit(*read_anchors(anchors, load), coordinates) for load in loads}
    save_predictors(found, predictor)
