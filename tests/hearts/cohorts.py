"""Cohorts whose population is known: what the data of hearts say, and draws of their posteriors."""

import numpy as np
from scipy.special import ndtr, ndtri

from regional_lv.hearts.likelihoods import NormalLikelihood

LOWER, UPPER = 0.1, 5.0


def ridge(known: float, loose: float) -> np.ndarray:
    """Covariance (2, 2) of a zone's two factors, known in one combination and not in the other."""
    turn = np.array([[0.8, 0.6], [-0.6, 0.8]])
    return turn.T @ np.diag([known**2, loose**2]) @ turn


def covariances(count: int, rng: np.random.Generator, zones: int = 2) -> np.ndarray:
    """Of what hearts (H, P, P) measure of their zones."""
    found = np.zeros((count, 2 * zones, 2 * zones))
    for heart in found:
        for z in range(zones):
            at = slice(2 * z, 2 * z + 2)
            heart[at, at] = ridge(*(rng.uniform(*ends) for ends in ((0.05, 0.2), (0.4, 3.0))))
    return found


def measured(mean, sd, count: int, seed: int, zones: int = 2):
    """True log stiffness (H, P) of hearts of a population, and the centres (H, P) and covariances
    (H, P, P) of what is measured of each."""
    rng = np.random.default_rng(seed)
    truth = np.asarray(mean) + np.asarray(sd) * rng.standard_normal((count, 2 * zones))
    known = covariances(count, rng, zones)
    noise = np.linalg.cholesky(known) @ rng.standard_normal((count, 2 * zones, 1))
    return truth, truth + noise[..., 0], known


def likelihood(centre: np.ndarray, covariance: np.ndarray) -> NormalLikelihood:
    """Exactly."""
    precision = np.linalg.inv(covariance)
    return NormalLikelihood((precision @ centre[..., None])[..., 0], precision)


def posterior(centre, covariance, count: int, seed: int, lower=LOWER, upper=UPPER) -> np.ndarray:
    """Draws (count, P) of the stiffness of one heart, with a prior uniform within the range."""
    rng = np.random.default_rng(seed)
    low, high = np.log(lower), np.log(upper)
    # A uniform prior of the stiffness moves the centre of a normal likelihood of its logarithm.
    start, root = centre + covariance.sum(1), np.linalg.cholesky(covariance)
    precision = np.linalg.inv(covariance)
    # Coordinate by coordinate, between the ends: Gibbs' sampler of a truncated normal.
    spread = start + rng.standard_normal((count, len(start))) @ root.T
    chains = np.clip(spread, low + 1e-6, high - 1e-6)
    for _ in range(100):
        for k in range(len(start)):
            others = np.delete(np.arange(len(start)), k)
            sd = precision[k, k] ** -0.5
            gap = (chains[:, others] - start[others]) @ precision[k, others]
            middle = start[k] - gap / precision[k, k]
            first, last = ndtr((low - middle) / sd), ndtr((high - middle) / sd)
            inside = rng.uniform(first, np.maximum(last, first + 1e-12))
            chains[:, k] = np.clip(middle + sd * ndtri(inside), low + 1e-6, high - 1e-6)
    return np.exp(chains)
