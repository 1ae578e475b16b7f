"""Radial strains measured with a bias."""

import numpy as np

from regional_lv.criticism.hypotheses.base import TransformHypothesis


class RadialScale(TransformHypothesis):
    name = "radial_scale"
    parameter = "scale of the radial strains"
    unit = "1"
    base, low, high = 1.0, 0.5, 1.5
    description = (
        "Radial strain is the least certain of the three: the wall is only a few pixels wide, "
        "tracking smooths across it, and methods differ by a factor of two in its size while they "
        "agree on the circumferential one. Psi multiplies all radial strains."
    )
    source = (
        "Amzulescu et al. 2019, Eur Heart J Cardiovasc Imaging 20:605-619, doi "
        "10.1093/ehjci/jez041; Claus et al. 2015, doi 10.1016/j.jcmg.2015.11.001"
    )

    def measure(self, outputs, names, value):
        return np.where(_is_radial(names), value * outputs, outputs)

    def predict(self, emulator, theta, psi):
        import torch

        mean = emulator.predict(theta).mean
        radial = torch.as_tensor(_is_radial(emulator.outputs))
        return torch.where(radial, psi[..., None] * mean, mean)


def _is_radial(names) -> np.ndarray:
    return np.array([name.startswith("radial") for name in names])
