"""Where to simulate for an emulator of any heart: all inputs, on ventricles of all kinds."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from regional_lv.hearts import population
from regional_lv.inputs.space import Inputs
from regional_lv.seeds import derive
from regional_lv.simulation.design import draw_table, write_sets


def draw_hearts(inputs: Inputs, n: int, seed: int) -> pd.DataFrame:
    """Values of the inputs, a column each, with shapes from `population.draw`; the column
    `population.HEART` says what kind of ventricle a row is."""
    geometry = inputs.base["geometry"]
    shapes = population.draw(
        geometry["table"], geometry["length_mm"], n, derive(seed, "design", "shapes")
    )
    return draw_table(inputs, n, seed).assign(**shapes)


def write_design(
    physics: Mapping, sizes: Mapping[str, int], seed: int, train: str | Path, test: str | Path
) -> None:
    """`simulation.design.write_sets` for ventricles of all kinds."""
    write_sets(physics, sizes, seed, draw_hearts, train, test)
