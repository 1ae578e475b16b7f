"""Adaptive importance sampling of a posterior with many coordinates that are nearly normal."""

import math

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
    assert found.ess >= 150 and len(found.u) <= 2000
    assert found.log_evidence == pytest.approx(0, abs=4 * found.evidence_error)
    mean = found.weight @ found.u
    skewed = (2 / torch.pi) ** 0.5 / 2**0.5
    expected = torch.cat([torch.full((MANY,), 0.1 * skewed + 0.05), torch.full((FEW,), skewed)])
    assert mean == pytest.approx(expected.numpy(), abs=4.5 / found.ess**0.5)


def test_fitted_together_they_leave_few_draws():
    together, apart = sampled(0, 1), sampled(MANY, 1)
    assert together.ess / len(together.u) < 0.25 * apart.ess / len(apart.u)


def sample_skewed(log_density, draws, seed):
    """Of 12 coordinates, none of which is proposed as normal."""
    mean, covariance = torch.zeros(12).double(), 1.2 * torch.eye(12).double()
    generator = torch.Generator().manual_seed(seed)
    how = {"rounds": 4, "most_rounds": 8, "least_ess": 0.2 * draws, "largest_sd": 3.0}
    return importance.sample(log_density, mean, covariance, draws, generator, **how)


def test_evidence_does_not_depend_on_the_number_of_draws():
    """Draws that proposals were fitted to would say 0.5 less (log) of a density that integrates
    to one."""
    normal = torch.distributions.Normal(torch.zeros(()).double(), 1.0)

    def skewed(u):
        return (normal.log_prob(u) + torch.special.log_ndtr(3 * u) + math.log(2)).sum(1)

    found = [sample_skewed(skewed, 200, seed) for seed in range(20)]
    logs = torch.tensor([each.log_evidence for each in found])
    assert float(logs.mean()) == pytest.approx(0.0, abs=4 * float(logs.std()) / 20**0.5)
    assert all(len(each.u) <= importance.KEPT_ROUNDS * 200 for each in found)


def test_lost_draws_are_not_certain():
    lost = sample_skewed(lambda u: torch.full((len(u),), -math.inf).double(), 50, 1)
    assert lost.is_lost and lost.ess == 0 and not lost.has_light_tail
    assert lost.log_evidence == -math.inf and lost.evidence_error == math.inf
    normal = torch.distributions.Normal(torch.zeros(()).double(), 1.0)

    def half(u):
        return torch.where(u[:, 0] > 0, normal.log_prob(u).sum(1), -math.inf)

    found = sample_skewed(half, 500, 1)
    assert found.log_evidence == pytest.approx(math.log(0.5), abs=4 * found.evidence_error)
    assert (found.u[found.weight > 0, 0] > 0).all()
