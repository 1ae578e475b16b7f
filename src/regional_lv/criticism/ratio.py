"""Likelihood-ratio tests of causes where the noise is inferred, calibrated by bootstrap.

A score test asks for a first step away from the fitted model. Where the noise is inferred it has
grown until that model fits, and a cause whose effect bends, or is large, shows only when it is
fitted jointly: theta and a smaller noise are estimated again in every replicate.
"""

import torch

from regional_lv.criticism.fit import Fit, fit
from regional_lv.criticism.model import Model
from regional_lv.criticism.score import Projected, cause_score, replicates_of, share_beyond
from regional_lv.progress import Progress

REPLICATES = 199
"""Data sets that every cause is fitted to; the smallest p-value is one over one more than this."""

STARTS = (0.25, 0.75)
"""Shares of a parameter's range that fits start from, besides its base value."""

ITERATIONS = 30


def likelihood_ratios(model: Model, best: Fit, extensions, seed: int) -> dict[str, float]:
    """Family-wise p-value of every hypothesis among `extensions`, by name.

    best: fit of `model` to its observations. The statistic is twice the gain of the objective of
    `fit`; of a hypothesis with several places, in the one with the largest score. Data and
    replicates are treated alike: whatever the fits miss, they miss in both.
    """
    y = torch.cat([model.observations.y[None], replicates_of(model, best, REPLICATES, seed)])
    base = fit(model, y, best.x.repeat(len(y), 1))
    projected = Projected.of(base, model)
    names = list(dict.fromkeys(e.hypothesis.name for e in extensions))
    progress = Progress("likelihood ratios", len(names))
    ratios = []
    for name in names:
        places = [e for e in extensions if e.hypothesis.name == name]
        scores = torch.stack([cause_score(model, projected, base.x, e) for e in places], -1)
        lead = scores.abs().argmax(-1)
        ratio = torch.zeros(len(y), dtype=y.dtype)
        for i, extension in enumerate(places):
            rows = torch.nonzero(lead == i)[:, 0]
            if len(rows):
                gain = _objective(model, extension, y[rows], base.x[rows]) - base.objective[rows]
                ratio[rows] = 2 * gain.clamp(min=0.0)
        ratios.append(ratio)
        progress.step()
    largest = torch.stack(ratios).amax(0)[1:]
    return {
        name: share_beyond(float(ratio[0]), largest)
        for name, ratio in zip(names, ratios, strict=True)
    }


def _objective(model: Model, extension, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """Best objective (M,) of the model with one more extension, fitted to rows of y (M, S, D) from
    where the fits without it ended, x (M, P)."""
    extended = Model(
        model.observations, model.emulator.with_extensions(extension), model.layout, model.tails
    )
    # Nested: the emulator's own error is that of the model without the extension.
    extended.error = model.error
    at, h = model.psi.stop, extension.hypothesis
    low, high, found = float(extended.low[at]), float(extended.high[at]), []
    for start in (h.scale(h.base), *(low + share * (high - low) for share in STARTS)):
        psi = torch.full((len(x), 1), float(start), dtype=x.dtype)
        begin = torch.cat([x[:, :at], psi, x[:, at:]], dim=1)
        found.append(fit(extended, y, begin, iterations=ITERATIONS).objective)
    return torch.stack(found).amax(0)
