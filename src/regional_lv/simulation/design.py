"""Where to simulate: a Sobol sequence over all inputs of a study that are not fixed."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.inputs.base import Input
from regional_lv.inputs.space import Inputs
from regional_lv.seeds import derive
from regional_lv.simulation.sobol import sobol

MOST_ON, FEW = 0.8, 5
"""Between no suspected input and this share of them, or a few if that is less, are on at a time:
hearts with more are not looked for, and many do not converge."""

MOST_OF_A_KIND = 2
"""Suspected inputs of one kind that every segment has (scars) which are on at a time."""

REACH = 2.5
"""Standard deviations to either side, over which a measured input is simulated."""


def draw_inputs(inputs: Inputs, n: int, seed: int) -> np.ndarray:
    """Values (n, K) of the inputs.

    Inferred inputs are spread over their ranges, measured ones over `REACH` standard deviations to
    either side within theirs, both evenly on their scales. Suspected ones are at their nominal
    value in most simulations and else spread over their ranges: how many are on differs, from none
    to the mean of the fullest simulations (`MOST_ON`, `FEW`). Of a kind that every segment has at
    most `MOST_OF_A_KIND` are on.
    """
    groups = _groups(inputs)
    dimensions = 1 + sum(map(_dimensions, groups))
    points = sobol(n, np.zeros(dimensions), np.ones(dimensions), "natural", seed)
    values = np.tile(inputs.nominal, (n, 1))
    suspected = sum(inputs.roles[group[0]].kind == "suspected" for group in groups)
    off, first = 1 - min(MOST_ON, FEW / max(suspected, 1)) * points[:, 0], 1
    for group in groups:
        width = _dimensions(group)
        _put(values, inputs, group, points[:, first : first + width], off)
        first += width
    return values


def _groups(inputs: Inputs) -> list[list[int]]:
    """Places of the inputs, suspected ones of one kind together."""
    groups: dict[object, list[int]] = {}
    for k, (each, role) in enumerate(zip(inputs, inputs.roles, strict=True)):
        key = type(each) if role.kind == "suspected" else k
        groups.setdefault(key, []).append(k)
    return list(groups.values())


def _dimensions(group: list[int]) -> int:
    """Of the sequence: 1 for a single input, whose number says whether it is on and its value; 2
    for each member of a kind that can be on, which one it is (if any) and its value."""
    return 1 if len(group) == 1 else 2 * min(MOST_OF_A_KIND, len(group))


def _put(
    values: np.ndarray, inputs: Inputs, group: list[int], u: np.ndarray, off: np.ndarray
) -> None:
    """Fill in the columns of a group from uniform numbers u (n, dimensions); suspected inputs are
    at their nominal value with a probability `off` (n,)."""
    k = group[0]
    if inputs.roles[k].kind != "suspected":
        low, high = _range(inputs, k)
        values[:, k] = _between(inputs[k], low, high, u[:, 0])
    elif len(group) == 1:
        on = u[:, 0] >= off
        share = (u[on, 0] - off[on]) / (1 - off[on])
        values[on, k] = _between(inputs[k], inputs[k].low, inputs[k].high, share)
    else:
        for slot in range(u.shape[1] // 2):
            which, share = u[:, 2 * slot], u[:, 2 * slot + 1]
            chosen = np.floor((which - off) / np.maximum(1 - off, 1e-12) * len(group))
            for place, k in enumerate(group):
                on = (which >= off) & (chosen == place)
                values[on, k] = _between(inputs[k], inputs[k].low, inputs[k].high, share[on])


def _between(each: Input, low: float, high: float, share: np.ndarray) -> np.ndarray:
    """Values at a share (n,) of the way between two, on the scale."""
    start, end = each.scale(float(low)), each.scale(float(high))
    return np.array([each.scale.inverse(float(start + s * (end - start))) for s in share])


def _range(inputs: Inputs, k: int) -> tuple[float, float]:
    """Ends of what is simulated of an input that is not suspected."""
    each, at, sd = inputs[k], inputs.nominal[k], inputs.roles[k].sd
    if sd is None:
        return each.low, each.high
    return max(each.low, at - REACH * sd), min(each.high, at + REACH * sd)


Draw = Callable[[Inputs, int, int], pd.DataFrame]
"""Values of the inputs, a column each, of so many simulations, from a seed; the first rows of a
longer table are the same."""


def write_rows(
    physics: Mapping, set: str, size: int, seed: int, draw: Draw, design: str | Path
) -> None:
    """Write the first rows of a set (Parquet), `size` of them: `sample`, `scale`, and what is drawn
    of the inputs that are simulated.

    physics: what `inputs.space.sections_of` gives. seed: the study's.
    """
    inputs = Inputs.from_config(physics).simulated
    table = draw(inputs, size, derive(seed, "design", "inputs", set))
    table.insert(0, "scale", "log")
    table.insert(0, "sample", np.arange(size))
    table.to_parquet(design, index=False)


def draw_table(inputs: Inputs, n: int, seed: int) -> pd.DataFrame:
    """`draw_inputs`, a column each."""
    return pd.DataFrame(draw_inputs(inputs, n, seed), columns=list(inputs.names))


def write_inputs_design(
    physics: Mapping, set: str, size: int, seed: int, design: str | Path
) -> None:
    """`write_rows` for the study's heart."""
    write_rows(physics, set, size, seed, draw_table, design)
