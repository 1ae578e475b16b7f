"""Whether a cause could be seen in the data at all, and which factors absorb it if not."""

import math
from dataclasses import dataclass

import torch

from regional_lv.criticism.fit import Fit
from regional_lv.criticism.model import Model
from regional_lv.criticism.score import Projected, pattern_of

LARGEST_SHARE = 0.8
"""Identifiable: the data alone would know psi to less than this share of its prior sd."""

FREE = 0.01
"""Factor on the weak prior of theta: what theta takes up, the prior must not give back."""

ABSORBED = 0.98
"""Share of the signature's information beyond which theta takes it up as a whole."""


@dataclass(frozen=True)
class Identified:
    """identifiable; sd of psi that the data allow, near its base value; absorbed: share of the
    signature's information that the parameters take up; why: a sentence.

    relevant: its range is wide enough to change the data by a standard error. What is identifiable
    is relevant, too. Of what is only relevant the data say little, but it may be there, and may be
    what another cause would stand in for."""

    identifiable: bool
    sd: float
    absorbed: float
    why: str
    relevant: bool = False


def identify(model: Model, best: Fit, extension) -> Identified:
    """Judge an extension by its signature at the fit (M = 1)."""
    h, projected = extension.hypothesis, Projected.of(best, model, FREE)
    pattern = pattern_of(model, extension, best.x)
    information = float(projected.information(pattern))
    absorbed = float(projected.absorbed(pattern))
    sd = 1 / math.sqrt(information) if information > 0 else math.inf
    prior = (h.scale(h.high) - h.scale(h.low)) / math.sqrt(12)
    reach = max(abs(h.scale(end) - h.scale(h.base)) for end in (h.low, h.high))
    unit = h.scale.slope(h.base)  # of psi about its scale
    if not float(pattern.abs().max()) > 0:
        return Identified(False, math.inf, 0.0, "it changes none of the channels observed")
    if sd < LARGEST_SHARE * prior:
        why = (
            f"theta can absorb {100 * absorbed:.0f} % of its signature's information; the rest "
            f"determines it to {unit * sd:.2g}{_unit(h)}"
        )
        return Identified(True, unit * sd, absorbed, why, True)
    where, likeness = _hiding_place(model, best, pattern[0])
    if absorbed > ABSORBED:
        why = f"theta absorbs {100 * absorbed:.1f} % of its signature"
        if likeness > 0.9:
            why += f": it acts like a change of {where} (correlation {likeness:.3f})"
        why += ", so that the data cannot tell the two apart"
    else:
        why = (
            f"the data would leave {unit * sd:.2g}{_unit(h)} of uncertainty, the plausible range "
            f"itself has an sd of {unit * prior:.2g}"
        )
    return Identified(False, unit * sd, absorbed, why, reach > sd)


def _unit(hypothesis) -> str:
    """As it follows a number."""
    return "" if hypothesis.unit == "1" else f" {hypothesis.unit}"


def _hiding_place(model: Model, best: Fit, pattern: torch.Tensor) -> tuple[str, float]:
    """The parameter, or one factor of all zones together, whose effect on the outputs is
    most like `pattern` (n, 1), and the correlation."""
    slopes = (best.whitening[0] @ best.jacobian[0]).flatten(0, 1)
    s, d = best.residual.shape[1:]
    target = (best.whitening[0] @ pattern.reshape(s, d, 1)).flatten()
    names = model.names[: slopes.shape[1]]
    places = {name: slopes[:, i] for i, name in enumerate(names)}
    parameters = model.layout.parameters
    for factor in parameters.factors:
        own = {p.name for p in parameters if p.factor == factor}
        # Of several hearts, a parameter's name comes behind its heart's.
        at = [i for i, name in enumerate(names) if name.rpartition(": ")[2] in own]
        if len(at) > 1:
            places[f"{factor} of all zones together"] = slopes[:, at].sum(1)
    likeness = {
        name: float((target @ column).abs() / (target.norm() * column.norm()).clamp(min=1e-300))
        for name, column in places.items()
    }
    return max(likeness.items(), key=lambda item: item[1])
