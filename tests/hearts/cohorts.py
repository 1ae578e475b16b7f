"""Cohorts whose population is known: what the data of hearts say, and draws of their posteriors."""

import numpy as np

from regional_lv.hearts.likelihoods import NormalLikelihood

LOWER, UPPER = 0.1, 5.0
GRID = 300


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
    """Draws (count, P) of the stiffness of one heart, with a prior uniform within the range; zone
    by zone, off a grid."""
    rng = np.random.default_rng(seed)
    edges = np.linspace(np.log(lower), np.log(upper), GRID + 1)
    middle, width = (edges[1:] + edges[:-1]) / 2, edges[1] - edges[0]
    cells = np.stack(np.meshgrid(middle, middle, indexing="ij"), axis=-1).reshape(-1, 2)
    draws = np.empty((count, len(centre)))
    for z in range(0, len(centre), 2):
        zone = slice(z, z + 2)
        away = cells - centre[zone]
        square = np.einsum("np,pq,nq->n", away, np.linalg.inv(covariance[zone, zone]), away)
        # A uniform prior of the stiffness rises with its logarithm.
        log_density = cells.sum(1) - square / 2
        weight = np.cumsum(np.exp(log_density - log_density.max()))
        chosen = np.searchsorted(weight, weight[-1] * rng.uniform(size=count))
        draws[:, zone] = cells[chosen] + width * rng.uniform(-0.5, 0.5, (count, 2))
    return np.exp(draws)
