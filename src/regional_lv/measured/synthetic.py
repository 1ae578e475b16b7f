"""Measured tables of synthetic subjects."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from regional_lv.channels import Channels
from regional_lv.measured.tables import make_table


def synthetic_subject(
    outputs: np.ndarray, channels: Channels, noise: Mapping, unit_noise: np.ndarray
) -> pd.DataFrame:
    """Measured table of a simulated ventricle: `outputs` plus noise.

    outputs: (D,) of the `channels`; noise: its scales, by the quantities' `noise`, in their units,
    which also become the `sd` of the table; what has no scale is not measured. unit_noise: (D,) of
    unit scale.
    """
    sd = np.array([noise.get(channel.kind.noise) for channel in channels], dtype=float)
    table = make_table(channels, np.asarray(outputs) + sd * unit_noise)
    table["sd"] = sd
    table["source"] = "synthetic"
    return table[table["sd"].notna()].reset_index(drop=True)


def unit_noise(tails: float, size: int, rng: np.random.Generator) -> np.ndarray:
    """Noise (size,) of unit scale: Gaussian, or Student's t with 1 / `tails` degrees of freedom."""
    return rng.standard_t(1 / tails, size) if tails else rng.standard_normal(size)
