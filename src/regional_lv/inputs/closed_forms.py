"""Inputs whose effect is an exact transform of what the others give: nothing is simulated for them.

A ventricle whose stresses, loads and springs are all multiplied by one number moves as before, and
so does one that is scaled as a whole, if its springs are scaled along.
"""

import numpy as np

from regional_lv.channels import Channels
from regional_lv.inputs.base import LOGARITHMIC, Input
from regional_lv.mechanics.materials import MATERIALS
from regional_lv.quantities import QUANTITIES

VOLUME, RADIAL = "volume", "radial"

LENGTH_POWERS = {"1": 0, "mm": 1, "mL": 3, "deg": 0, "deg/mm": -1}
"""Unit of a quantity -> the power of its size that it goes with."""


class ClosedForm(Input):
    """An exact transform: other inputs at which the outputs are looked up, and what is reported of
    them. The defaults change nothing."""

    changes = "outputs"

    @property
    def is_simulated(self):
        return False

    def act(self, model, value):
        return model

    def power(self, other: Input) -> int:
        """The `other` input is multiplied by `share` to the minus this power."""
        return 0

    def share(self, value):
        """A number above 0 at `value` (number, array or tensor), 1 at the nominal one, and its
        derivative."""
        return 1.0, 0.0

    def concerned(self, channels: Channels) -> np.ndarray:
        """Mask (D,) of the channels that are looked up there."""
        return np.ones(len(channels), dtype=bool)

    def reported(self, channels: Channels) -> np.ndarray:
        """Powers (D,) of the value that outputs are multiplied by."""
        return np.zeros(len(channels))


class LoadForm(ClosedForm):
    """Channels under another load: `share` of the study's."""

    def power(self, other):
        return other.stress_power

    @classmethod
    def why_not(cls, model):
        stress = MATERIALS[model["material"]["law"]].stress_factor()
        if stress not in model["parameters"]["factors"]:
            return f"{stress}, to which all stresses are proportional, is not among the parameters"
        return ""


class EndDiastolicPressure(LoadForm):
    name = "end_diastolic_pressure"
    nominal: float
    family = "loads"
    parameter = "end-diastolic pressure"
    unit = "mmHg"
    scale = LOGARITHMIC
    description = (
        "The pressure that fills the ventricle is rarely measured together with the images. A "
        "higher one strains the wall more, as one stiffness, or springs, lower by as much do."
    )
    source = (
        "Nagueh et al. 2016, J Am Soc Echocardiogr 29:277-314, doi 10.1016/j.echo.2016.01.011; "
        "scaling: Holzapfel and Ogden 2009, doi 10.1098/rsta.2009.0091"
    )

    def __init__(self, model):
        pressure = float(model["loading"]["pressure_mmhg"])
        self.nominal, self.low, self.high = pressure, pressure / 2, 2 * pressure
        stress = MATERIALS[model["material"]["law"]].stress_factor()
        self.moves = tuple(f"{stress}_{zone}" for zone in model["parameters"]["zones"])

    def share(self, value):
        return value / self.nominal, 1 / self.nominal


class MixedFrames(LoadForm):
    name = "mixed_frames"
    family = "observation"
    parameter = "share of the filling pressure missing in the strains"
    low, high, least, most = 0.0, 0.6, 0.0, 0.95
    description = (
        "The frame called end-diastolic is not the same in all sequences. The share of the "
        "end-diastolic pressure that is missing where the strains are read, while the volume is "
        "end-diastolic: strains come out smaller than the volume implies."
    )
    source = (
        "Mada et al. 2015, JACC Cardiovasc Imaging 8:148-157; scaling: Holzapfel and Ogden 2009, "
        "doi 10.1098/rsta.2009.0091"
    )

    @classmethod
    def why_not(cls, model):
        quantities = model["observables"]["quantities"]
        if VOLUME not in quantities or len(quantities) < 2:
            return f"{VOLUME} and something else are not both observed (observables.quantities)"
        return super().why_not(model)

    def value_in(self, model):
        return 0.0

    def share(self, value):
        return 1 - value, -1.0

    def concerned(self, channels):
        return ~channels.of_quantity(VOLUME)


class RadialScale(ClosedForm):
    name = "radial_scale"
    family = "observation"
    parameter = "scale of the radial strains"
    low, high, least = 0.5, 1.5, 0.0
    description = (
        "The wall is only a few pixels wide, tracking smooths across it, and methods differ by a "
        "factor of two in radial strain while they agree on the circumferential one. Multiplies "
        "all radial strains."
    )
    source = (
        "Amzulescu et al. 2019, Eur Heart J Cardiovasc Imaging 20:605-619, doi "
        "10.1093/ehjci/jez041; Claus et al. 2015, doi 10.1016/j.jcmg.2015.11.001"
    )

    @classmethod
    def why_not(cls, model):
        if RADIAL not in model["observables"]["quantities"]:
            return f"{RADIAL} strain is not observed (observables.quantities)"
        return ""

    def value_in(self, model):
        return 1.0

    def reported(self, channels):
        return channels.of_quantity(RADIAL).astype(float)


class Size(ClosedForm):
    name = "size"
    is_cause = False
    family = "shape"
    parameter = "scale of the whole ventricle"
    low, high = 0.8, 1.25
    scale = LOGARITHMIC
    description = (
        "A pixel size or a slice distance read wrongly scales the whole ventricle: strains stay, "
        "volumes go with the cube, and springs act as if they were as many times stiffer."
    )
    source = "Dimensional analysis: but for springs, the unloaded shape alone has a length."

    def value_in(self, model):
        return 1.0

    @classmethod
    def why_not(cls, model):
        for name in model["observables"]["quantities"]:
            if QUANTITIES[name].unit not in LENGTH_POWERS:
                return f"how {name} ({QUANTITIES[name].unit}) goes with the size is not known"
        return ""

    def power(self, other):
        return other.length_power

    def share(self, value):
        return value, 1.0

    def reported(self, channels):
        return np.array([LENGTH_POWERS[channel.unit] for channel in channels], dtype=float)


class HeavyTails(ClosedForm):
    name = "heavy_tails"
    family = "observation"
    changes = "noise"
    roles = ("suspected", "fixed")
    parameter = "inverse of the degrees of freedom of the noise"
    low, high, least, most = 0.0, 0.4, 0.0, 1.0
    description = (
        "A lost tag, a slice moved by breathing: single channels are far off while the others are "
        "as exact as ever. Student's t noise with the channels' sd as its scale; at 0 it is "
        "Gaussian, at 0.4 one channel in ten is off by more than 2.6 sd."
    )
    source = (
        "Lange, Little and Taylor 1989, J Am Stat Assoc 84:881-896, doi "
        "10.1080/01621459.1989.10478852"
    )

    def value_in(self, model):
        return 0.0
