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
    factor counts positive.
    """
    standard, scores = stats.zscore(draws), []
    for block in parameters.blocks:
        component = PCA(1, svd_solver="full")
        score = component.fit_transform(standard[:, block])[:, 0]
        scores.append(score * np.copysign(1.0, component.components_[0, 0]))
    return np.atleast_2d(np.corrcoef(scores))


def average(matrices: np.ndarray, names: tuple[str, ...], kind: str) -> pd.DataFrame:
    """Mean and its standard error over the cases of `matrices` (C, K, K), all ordered pairs.

    Columns: <kind>_1, <kind>_2, mean, se (empty with one case), cases.
    """
    cases, size, _ = matrices.shape
    first, second = (grid.ravel() for grid in np.meshgrid(names, names, indexing="ij"))
    se = stats.sem(matrices).ravel() if cases > 1 else np.full(size * size, np.nan)
    return pd.DataFrame(
        {
            f"{kind}_1": first,
            f"{kind}_2": second,
            "mean": matrices.mean(axis=0).ravel(),
            "se": se,
            "cases": cases,
        }
    )


def correlate(draws: np.ndarray, parameters: StiffnessInputs) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Tables of `average` between the parameters and between the zones.

    draws: (C, M, P) posterior draws of theta. Posteriors that failed the convergence check count.
    """
    each = np.stack([np.atleast_2d(np.corrcoef(case, rowvar=False)) for case in draws])
    zones = np.stack([zone_correlation(case, parameters) for case in draws])
    return (
        average(each, parameters.names, "parameter"),
        average(zones, parameters.zone_names, "zone"),
    )
