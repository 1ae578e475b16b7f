"""Many maxima at once, by Levenberg (1944, doi 10.1090/qam/10666) and Marquardt's method within
bounds."""

from collections.abc import Callable

import torch

FIRST_DAMPING, LARGEST_DAMPING = 1e-2, 1e8
DAMPING_DECREASE, DAMPING_INCREASE = 5, 4
"""What damping is divided by after a step that gained, and multiplied by after another."""

LONGEST = 1.0
"""Of a step, in the coordinate that moves most: logarithms, mostly."""

LEAST_MOVE = 1e-10
"""Below which no coordinate moves any more."""


def maximise(
    value: Callable[[torch.Tensor, torch.Tensor], torch.Tensor],
    derivatives: Callable[[torch.Tensor, torch.Tensor], tuple[torch.Tensor, torch.Tensor]],
    start: torch.Tensor,
    low: torch.Tensor,
    high: torch.Tensor,
    iterations: int,
    least_gain: float,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Climb from every row of `start` (M, P); the places (M, P), their values (M,), and the numbers
    of the rows that had iterations left to do.

    value: (rows, x) -> (m,) at x (m, P), the numbers of the rows being `rows` (m,).
    derivatives: (rows, x) -> gradient (m, P) and a curvature (m, P, P), positive semi-definite;
    asked once for each place that a row moves to, but for its last one if hardly anything was
    promised there. low, high: bounds (P,), or (M, P) of each row by itself. A row ends at a step
    that promises or gains less than `least_gain`, or is shorter than `LEAST_MOVE`.
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
        step, cut = _within(h, g * free, extra, free, low - here, high - here)
        # To the last digit, or it would be cut for ever.
        trial = torch.where(step <= low - here, low, here + step)
        trial = torch.where(step >= high - here, high, trial)
        promised = ((g - 0.5 * (h @ step[..., None])[..., 0]) * step).sum(1)
        # A step that was cut says nothing of what is still to be gained.
        last = (promised < least_gain) & ~cut & (damping[active] < 1.0)
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
        ended = last | (better & ~cut & (gain < least_gain) & (damping[active] < 1.0))
        ended = ended | ((moved < LEAST_MOVE) & ~cut)
        active = active[~(ended | (damping[active] > LARGEST_DAMPING))]
    return x, best, active


def _within(
    curvature: torch.Tensor,
    gradient: torch.Tensor,
    extra: torch.Tensor,
    free: torch.Tensor,
    low: torch.Tensor,
    high: torch.Tensor,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Steps (m, P) between `low` and `high`, and mask (m,) of those that an end cut.

    A coordinate that would leave its range goes to the end, and the others are solved for given
    that: cutting it off alone leaves a step that may lead downhill where coordinates go together.
    extra (m, P): added to the diagonal. free (m, P): 1 where a coordinate moves, else 0.
    """
    step = torch.zeros_like(gradient)
    cut = torch.zeros(len(step), dtype=torch.bool)
    rows, free = torch.arange(len(step)), free.clone()
    while len(rows):
        moving, held = free[rows], step[rows] * (1 - free[rows])
        h = curvature[rows]
        rest = (gradient[rows] - (h @ held[..., None])[..., 0]) * moving
        h = h * moving[:, :, None] * moving[:, None, :]
        own = torch.linalg.solve(h + torch.diag_embed(extra[rows] * moving + (1 - moving)), rest)
        own = own * (LONGEST / own.abs().amax(1, keepdim=True)).clamp(max=1.0) + held
        step[rows] = torch.minimum(torch.maximum(own, low[rows]), high[rows])
        outside = (moving > 0) & (step[rows] != own)
        free[rows] = moving * ~outside
        rows = rows[outside.any(1)]
        cut[rows] = True
    return step, cut
