"""How the parameters of a posterior hang together, and how alike that is from case to case."""

import numpy as np
import pandas as pd

from regional_lv import aha

PAIR = np.array([[2 * i, 2 * i + 1] for i in range(len(aha.ZONES))])
"""Places of C_a and C_b of every zone in `aha.PARAMETERS`."""


def zone_correlation(correlation: np.ndarray) -> np.ndarray:
    """Correlations (5, 5) between the zones' first principal components, as in the paper.

    correlation: (10, 10). Within a zone, C_a and C_b are replaced by the direction in which,
    standardised, they vary most: (1, -1) where they compensate (the rule), (1, 1) elsewhere; C_a
    counts positive.
    """
    weights = np.zeros((len(aha.ZONES), len(aha.PARAMETERS)))
    for zone, (a, b) in enumerate(PAIR):
        weights[zone, a] = 1.0
        weights[zone, b] = 1.0 if correlation[a, b] > 0 else -1.0
    covariance = weights @ correlation @ weights.T
    sd = np.sqrt(covariance.diagonal())
    return covariance / np.outer(sd, sd)


def average(matrices: np.ndarray, names: tuple[str, ...], kind: str) -> pd.DataFrame:
    """Mean and its standard error over the cases of `matrices` (C, K, K), all ordered pairs.

    Columns: <kind>_1, <kind>_2, mean, se (empty with one case), cases.
    """
    cases, size, _ = matrices.shape
    first, second = (grid.ravel() for grid in np.meshgrid(names, names, indexing="ij"))
    se = np.full(size * size, np.nan)
    if cases > 1:
        se = (matrices.std(axis=0, ddof=1) / np.sqrt(cases)).ravel()
    return pd.DataFrame(
        {
            f"{kind}_1": first,
            f"{kind}_2": second,
            "mean": matrices.mean(axis=0).ravel(),
            "se": se,
            "cases": cases,
        }
    )


def correlate(draws: np.ndarray) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Tables of `average` between the parameters and between the zones.

    draws: (C, M, 10) posterior draws of theta. Posteriors that failed their gate count.
    """
    each = np.stack([np.corrcoef(case, rowvar=False) for case in draws])
    zones = np.stack([zone_correlation(matrix) for matrix in each])
    return average(each, aha.PARAMETERS, "parameter"), average(zones, aha.ZONES, "zone")
