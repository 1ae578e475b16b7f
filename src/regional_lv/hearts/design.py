"""Where to simulate for an emulator of any heart: all inputs, on ventricles of all kinds."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.aha import LEVELS
from regional_lv.hearts import population
from regional_lv.inputs.space import Inputs
from regional_lv.inputs.stiffness import Stiffness
from regional_lv.seeds import derive
from regional_lv.simulation.design import draw_table, write_rows


def draw_hearts(inputs: Inputs, n: int, seed: int) -> pd.DataFrame:
    """Values of the inputs, a column each, with shapes from `population.draw`; the column
    `population.HEART` says what kind of ventricle a row is.

    The stress of a wall goes with its radius over its thickness (Laplace). Where that is larger
    than in the study's own heart, factors that scale stresses are drawn from as many times their
    lowest value on: a thinner wall of the softest muscle would be blown up.
    """
    geometry = inputs.base["geometry"]
    shapes = population.draw(
        geometry["table"], geometry["length_mm"], n, derive(seed, "design", "shapes")
    )
    mid = [s - 1 for s in LEVELS["mid"]]
    thickness, radius = (shapes[names].to_numpy() for names in population.SHAPE.values())
    ratio = radius[:, mid].mean(axis=1) / thickness[:, mid].mean(axis=1)
    of_thickness, of_radius = (geometry[column][mid].mean() for column in population.SHAPE)
    wider = np.maximum(1.0, ratio * of_thickness / of_radius)
    values = draw_table(inputs, n, seed).assign(**shapes)
    for each in inputs:
        if isinstance(each, Stiffness) and each.stress_power:
            share = np.log(values[each.name] / each.low) / np.log(each.high / each.low)
            values[each.name] *= wider ** (1 - share)
    return values


def write_population_design(
    physics: Mapping, set: str, size: int, seed: int, design: str | Path
) -> None:
    """`simulation.design.write_rows` for ventricles of all kinds."""
    write_rows(physics, set, size, seed, draw_hearts, design)
