"""Many maxima at once, by Levenberg (1944, doi 10.1090/qam/10666) and Marquardt's method within
bounds."""

from collections.abc import Callable

import torch

FIRST_DAMPING, LARGEST_DAMPING = 1e-2, 1e8
DAMPING_DECREASE, DAMPING_INCREASE = 5, 4
"""What damping is divided by after a step that gained, and multiplied by after another."""

LONGEST = 1.0
"""Of a step, in the coordinate that moves most: logarithms, mostly."""


def maximise(
    value: Callable[[torch.Tensor, torch.Tensor], torch.Tensor],
    derivatives: Callable[[torch.Tensor, torch.Tensor], tuple[torch.Tensor, torch.Tensor]],
    start: torch.Tensor,
    low: torch.Tensor,
    high: torch.Tensor,
    iterations: int,
    least_gain: float,
    least_move: float = 1e-10,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Climb from every row of `start` (M, P); the places (M, P), their values (M,), and the numbers
    of the rows that had iterations left to do.

    value: (rows, x) -> (m,) at x (m, P), the numbers of the rows being `rows` (m,).
    derivatives: (rows, x) -> gradient (m, P) and a curvature (m, P, P), positive semi-definite;
    asked once for each place that a row moves to, but for its last one if hardly anything was
    promised there. low, high: bounds (P,), or (M, P) of each row by itself. A row ends at a step
    that promises or gains less than `least_gain`, or is shorter than `least_move`.
    """
    lowest, highest = low.expand_as(start), high.expand_as(start)
    x = torch.minimum(torch.maximum(start, lowest), highest)
    active = torch.arange(len(x))
    best = value(active, x)
    gradient, curvature = derivatives(active, x)
    damping = torch.full((len(x),), FIRST_DAMPING, dtype=x.dtype)
    for _ in range(iterations):
        if not len(active):
            break
        here, g, h = x[active], gradient[active], curvature[active]
        low, high = lowest[active], highest[active]
        # At a bound and pushed outwards: the coordinate stays where it is.
        held = ((here <= low) & (g < 0)) | ((here >= high) & (g > 0))
        free = (~held).to(x.dtype)
        h = h * free[:, :, None] * free[:, None, :]
        diagonal = h.diagonal(dim1=-2, dim2=-1)
        extra = damping[active, None] * diagonal + 1e-8 * diagonal.amax(1, keepdim=True) + 1e-12
        step = torch.linalg.solve(h + torch.diag_embed(extra + (1 - free)), g * free)
        step = step * (LONGEST / step.abs().amax(1, keepdim=True)).clamp(max=1.0)
        trial = torch.minimum(torch.maximum(here + step, low), high)
        step = trial - here
        promised = ((g - 0.5 * (h @ step[..., None])[..., 0]) * step).sum(1)
        last = (promised < least_gain) & (damping[active] < 1.0)
        new = value(active, trial)
        better = new > best[active]
        gain = torch.where(better, new - best[active], 0.0)
        moved = step.abs().amax(1)
        rising = active[better]
        x[rising], best[rising] = trial[better], new[better]
        onwards = better & ~last
        if onwards.any():
            at = active[onwards]
            gradient[at], curvature[at] = derivatives(at, trial[onwards])
        damping[rising] = (damping[rising] / DAMPING_DECREASE).clamp(min=1e-9)
        damping[active[~better]] *= DAMPING_INCREASE
        ended = last | (better & (gain < least_gain) & (damping[active] < 1.0))
        ended = ended | (moved < least_move)
        active = active[~(ended | (damping[active] > LARGEST_DAMPING))]
    return x, best, active
