"""Which measurement would tell causes apart that explain the data equally well."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import torch

from regional_lv.channels import Channels
from regional_lv.inference.averaging import Averaged
from regional_lv.inference.departure import noise_units
from regional_lv.inference.emulated import EmulatedInputs

MENTIONED = 3
"""Channels of a pair."""


def separating_measurement(
    averaged: Averaged,
    rivals: Sequence[int],
    emulated: EmulatedInputs,
    load_fractions: Sequence[float] = (),
) -> list[dict]:
    """For every pair of `rivals` (numbers of models): the channels, measured or not, in which their
    predictions differ most, in units of a good measurement's noise (`noise_units`).

    Each rival predicts at its own best fit to the same data, so that only what is left open shows.
    emulated: of all that the study observes. load_fractions: shares of the end-diastolic pressure
    at which the heart could be imaged. Stresses scale, so that the emulator answers for them at
    another stiffness; a fraction at which it would have to extrapolate is left out, and so are
    channels that the study observes at lower loads anyway.
    """
    emulator, inputs = emulated.emulator, averaged.potential.inputs
    unit = torch.as_tensor(noise_units(emulator.channels, emulator.output_sd.numpy()))
    powers = torch.tensor([float(each.stress_power) for each in inputs])
    inferred = torch.as_tensor(inputs.of_role("inferred"))
    upper = torch.as_tensor(inputs.upper)
    predictions: dict[int, dict[float, torch.Tensor]] = {}
    for n in rivals:
        fitted = averaged.models[n].fit
        if fitted is None:
            continue
        values = inputs.coordinates.natural(fitted.x[:, : len(inputs)])
        predictions[n] = {}
        for fraction in (1.0, *load_fractions):
            there = values * fraction**-powers
            if fraction == 1.0 or bool((there <= upper)[:, inferred].all()):
                scaled = inputs.coordinates.scaled(there)
                predictions[n][fraction] = emulated.mean(scaled)[0]
    return [
        {
            "pair": [list(_places(averaged, n)) for n in pair],
            "components": [list(_places(averaged, n).values()) for n in pair],
            "channels": _furthest(
                predictions[pair[0]], predictions[pair[1]], emulator.channels, unit
            ),
        }
        for pair in combinations(predictions, 2)
    ]


def _places(averaged: Averaged, number: int) -> dict[str, str]:
    inputs = averaged.potential.inputs
    return {inputs[k].cause: inputs[k].place for k in averaged.models[number].members}


def _furthest(one, other, channels: Channels, unit: torch.Tensor) -> list[dict]:
    """The channels in which two rivals' predictions, by load, differ most, over all loads."""
    gaps = [
        {
            # The load stands apart: the name is that of the channel at the full one.
            "output": channel.kind.column_of(channel.place),
            "load_fraction": fraction * channel.load_fraction,
            "difference_in_noise_sd": float(gap),
            "noise": float(noise),
        }
        for fraction in one.keys() & other.keys()
        for channel, noise, gap in zip(
            channels, unit, (one[fraction] - other[fraction]) / unit, strict=True
        )
        if fraction == 1.0 or channel.load_fraction == 1.0
    ]
    gaps.sort(key=lambda gap: (-np.abs(gap["difference_in_noise_sd"]), -gap["load_fraction"]))
    return gaps[:MENTIONED]
