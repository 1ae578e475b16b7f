"""Channels of one heart or several: what is left out together, and patterns of departures."""

import itertools
from collections.abc import Iterable, Mapping

import numpy as np
import torch

from regional_lv import aha
from regional_lv.channels import Channel, at_load
from regional_lv.inference.observed import Observed


def hearts_of(observed: Observed) -> list[slice]:
    """Channels of each heart."""
    ends = np.flatnonzero(np.diff(observed.heart, prepend=-1, append=-1))
    return [slice(first, last) for first, last in itertools.pairwise(ends.tolist())]


def groups_of(observed: Observed) -> list[torch.Tensor]:
    """Places of the channels that are left out together, heart by heart.

    A segment is a group with all its quantities and loads; so is a quantity without segments at one
    load, and the volume is one by itself.
    """
    groups: dict[tuple[int, str], list[int]] = {}
    for at, (heart, channel) in enumerate(zip(observed.heart, observed.channels, strict=True)):
        elsewhere = at_load(channel.quantity, channel.load_fraction)
        name = str(channel.segment) if channel.segment else elsewhere
        groups.setdefault((int(heart), name), []).append(at)
    return [torch.tensor(places) for places in groups.values()]


def contrasts(channels: Iterable[Channel]) -> dict[str, dict[str, torch.Tensor]]:
    """Families of structured departures: family -> name -> pattern (D,) of ones.

    Of quantities that segments have, at all loads and of all hearts together. Only patterns of at
    least two channels: one channel is a test of its own.
    """
    channels = list(channels)
    segments = np.array([channel.segment or 0 for channel in channels])
    quantities = np.array([channel.quantity for channel in channels])
    segmental = list(dict.fromkeys(quantities[segments > 0].tolist()))
    families: dict[str, Mapping[str, Iterable[int]]] = {
        "direction": {"": [segment.number for segment in aha.SEGMENTS]},
        "level": aha.LEVELS,
        "wall": aha.WALLS,
    }
    found: dict[str, dict[str, torch.Tensor]] = {}
    for family, places in families.items():
        for place, numbers in places.items():
            for quantity in segmental:
                mask = np.isin(segments, list(numbers)) & (quantities == quantity)
                if mask.sum() >= 2:
                    name = f"{place} {quantity}".strip()
                    found.setdefault(family, {})[name] = torch.as_tensor(mask).double()
    return found
