"""Adaptive importance sampling of a posterior with many coordinates that are nearly normal."""

import pytest
import torch

from regional_lv.inference import importance

MANY, FEW = 34, 6
WIDTH = 0.9
"""Of the many, given the few."""


def log_density(u):
    """Normalised: the many follow the first of the few, which are as wide as a normal distribution
    but lean (skew normal)."""
    many, few = u[:, :MANY], u[:, MANY:]
    gap = (many - 0.1 * few[:, :1] - 0.05) / WIDTH
    normal = torch.distributions.Normal(0.0, 1.0)
    log_many = normal.log_prob(gap) - torch.tensor(WIDTH).log()
    log_few = normal.log_prob(few) + torch.special.log_ndtr(few) + torch.tensor(2.0).log()
    return log_many.sum(1) + log_few.sum(1)


def sampled(normal, seed):
    size = MANY + FEW - normal
    mean, covariance = torch.zeros(size).double(), torch.eye(size).double()
    generator = torch.Generator().manual_seed(seed)
    how = {"rounds": 4, "most_rounds": 8, "least_ess": 200.0, "largest_sd": 3.0}
    return importance.sample(
        log_density, mean, 1.2 * covariance, 1000, generator, normal=normal, **how
    )


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_many_coordinates_that_are_nearly_normal(seed):
    found = sampled(MANY, seed)
    assert found.ess >= 200 and len(found.u) <= 2000
    assert found.log_evidence == pytest.approx(0, abs=4 * found.evidence_error)
    mean = found.weight @ found.u
    skewed = (2 / torch.pi) ** 0.5 / 2**0.5
    expected = torch.cat([torch.full((MANY,), 0.1 * skewed + 0.05), torch.full((FEW,), skewed)])
    assert mean == pytest.approx(expected.numpy(), abs=4.5 / found.ess**0.5)


def test_fitted_together_they_leave_few_draws():
    together, apart = sampled(0, 1), sampled(MANY, 1)
    assert together.ess / len(together.u) < 0.25 * apart.ess / len(apart.u)
