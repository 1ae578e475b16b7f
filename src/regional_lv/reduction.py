"""Principal components of the strains, the volume apart (the paper's reduced output)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.errors import InputError

VOLUME = aha.OUTPUTS[0]


@dataclass(frozen=True)
class Reduction:
    """Linear map between the outputs and k scores and the volume.

    Sizes are those of all 52 outputs; fewer will do, and the volume may be missing.
    mean, sd: (52,) of the training outputs. loadings: (51, 51) all principal directions of the
    standardised strains, in columns, strongest first. variances: (51,) of the scores.
    components: k, how many are kept.
    """

    mean: np.ndarray
    sd: np.ndarray
    loadings: np.ndarray
    variances: np.ndarray
    components: int

    @classmethod
    def fit(
        cls, y: np.ndarray, explained_variance: float, outputs: Sequence[str] = aha.OUTPUTS
    ) -> "Reduction":
        """Fit to `outputs` `y` (N, 52) in natural units; keep the fewest components that reach
        `explained_variance` (0-1) of the strain variance. The volume, if any, stands first.

        Raises InputError for fewer than two rows or numbers that are not finite.
        """
        y = np.asarray(y, dtype=float)
        if y.ndim != 2 or y.shape[1] != len(outputs):
            raise InputError(
                f"reduction: outputs have shape {y.shape}; expected (N, {len(outputs)})"
            )
        if len(y) < 2 or not np.isfinite(y).all():
            raise InputError(
                f"reduction: {len(y)} rows, {int((~np.isfinite(y)).any(axis=1).sum())} of them not "
                "finite; give at least two simulations that passed the screening"
            )
        mean, sd = y.mean(axis=0), y.std(axis=0, ddof=1)
        if (sd == 0).any():
            raise InputError(
                f"reduction: {outputs[int(np.argmin(sd))]} has the same value in every "
                "simulation; check the simulator"
            )
        strains = ((y - mean) / sd)[:, int(outputs[0] == VOLUME) :]
        variances, loadings = np.linalg.eigh(np.atleast_2d(np.cov(strains, rowvar=False)))
        variances = np.maximum(variances[::-1], 0.0)
        loadings = loadings[:, ::-1]
        # The sign of an eigenvector is arbitrary: the largest entry is made positive.
        loadings = loadings * np.sign(loadings[np.abs(loadings).argmax(0), range(len(loadings))])
        cumulative = np.cumsum(variances) / variances.sum()
        enough = cumulative >= explained_variance - 1e-12
        return cls(mean, sd, loadings, variances, int(np.argmax(enough)) + 1)

    @property
    def _strains(self) -> slice:
        return slice(len(self.mean) - len(self.loadings), len(self.mean))

    def transform(self, y: np.ndarray) -> np.ndarray:
        """Reduced outputs (..., k + 1), scores and then standardised volume, of `y` (..., 52)."""
        standard = (y - self.mean) / self.sd
        scores = standard[..., self._strains] @ self.loadings[:, : self.components]
        return np.concatenate([scores, standard[..., : self._strains.start]], axis=-1)

    def inverse(self, reduced: np.ndarray) -> np.ndarray:
        """Outputs (..., 52) in natural units of `reduced` (..., k + 1)."""
        scores, volume = np.split(reduced, [self.components], axis=-1)
        strains = scores @ self.loadings[:, : self.components].T
        return np.concatenate([volume, strains], axis=-1) * self.sd + self.mean

    def inverse_matrix(self) -> np.ndarray:
        """Matrix A (52, k + 1) of `inverse`: a covariance C of reduced outputs becomes A C A'."""
        size = self.components + self._strains.start
        return self.inverse(np.eye(size)).T - self.mean[:, None]

    def truncation_covariance(self) -> np.ndarray:
        """Covariance (52, 52), natural units, of what the components left out would have added.

        Part of the likelihood of every emulator that works on reduced outputs: without it, data
        that the kept components cannot reproduce look impossible.
        """
        dropped = self.loadings[:, self.components :]
        covariance = np.zeros((len(self.mean), len(self.mean)))
        covariance[self._strains, self._strains] = (
            dropped * self.variances[self.components :]
        ) @ dropped.T
        return covariance * np.outer(self.sd, self.sd)

    def explained(self) -> pd.DataFrame:
        """Table with component (from 1), explained and cumulative (fractions of the variance)."""
        share = self.variances / self.variances.sum()
        return pd.DataFrame(
            {
                "component": np.arange(1, len(share) + 1),
                "explained": share,
                "cumulative": np.minimum(np.cumsum(share), 1.0),
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
    train: str | Path, explained_variance: float, reduction: str | Path, table: str | Path
) -> None:
    """Fit to a screened table (Parquet); write the reduction (npz) and its variances (CSV)."""
    y = pd.read_parquet(train, columns=list(aha.OUTPUTS)).to_numpy(float)
    fitted = Reduction.fit(y, explained_variance)
    fitted.save(reduction)
    fitted.explained().to_csv(table, index=False)
