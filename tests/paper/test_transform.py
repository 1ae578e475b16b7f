"""The map between the transform and the space without bounds."""

import pytest
import torch

from regional_lv.paper.sampler.transform import ThetaTransform

LOWER, UPPER = 0.1, 5.0


def make(width: float) -> ThetaTransform:
    """Of one parameter."""
    values = (LOWER, UPPER, width)
    return ThetaTransform(*(torch.tensor([v], dtype=torch.float64) for v in values))


@pytest.fixture(params=[0.01, 0.3, 10.0])
def transform(request) -> ThetaTransform:
    return make(request.param)


def places(transform: ThetaTransform) -> torch.Tensor:
    margin = 4 * float(transform.bounded.width)
    ends = float(transform.bounded.low) - margin, float(transform.bounded.high) + margin
    return torch.linspace(*ends, 201, dtype=torch.float64)[:, None]


def test_jacobian_is_the_slope(transform):
    v = places(transform).requires_grad_()
    (slope,) = torch.autograd.grad(transform.constrain(v).sum(), v)
    reported = transform.constrain_with_log_det(v)[1].detach()
    torch.testing.assert_close(slope[:, 0].log(), reported, atol=1e-6, rtol=0)
    # In the root of theta, nowhere steeper than 1.
    assert (slope[:, 0] / transform.constrain(v)[:, 0].detach().sqrt() <= 1 + 1e-9).all()


def test_rises_within_the_bounds_and_back_again(transform):
    v = places(transform)
    theta = transform.constrain(v)
    assert (theta.diff(dim=0) > 0).all() and theta.min() >= LOWER and theta.max() <= UPPER
    inside = (v[:, 0] > transform.bounded.low) & (v[:, 0] < transform.bounded.high)
    torch.testing.assert_close(transform.unconstrain(theta[inside]), v[inside], atol=1e-8, rtol=0)


def test_is_a_square_away_from_the_bounds():
    v = torch.linspace(-0.8, 1.2, 20, dtype=torch.float64)[:, None]
    torch.testing.assert_close(make(0.05).constrain(v), (1 + v / 2).square())


def test_what_lies_on_a_bound_has_a_place(transform):
    ends = torch.tensor([[LOWER], [UPPER]], dtype=torch.float64)
    assert torch.isfinite(transform.unconstrain(ends)).all()
    torch.testing.assert_close(
        transform.constrain(transform.unconstrain(ends)), ends, rtol=0.02, atol=0.0
    )


def test_every_parameter_has_its_own_bounds(transform):
    """Side by side with another transform, each coordinate is what it is alone."""
    other = ThetaTransform(*(torch.tensor([v], dtype=torch.float64) for v in (0.5, 2.0, 0.1)))
    both = ThetaTransform(
        torch.cat([transform.lower, other.lower]),
        torch.cat([transform.upper, other.upper]),
        torch.cat([transform.bounded.width, other.bounded.width]),
    )
    v = torch.cat([places(transform), places(other)], dim=1)
    expected = torch.cat([transform.constrain(v[:, :1]), other.constrain(v[:, 1:])], dim=1)
    torch.testing.assert_close(both.constrain(v), expected)
    torch.testing.assert_close(
        both.constrain_with_log_det(v)[1],
        transform.constrain_with_log_det(v[:, :1])[1] + other.constrain_with_log_det(v[:, 1:])[1],
    )
    torch.testing.assert_close(both.unconstrain(expected)[100], v[100], atol=1e-8, rtol=0)
