"""A base that is held against twisting."""

from regional_lv.criticism.hypotheses.base import SimulatorHypothesis, value_at, with_value
from regional_lv.inputs.scales import Saturating


class BasalTwist(SimulatorHypothesis):
    name = "basal_twist"
    parameter = "circumferential stiffness of the base"
    unit = "kPa/mm"
    base, low, high = 0.0, 0.0, 100.0
    scale = Saturating(1.0)  # kPa/mm, about as stiff as the base itself
    path = ("supports", "base", "circumferential")
    nodes = (0.3, 3.0, 100.0)
    in_the_form = True
    slope_at_base = False
    description = (
        "Filling twists a wall of oblique fibres, its inner layers against its outer ones. At the "
        "simulated base these slide freely around the long axis; the fibrous ring of a living "
        "heart ties them together. Psi is the stiffness of springs along the circle of the base: "
        "from 0, where it is free, the basal wall shears less and resists more, up to a base that "
        "hardly turns."
    )
    source = (
        "Streeter et al. 1969, Circ Res 24:339-347, doi 10.1161/01.RES.24.3.339; springs at the "
        "base: Pfaller et al. 2019, doi 10.1007/s10237-018-1098-4"
    )

    def at_load(self, psi, fraction):
        return psi / fraction

    def extend(self, physics, value, component=""):
        return physics if value == self.base else with_value(physics, self.path, 1 / float(value))

    def why_not(self, physics):
        found = value_at(physics, self.path)
        if found != "free":
            return f"{'.'.join(self.path)} is {found}: the base is not free to twist"
        return ""
