"""Which measurement would tell causes apart that explain the data equally well."""

from collections.abc import Sequence

import torch

from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.criticism.hypotheses.base import pressure_scaled
from regional_lv.emulators.base import Emulator

STRAIN_UNIT, VOLUME_UNIT_ML = 0.01, 1.0
"""Noise by which differences are compared: what good tagged MRI reaches."""

MENTIONED = 3


def separating_measurement(
    rivals, emulator: Emulator, extensions, load_fractions: Sequence[float] = ()
) -> list[dict]:
    """For every pair of `rivals` (causes fitted in earnest): the channels, measured or not, in
    which their predictions differ most, in units of a noise of 0.01 in strain and 1 mL.

    Each rival predicts at its own best fit to the same data, so that only what is left open shows.
    load_fractions: shares of the end-diastolic pressure at which the heart could be imaged. All
    stresses scale, so that the emulators answer for them at another C_a; a fraction at which they
    would have to extrapolate in theta is left out.
    """
    by_place = {(e.hypothesis.name, e.component): e for e in extensions}
    unit = torch.tensor(
        [VOLUME_UNIT_ML if name == "volume_ml" else STRAIN_UNIT for name in emulator.outputs]
    )
    predictions = {}
    for cause in rivals:
        model, draws = cause.sampled.model, cause.sampled.posterior
        found = [by_place[e.hypothesis.name, e.component] for e in model.emulator.extensions]
        full = ExtendedEmulator(emulator, found)
        x = (draws.weight[:, None] * draws.x).sum(0)[None]
        theta, psi = model.theta(x), model.psi_of(x)
        at = {}
        for fraction in (1.0, *load_fractions):
            scaled = pressure_scaled(theta, torch.tensor([fraction], dtype=theta.dtype))
            if fraction == 1.0 or float(scaled.max()) <= emulator.upper:
                columns = [e.hypothesis.at_load(psi[..., i], fraction) for i, e in enumerate(found)]
                by_load = torch.stack(columns, -1) if found else psi
                at[fraction] = full.mean(scaled, by_load)[0].mean(0)
        predictions[cause.name] = at
    names = list(predictions)
    return [
        {"pair": [one, other], "channels": _furthest(predictions, one, other, emulator, unit)}
        for i, one in enumerate(names)
        for other in names[i + 1 :]
    ]


def _furthest(predictions, one, other, emulator, unit) -> list[dict]:
    """The channels in which two rivals differ most, over all loads."""
    gaps = [
        {
            "output": output,
            "load_fraction": fraction,
            "difference_in_noise_sd": float(gap),
        }
        for fraction in predictions[one].keys() & predictions[other].keys()
        for output, gap in zip(
            emulator.outputs,
            (predictions[one][fraction] - predictions[other][fraction]) / unit,
            strict=True,
        )
    ]
    gaps.sort(key=lambda gap: (-abs(gap["difference_in_noise_sd"]), -gap["load_fraction"]))
    return gaps[:MENTIONED]
