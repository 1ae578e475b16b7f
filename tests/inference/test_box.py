"""The map between the box and the space without bounds."""

import pytest
import torch

from regional_lv.inference.box import Box

LOWER, UPPER = 0.1, 5.0


def make(width: float) -> Box:
    """Of one parameter."""
    return Box(*(torch.tensor([value], dtype=torch.float64) for value in (LOWER, UPPER, width)))


@pytest.fixture(params=[0.01, 0.3, 10.0])
def box(request) -> Box:
    return make(request.param)


def places(box: Box) -> torch.Tensor:
    margin = 4 * float(box.width)
    ends = float(box.low) - margin, float(box.high) + margin
    return torch.linspace(*ends, 201, dtype=torch.float64)[:, None]


def test_jacobian_is_the_slope(box):
    v = places(box).requires_grad_()
    (slope,) = torch.autograd.grad(box.theta(v).sum(), v)
    torch.testing.assert_close(slope[:, 0].log(), box.log_jacobian(v).detach(), atol=1e-6, rtol=0)
    # In the root of theta, nowhere steeper than 1.
    assert (slope[:, 0] / box.theta(v)[:, 0].detach().sqrt() <= 1 + 1e-9).all()


def test_rises_within_the_bounds_and_back_again(box):
    v = places(box)
    theta = box.theta(v)
    assert (theta.diff(dim=0) > 0).all() and theta.min() >= LOWER and theta.max() <= UPPER
    inside = (v[:, 0] > box.low) & (v[:, 0] < box.high)
    torch.testing.assert_close(box.position(theta[inside]), v[inside], atol=1e-8, rtol=0)


def test_is_a_square_away_from_the_bounds():
    v = torch.linspace(-0.8, 1.2, 20, dtype=torch.float64)[:, None]
    torch.testing.assert_close(make(0.05).theta(v), (1 + v / 2).square())


def test_what_lies_on_a_bound_has_a_place(box):
    ends = torch.tensor([[LOWER], [UPPER]], dtype=torch.float64)
    assert torch.isfinite(box.position(ends)).all()
    torch.testing.assert_close(box.theta(box.position(ends)), ends, rtol=0.02, atol=0.0)


def test_every_parameter_has_its_own_bounds(box):
    """Side by side with another box, each coordinate is what it is alone."""
    other = Box(*(torch.tensor([v], dtype=torch.float64) for v in (0.5, 2.0, 0.1)))
    both = Box(
        *(torch.cat([getattr(b, k) for b in (box, other)]) for k in ("lower", "upper", "width"))
    )
    v = torch.cat([places(box), places(other)], dim=1)
    expected = torch.cat([box.theta(v[:, :1]), other.theta(v[:, 1:])], dim=1)
    torch.testing.assert_close(both.theta(v), expected)
    torch.testing.assert_close(
        both.log_jacobian(v), box.log_jacobian(v[:, :1]) + other.log_jacobian(v[:, 1:])
    )
    torch.testing.assert_close(both.position(expected)[100], v[100], atol=1e-8, rtol=0)
