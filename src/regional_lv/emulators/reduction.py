"""Principal components of the outputs, the volumes apart (the paper's reduced output)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.channels import Channels
from regional_lv.errors import InputError

VOLUME = "volume"
"""Name of the quantity that is kept apart."""


@dataclass(frozen=True)
class Reduction:
    """Linear map between the D outputs and k scores and the volumes.

    Of the outputs v are volumes, at any load and anywhere in the list, and S are not; both may be
    0.
    mean, sd: (D,) of the training outputs. volumes: mask (D,). loadings: (S, K) all principal
    directions of the other standardised outputs, in columns, strongest first, the largest entry of
    each positive; K is S, or the number of training rows if that is less. variances: (K,) of the
    scores. components: k, how many are kept.
    """

    mean: np.ndarray
    sd: np.ndarray
    volumes: np.ndarray
    loadings: np.ndarray
    variances: np.ndarray
    components: int

    @classmethod
    def fit(cls, y: np.ndarray, explained_variance: float, channels: Channels) -> "Reduction":
        """Fit to outputs `y` (N, D) in natural units; keep the fewest components that reach
        `explained_variance` (0-1) of the variance of all but the volumes.

        Raises InputError for fewer than two rows or numbers that are not finite.
        """
        y = np.asarray(y, dtype=float)
        if y.ndim != 2 or y.shape[1] != len(channels):
            raise InputError(
                f"reduction: outputs have shape {y.shape}; expected (N, {len(channels)})"
            )
        if len(y) < 2 or not np.isfinite(y).all():
            raise InputError(
                f"reduction: {len(y)} rows, {int((~np.isfinite(y)).any(axis=1).sum())} of them not "
                "finite; give at least two simulations that passed the screening"
            )
        mean, sd, span = y.mean(axis=0), y.std(axis=0, ddof=1), np.ptp(y, axis=0)
        if (span == 0).any():
            raise InputError(
                f"reduction: {channels.names[int(np.argmin(span))]} has the same value in every "
                "simulation; check the simulator"
            )
        volumes = channels.of_quantity(VOLUME)
        if volumes.all():
            return cls(mean, sd, volumes, np.zeros((0, 0)), np.zeros(0), 0)
        others = ((y - mean) / sd)[:, ~volumes]
        from sklearn.decomposition import PCA  # slow to load, and every job loads this module

        found = PCA(svd_solver="full").fit(others)
        enough = found.explained_variance_ratio_.cumsum() >= explained_variance - 1e-12
        loadings, variances = found.components_.T, found.explained_variance_
        return cls(mean, sd, volumes, loadings, variances, int(np.argmax(enough)) + 1)

    def transform(self, y: np.ndarray) -> np.ndarray:
        """Reduced outputs (..., k + v), scores and then standardised volumes, of `y` (..., D)."""
        standard = (y - self.mean) / self.sd
        scores = standard[..., ~self.volumes] @ self.loadings[:, : self.components]
        return np.concatenate([scores, standard[..., self.volumes]], axis=-1)

    def inverse(self, reduced: np.ndarray) -> np.ndarray:
        """Outputs (..., D) in natural units of `reduced` (..., k + v)."""
        scores, volumes = np.split(reduced, [self.components], axis=-1)
        standard = np.empty((*reduced.shape[:-1], len(self.mean)))
        standard[..., self.volumes] = volumes
        standard[..., ~self.volumes] = scores @ self.loadings[:, : self.components].T
        return standard * self.sd + self.mean

    def inverse_matrix(self) -> np.ndarray:
        """Matrix A (D, k + v) of `inverse`: a covariance C of reduced outputs becomes A C A'."""
        size = self.components + int(self.volumes.sum())
        return self.inverse(np.eye(size)).T - self.mean[:, None]

    def truncation_covariance(self) -> np.ndarray:
        """Covariance (D, D), natural units, of what the components left out would have added.

        Part of the likelihood of every emulator that works on reduced outputs: without it, data
        that the kept components cannot reproduce look impossible.
        """
        dropped = self.loadings[:, self.components :]
        covariance = np.zeros((len(self.mean), len(self.mean)))
        covariance[np.ix_(~self.volumes, ~self.volumes)] = (
            dropped * self.variances[self.components :]
        ) @ dropped.T
        return covariance * np.outer(self.sd, self.sd)

    def explained(self) -> pd.DataFrame:
        """Table with component (from 1), explained and cumulative (fractions of the variance), and
        whether it is kept."""
        share = self.variances / self.variances.sum()
        return pd.DataFrame(
            {
                "component": np.arange(1, len(share) + 1),
                "explained": share,
                "cumulative": np.minimum(np.cumsum(share), 1.0),
                "kept": np.arange(len(share)) < self.components,
            }
        )

    def save(self, path: str | Path) -> None:
        """Write the arrays (npz)."""
        np.savez(path, **self.__dict__)

    @classmethod
    def load(cls, path: str | Path) -> "Reduction":
        """Read what `save` wrote."""
        with np.load(path) as saved:
            arrays = {key: saved[key] for key in saved.files}
        return cls(**{**arrays, "components": int(arrays["components"])})


def fit_reduction(
    train: str | Path,
    channels: Channels,
    explained_variance: float,
    reduction: str | Path,
    explained: str | Path,
) -> None:
    """Fit to a screened table (Parquet); write the reduction (npz) and its variances (CSV)."""
    y = pd.read_parquet(train, columns=list(channels.names)).to_numpy(float)
    fitted = Reduction.fit(y, explained_variance, channels)
    fitted.save(reduction)
    fitted.explained().to_csv(explained, index=False)
