"""Whether a cause could be seen in the data at all, and which parameters absorb it if not."""

import math
from dataclasses import dataclass

import numpy as np
import torch

from regional_lv.criticism.linear_model import LinearFit, LinearModel
from regional_lv.inputs.closed_forms import HeavyTails
from regional_lv.inputs.stiffness import Stiffness

LARGEST_SHARE = 0.8
"""Identifiable: the data alone would know the input to less than this share of its prior sd."""

WEAK_PRIOR = 0.01
"""Share of the precision of a uniform prior that parameters keep: what they take up of an effect,
the prior must not give back."""

ABSORBED = 0.98
"""Share of an effect's information beyond which the parameters take it up as a whole, if what they
leave does not tell of the input (`LARGEST_SHARE`)."""

LIKE = 0.9
"""Correlation of two effects from which one is said to act like the other."""

FEWEST_FOR_TAILS = 20
"""Number of channels below which the tails of the noise are not tested."""


@dataclass(frozen=True)
class Identified:
    """identifiable; sd (in its unit) to which the data would know the input, near its nominal
    value; absorbed: share of its effect's information that the parameters take up; why: in words.
    """

    identifiable: bool
    sd: float
    absorbed: float
    why: str


def absorbed_inputs(linear: LinearModel) -> list[int]:
    """Places of the suspected inputs whose effect the parameters take up as a whole: no measurement
    tells of them, and a model in which one is free is as good as that without it."""
    here = linear.fit(linear.y[None])
    found = {k: identify(linear, here, k) for k in linear.doubted}
    return [k for k, one in found.items() if not one.identifiable and one.absorbed > ABSORBED]


def identify(linear: LinearModel, found: LinearFit, at: int) -> Identified:
    """Judge the suspected input at place `at` by its effect at a fit (M = 1)."""
    one = linear.inputs[at]
    if isinstance(one, HeavyTails):
        return _identify_tails(linear)
    signature = linear.by_input[:, at, None]
    if not bool(signature.any()):
        return Identified(False, math.inf, 0.0, "it changes none of the channels observed")
    whole, information = float(found.whole(signature)), _information(linear, found, signature)
    absorbed = 1 - information / whole
    sd = 1 / math.sqrt(information) if information > 0 else math.inf
    prior = float(linear.width[at]) / math.sqrt(12)
    slope = one.scale.slope(one.scale.inverse(float(linear.x[at])))
    unit = "" if one.unit == "1" else f" {one.unit}"
    if sd < LARGEST_SHARE * prior:
        why = (
            f"the stiffness can absorb {100 * absorbed:.0f} % of its effect's information; the "
            f"rest determines it to {slope * sd:.2g}{unit}"
        )
        return Identified(True, slope * sd, absorbed, why)
    if absorbed > ABSORBED:
        why = f"the stiffness absorbs {100 * absorbed:.1f} % of its effect"
        where, likeness = _most_similar(linear, found, signature)
        if likeness > LIKE:
            why += f": it acts like a change of {where} (correlation {likeness:.3f})"
        why += ", so that the data cannot tell the two apart"
    else:
        why = (
            f"the data would leave {slope * sd:.2g}{unit} of uncertainty, the plausible range "
            f"itself has an sd of {slope * prior:.2g}"
        )
    return Identified(False, slope * sd, absorbed, why)


def _identify_tails(linear: LinearModel) -> Identified:
    if len(linear.y) < FEWEST_FOR_TAILS:
        why = "too few channels to see tails of noise"
        return Identified(False, math.nan, math.nan, why)
    why = "the stiffness cannot imitate the distribution of noise"
    return Identified(True, math.nan, 0.0, why)


def _information(linear: LinearModel, found: LinearFit, signature: torch.Tensor) -> float:
    """What all parameters leave, whether or not the fit holds them at an end of their range."""
    taken, known = (found.reduced[0] @ columns for columns in (signature, linear.slopes))
    known = known + 12 * WEAK_PRIOR * torch.eye(len(taken)).to(taken)
    return float(found.whole(signature) - taken.mT @ torch.linalg.solve(known, taken))


def _most_similar(
    linear: LinearModel, found: LinearFit, signature: torch.Tensor
) -> tuple[str, float]:
    """The parameter, or one factor of the material in all zones together, whose effect is most like
    a signature (D, 1), and their correlation."""
    places = dict(zip(linear.names, linear.slopes.T, strict=True))
    parameters = [one for one, free in zip(linear.inputs, linear.free, strict=True) if free]
    factors = [one.words[-1] if isinstance(one, Stiffness) else "" for one in parameters]
    for factor in dict.fromkeys(factors):
        own = np.flatnonzero([factor == each for each in factors])
        if factor and len(own) > 1:
            places[f"{factor} of all zones together"] = linear.slopes[:, own].sum(1)
    columns = torch.stack([*places.values()], dim=-1)
    product = (signature.mT @ found.precision[0] @ columns)[0].abs()
    size = (found.whole(signature) * found.whole(columns))[0].clamp(min=1e-300).sqrt()
    most, at = (product / size).max(0)
    return [*places][int(at)], float(most)
