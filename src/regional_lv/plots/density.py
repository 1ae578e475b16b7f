"""Density of draws, as a curve."""

import numpy as np

from regional_lv.inference.arviz_arrays import kde


def density(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Kernel density estimate of draws: grid and density (128 each).

    Mass is reflected at the smallest and largest draw, so that a posterior leaning against the
    prior's bound shows as such. Draws that are all equal give a spike of finite height. Weighted
    draws come resampled: the more often they repeat, the wider the kernel (Silverman's rule for as
    many as count), or every draw that is repeated would show as a peak.
    """
    values = np.ravel(values)
    if np.ptp(values) == 0:
        width = max(abs(values[0]), 1.0) * 1e-3
        return np.array([values[0] - width, values[0], values[0] + width]), np.array([0, 1, 0.0])
    counts = np.unique(values, return_counts=True)[1]
    effective = len(values) ** 2 / np.square(counts).sum()
    width = {}
    if effective < len(values) / 2:
        width = {"bw": float(0.9 * values.std() * effective**-0.2)}
    return kde(values, grid_len=128, bound_correction=True, **width)
