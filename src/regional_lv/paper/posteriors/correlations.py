"""How the parameters of a posterior hang together, and how alike that is from case to case."""

import numpy as np
import pandas as pd
from scipy import stats
from sklearn.decomposition import PCA

from regional_lv.inputs.stiffness import StiffnessInputs


def zone_correlation(draws: np.ndarray, parameters: StiffnessInputs) -> np.ndarray:
    """Correlations (Z, Z) between the zones' first principal components, as in the paper.

    draws: (M, P). Within a zone, the factors are replaced by the direction in which, standardised,
    they vary most: of two (1, -1) where they compensate (the rule), (1, 1) elsewhere; the first
    factor counts positive. NaN with a zone of which a factor is the same in all draws.
    """
    standard, still, scores = stats.zscore(draws), np.ptp(draws, axis=0) == 0, []
    for block in parameters.blocks:
        if still[block].any():
            scores.append(np.full(len(draws), np.nan))
            continue
        component = PCA(1, svd_solver="full")
        score = component.fit_transform(standard[:, block])[:, 0]
        scores.append(score * np.copysign(1.0, component.components_[0, 0]))
    return np.atleast_2d(np.corrcoef(scores))


def average(matrices: np.ndarray, names: tuple[str, ...], kind: str) -> pd.DataFrame:
    """Mean and its standard error over the cases of `matrices` (C, K, K), all ordered pairs.

    Columns: <kind>_1, <kind>_2, mean, se (empty with one case), cases (that have the correlation).
    """
    first, second = (grid.ravel() for grid in np.meshgrid(names, names, indexing="ij"))
    found = pd.DataFrame(matrices.reshape(len(matrices), -1))
    statistics = {"mean": found.mean(), "se": found.sem(), "cases": found.count()}
    return pd.DataFrame({f"{kind}_1": first, f"{kind}_2": second, **statistics})


def correlate(draws: np.ndarray, parameters: StiffnessInputs) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Tables of `average` between the parameters and between the zones.

    draws: (C, M, P) posterior draws of theta. Posteriors that failed the convergence check count;
    a parameter that never moved in one has no correlations there.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        each = np.stack([np.atleast_2d(np.corrcoef(case, rowvar=False)) for case in draws])
        zones = np.stack([zone_correlation(case, parameters) for case in draws])
    still = np.ptp(draws, axis=1) == 0  # where round-off may leave any number
    each[still[:, :, None] | still[:, None, :]] = np.nan
    return (
        average(each, parameters.names, "parameter"),
        average(zones, parameters.zone_names, "zone"),
    )
