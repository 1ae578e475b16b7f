"""Radial strains measured with a bias."""

from regional_lv.criticism.hypotheses.base import (
    ReportHypothesis,
    mask_of,
    value_at,
    with_value,
)

RADIAL = "radial"


class RadialScale(ReportHypothesis):
    name = "radial_scale"
    parameter = "scale of the radial strains"
    unit = "1"
    base, low, high = 1.0, 0.5, 1.5
    path = ("observables", "scale")
    description = (
        "Radial strain is the least certain of the three: the wall is only a few pixels wide, "
        "tracking smooths across it, and methods differ by a factor of two in its size while they "
        "agree on the circumferential one. Psi multiplies all radial strains."
    )
    source = (
        "Amzulescu et al. 2019, Eur Heart J Cardiovasc Imaging 20:605-619, doi "
        "10.1093/ehjci/jez041; Claus et al. 2015, doi 10.1016/j.jcmg.2015.11.001"
    )

    def why_not(self, physics):
        if RADIAL not in physics["observables"]["quantities"]:
            return f"{RADIAL} strain is not observed (observables.quantities)"
        return ""

    def extend(self, physics, value, component=""):
        scale = value_at(physics, self.path)
        if value == self.base:
            return physics
        scale = {**scale, RADIAL: float(value) * scale.get(RADIAL, 1.0)}
        return with_value(physics, self.path, scale)

    def reported(self, mean, outputs, psi):
        import torch

        radial = torch.as_tensor(mask_of(outputs, RADIAL))
        return torch.where(radial, psi[..., None] * mean, mean)
