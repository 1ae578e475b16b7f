"""How the parameters of a posterior hang together, and how alike that is from case to case."""

import numpy as np
import pandas as pd

from regional_lv.parameters import Parameterisation


def zone_correlation(correlation: np.ndarray, parameters: Parameterisation) -> np.ndarray:
    """Correlations (Z, Z) between the zones' first principal components, as in the paper.

    correlation: (P, P). Within a zone, the factors are replaced by the direction in which,
    standardised, they vary most: of two (1, -1) where they compensate (the rule), (1, 1) elsewhere;
    the first factor counts positive.
    """
    weights = np.zeros((len(parameters.zones), len(parameters)))
    for row, block in zip(weights, parameters.blocks, strict=True):
        component = np.linalg.eigh(correlation[block, block])[1][:, -1]
        # Its length does not matter; rounded, that of two factors is exact.
        row[block] = (component / component[np.abs(component).argmax()]).round(12)
        row[block] *= np.sign(row[block.start]) or 1.0
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


def correlate(draws: np.ndarray, parameters: Parameterisation) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Tables of `average` between the parameters and between the zones.

    draws: (C, M, P) posterior draws of theta. Posteriors that failed their gate count.
    """
    each = np.stack([np.atleast_2d(np.corrcoef(case, rowvar=False)) for case in draws])
    zones = np.stack([zone_correlation(matrix, parameters) for matrix in each])
    return (
        average(each, parameters.names, "parameter"),
        average(zones, parameters.zone_names, "zone"),
    )
