"""Which measurement would tell causes apart that explain the data equally well."""

from collections.abc import Sequence

import pandas as pd
import torch

from regional_lv.channels import Channels
from regional_lv.criticism.confirmation import correct
from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.emulators.base import Emulator
from regional_lv.inference.departure import noise_units

MENTIONED = 3


def separating_measurement(
    rivals,
    emulator: Emulator,
    extensions,
    load_fractions: Sequence[float] = (),
    simulations: pd.DataFrame | None = None,
) -> list[dict]:
    """For every pair of `rivals` (sets of causes that were sampled): the channels, measured or not,
    in which their predictions differ most, in units of a good measurement's noise (`noise_units`).

    Each rival predicts at its own best fit to the same data, so that only what is left open shows.
    load_fractions: shares of the end-diastolic pressure at which the heart could be imaged. All
    stresses scale, so that the emulators answer for them at another stiffness; a fraction at which
    they would have to extrapolate in theta is left out, and so are channels that the study observes
    at lower loads anyway. simulations: of the confirmation, which correct the emulators here as
    they do in the evidence; what they correct at the full load is taken in proportion at lower
    ones.
    """
    by_place = {(e.hypothesis.name, e.component): e for e in extensions}
    channels = emulator.channels
    unit = torch.as_tensor(noise_units(channels, emulator.output_sd.numpy()))
    predictions = {}
    for one in rivals:
        model, x = one.sampled.model, one.sampled.fit.x
        found = [by_place[e.hypothesis.name, e.component] for e in model.emulator.extensions]
        full = ExtendedEmulator(emulator, found)
        correction = None if simulations is None else correct(model, one.members, simulations, full)
        theta, effects = model.theta(x), model.scaled_psi(x)
        at = {}
        for fraction in (1.0, *load_fractions):
            factor = torch.tensor([fraction], dtype=theta.dtype)
            there, others = full.under_load(theta, effects, factor)
            if fraction == 1.0 or bool((there <= emulator.upper).all()):
                mean = full.mean(there, others)
                if correction is not None:
                    mean = mean + fraction * correction.mean(theta, effects)
                at[fraction] = mean[0].mean(0)
        predictions[one.members] = at
    names = list(predictions)
    return [
        {
            "pair": [[name for name, _ in members] for members in (one, other)],
            "components": [[component for _, component in members] for members in (one, other)],
            "channels": _furthest(predictions, one, other, channels, unit),
        }
        for i, one in enumerate(names)
        for other in names[i + 1 :]
    ]


def _furthest(predictions, one, other, channels: Channels, unit) -> list[dict]:
    """The channels in which two rivals differ most, over all loads."""
    gaps = [
        {
            # The load stands apart: the name is that of the channel at the full one.
            "output": channel.kind.column_of(channel.place),
            "load_fraction": fraction * channel.load_fraction,
            "difference_in_noise_sd": float(gap),
            "noise": float(noise),
        }
        for fraction in predictions[one].keys() & predictions[other].keys()
        for channel, noise, gap in zip(
            *(channels, unit, (predictions[one][fraction] - predictions[other][fraction]) / unit),
            strict=True,
        )
        if fraction == 1.0 or channel.load_fraction == 1.0
    ]
    gaps.sort(key=lambda gap: (-abs(gap["difference_in_noise_sd"]), -gap["load_fraction"]))
    return gaps[:MENTIONED]
