"""A smooth departure of unknown shape from what any set of causes makes.

In equal parts common to a quantity, to its levels, to its walls, and each channel's own (Kennedy
and O'Hagan 2001, doi 10.1111/1467-9868.00294).
"""

import numpy as np
import torch

from regional_lv import aha
from regional_lv.channels import Channels

REACHED = {"strain": 0.01, "volume": 1.0, "torsion": 0.01, "shortening": 0.005}
"""Noise that good tagged MRI reaches, by a quantity's `noise` and in its unit."""

SHARE_OF_SPREAD = 0.1
"""The same for other quantities: this share of their spread over the design."""


def noise_units(channels: Channels, spread: np.ndarray) -> np.ndarray:
    """What differences of the channels are counted in, (D,): a good measurement's noise.

    spread: (D,) sd of the channels over the design.
    """
    return np.array(
        [
            REACHED.get(channel.kind.noise, SHARE_OF_SPREAD * sd)
            for channel, sd in zip(channels, spread, strict=True)
        ]
    )


def departure_covariance(channels: Channels, spread: np.ndarray) -> torch.Tensor:
    """(D, D) covariance of all channels at an amplitude of one: each channel's sd is its
    `noise_units`.

    spread: (D,) sd of the channels over the design.
    """
    unit = noise_units(channels, spread)
    quantity = np.array([channel.quantity for channel in channels])
    load = np.array([channel.load_fraction for channel in channels])
    same = (quantity[:, None] == quantity) & (load[:, None] == load)
    segments = np.array([channel.segment or 0 for channel in channels])
    level, wall = (
        np.array([next((k for k, members in places.items() if s in members), "") for s in segments])
        for places in (aha.LEVELS, aha.WALLS)
    )
    pattern = same + np.eye(len(unit))
    for place in (level, wall):
        pattern = pattern + (same & (place[:, None] == place) & (place != ""))
    # A volume has no level, an apex no wall: each channel's own sd is the amplitude nevertheless.
    unit = unit / np.sqrt(pattern.diagonal())
    return torch.as_tensor(pattern * unit[:, None] * unit)
