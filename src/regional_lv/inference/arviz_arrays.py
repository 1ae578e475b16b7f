"""What ArviZ does to arrays, where its releases before and after 1 differ.

ArviZ 1 needs Python 3.12; Debian 12's DOLFINx, of Python 3.11, goes with ArviZ 0.23.
"""

import arviz as az
import numpy as np

PARETO_K = 0.7
"""Largest shape of the tail of importance weights that smoothing puts right (Vehtari et al. 2024,
JMLR 25:72)."""

if hasattr(az, "psislw"):
    _psislw, autocorr, kde = az.psislw, az.autocorr, az.kde
else:
    from arviz_stats.base import array_stats

    autocorr = array_stats.autocorr

    def kde(x: np.ndarray, **settings) -> tuple[np.ndarray, np.ndarray]:
        grid, density, *_ = array_stats.kde(x, **settings)  # the width, too
        return grid, density

    def _psislw(log_weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # Of log likelihoods that are left out, which weigh as their inverse.
        return array_stats.psislw(-log_weights)


def smoothed_weights(log_weights: np.ndarray) -> tuple[np.ndarray, float]:
    """Pareto-smoothed log weights (N,), normalised, and the shape k of their tail (Vehtari et al.
    2024)."""
    smoothed, k = _psislw(log_weights)
    return np.asarray(smoothed), float(k)


def hdi95(draws: np.ndarray) -> tuple[float, float]:
    """Ends of the narrowest interval that holds 95 % of the draws (N,)."""
    low, high = az.hdi(draws, 0.95)
    return float(low), float(high)
