"""Which measurement would tell causes apart that explain the data equally well."""

from collections.abc import Iterator, Sequence
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
    hearts: Sequence[str],
    load_fractions: Sequence[float] = (),
) -> list[dict]:
    """For every pair of `rivals` (numbers of models): the channels, measured or not, in which their
    predictions differ most, in units of a good measurement's noise (`noise_units`).

    Each rival predicts at its own best fit to the same data, so that only what is left open shows.
    emulated: of all that the study observes, in one heart. hearts: names of those of the posterior.
    load_fractions: shares of the end-diastolic pressure at which a heart could be imaged. Stresses
    scale, so that the emulator answers for them at another stiffness; a fraction at which it would
    have to extrapolate is left out, and so are channels that the study observes at lower loads
    anyway.
    """
    channels = emulated.emulator.channels
    unit = torch.as_tensor(noise_units(channels, emulated.emulator.output_sd.numpy()))
    predictions = {}
    for n in rivals:
        fitted = averaged.models[n].fit
        if fitted is not None:
            x = fitted.x[:, : len(averaged.potential.inputs)]
            own = averaged.potential.emulated.of_each(x)[0]
            predictions[n] = {
                (heart, fraction): mean
                for heart, there in zip(hearts, own, strict=True)
                for fraction, mean in _at_loads(emulated, there[None], load_fractions)
            }
    return [
        {
            "pair": [list(_places(averaged, n)) for n in pair],
            "components": [list(_places(averaged, n).values()) for n in pair],
            "channels": _furthest(predictions[pair[0]], predictions[pair[1]], channels, unit),
        }
        for pair in combinations(predictions, 2)
    ]


def _at_loads(
    emulated: EmulatedInputs, x: torch.Tensor, fractions: Sequence[float]
) -> Iterator[tuple[float, torch.Tensor]]:
    """Predictions (U,) at scaled coordinates x (1, K) of one heart, at the full load and at the
    `fractions` of it for which the emulator answers."""
    inputs = emulated.inputs
    powers = torch.tensor([float(each.stress_power) for each in inputs])
    inferred = torch.as_tensor(inputs.of_role("inferred"))
    for fraction in (1.0, *fractions):
        there = inputs.coordinates.natural(x) * fraction**-powers
        if fraction == 1.0 or bool((there <= torch.as_tensor(inputs.upper))[:, inferred].all()):
            yield fraction, emulated.mean(inputs.coordinates.scaled(there))[0]


def _places(averaged: Averaged, number: int) -> dict[str, str]:
    inputs = averaged.potential.inputs
    return {inputs[k].cause: inputs[k].place for k in averaged.models[number].members}


def _furthest(
    one: dict[tuple[str, float], torch.Tensor],
    other: dict[tuple[str, float], torch.Tensor],
    channels: Channels,
    unit: torch.Tensor,
) -> list[dict]:
    """The channels in which two rivals' predictions, by heart and load, differ most."""
    gaps = [
        {
            "subject": heart,
            # The load stands apart: the name is that of the channel at the full one.
            "output": channel.kind.column_of(channel.place),
            "load_fraction": fraction * channel.load_fraction,
            "difference_in_noise_sd": float(gap),
            "noise": float(noise),
        }
        for heart, fraction in one.keys() & other.keys()
        for channel, noise, gap in zip(
            channels,
            unit,
            (one[heart, fraction] - other[heart, fraction]) / unit,
            strict=True,
        )
        if fraction == 1.0 or channel.load_fraction == 1.0
    ]
    gaps.sort(
        key=lambda gap: (
            -np.abs(gap["difference_in_noise_sd"]),
            -gap["load_fraction"],
            gap["subject"],
        )
    )
    return gaps[:MENTIONED]
