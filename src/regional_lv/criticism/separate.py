"""Which measurement would tell causes apart that explain the data equally well."""

import torch

from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.emulators.base import Emulator

STRAIN_UNIT, VOLUME_UNIT_ML = 0.01, 1.0
"""Noise by which differences are compared: what good tagged MRI reaches."""

MENTIONED = 3


def separating_measurement(rivals, emulator: Emulator, extensions) -> list[dict]:
    """For every pair of `rivals` (causes fitted in earnest): the channels, measured or not, in
    which their predictions differ most, in units of a noise of 0.01 in strain and 1 mL.

    Each rival predicts at its own best fit to the same data, so that only what is left open shows.
    """
    by_place = {(e.hypothesis.name, e.component): e for e in extensions}
    predictions = {}
    for cause in rivals:
        model, draws = cause.sampled.model, cause.sampled.posterior
        found = [by_place[e.hypothesis.name, e.component] for e in model.emulator.extensions]
        full = ExtendedEmulator(emulator, found)
        x = (draws.weight[:, None] * draws.x).sum(0)[None]
        predictions[cause.name] = full.mean(model.theta(x), model.psi_of(x))[0].mean(0)
    unit = torch.tensor(
        [VOLUME_UNIT_ML if name == "volume_ml" else STRAIN_UNIT for name in emulator.outputs]
    )
    names = list(predictions)
    pairs = []
    for i, one in enumerate(names):
        for other in names[i + 1 :]:
            gap = (predictions[one] - predictions[other]) / unit
            order = gap.abs().argsort(descending=True)[:MENTIONED]
            pairs.append(
                {
                    "pair": [one, other],
                    "channels": [
                        {"output": emulator.outputs[k], "difference_in_noise_sd": float(gap[k])}
                        for k in order
                    ],
                }
            )
    return pairs
