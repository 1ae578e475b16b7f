"""Another end-diastolic pressure than the one assumed."""

import copy

from regional_lv.criticism.hypotheses.base import LoadHypothesis, with_value
from regional_lv.inputs.scales import Logarithmic


class EndDiastolicPressure(LoadHypothesis):
    name = "end_diastolic_pressure"
    parameter = "end-diastolic pressure"
    unit = "mmHg"
    base, low, high = 8.0, 4.0, 16.0
    scale = Logarithmic()
    description = (
        "The pressure that fills the ventricle is rarely measured together with the images; a "
        "healthy heart's is between 4 and 12 mmHg, a failing one's above 16. A higher pressure "
        "strains the wall more. It hides in the stiffness without remainder: all stresses are "
        "proportional to one factor of the material, so that the pressure p with C_a does what the "
        "assumed pressure p0 does with C_a p0 / p in every zone."
    )
    source = (
        "Nagueh et al. 2016, J Am Soc Echocardiogr 29:277-314, doi 10.1016/j.echo.2016.01.011; "
        "scaling: Holzapfel and Ogden 2009, doi 10.1098/rsta.2009.0091"
    )

    def for_study(self, physics):
        """The study's pressure, from half of it to its double."""
        found = copy.copy(self)
        found.base = physics["loading"]["pressure_mmhg"]
        found.low, found.high = found.base / 2, 2 * found.base
        return found

    def extend(self, physics, value, component=""):
        return with_value(physics, ("loading", "pressure_mmhg"), float(value))

    def share(self, psi):
        return psi / self.base
