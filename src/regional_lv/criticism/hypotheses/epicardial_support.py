"""Pericardium and lungs around the heart."""

from regional_lv.criticism.hypotheses.base import SimulatorHypothesis
from regional_lv.inputs.scales import Saturating


class EpicardialSupport(SimulatorHypothesis):
    name = "epicardial_support"
    parameter = "stiffness of the epicardial springs"
    unit = "kPa/mm"
    base, low, high = 0.0, 0.0, 0.2
    scale = Saturating(0.3)  # kPa/mm, about as stiff as the wall
    path = ("supports", "epicardium_kpa_per_mm")
    in_the_form = True
    nodes = (0.04, 0.1, 0.2)
    description = (
        "Pericardium and what lies around it resist the outward motion of the epicardium; the "
        "base model leaves it free. Psi is the stiffness of springs along the unloaded normal, "
        "all over the epicardium: the larger it is, the less the wall moves where it moves most, "
        "at the free wall and the apex. Beating-heart models use 0.1 kPa/mm and more, about the "
        "heart as it is filled; here the springs start from the unloaded state, and at 0.2 they "
        "take away most of the filling."
    )
    source = (
        "Pfaller et al. 2019, Biomech Model Mechanobiol 18:503-529, doi "
        "10.1007/s10237-018-1098-4; Strocchi et al. 2020, J Biomech 101:109645, doi "
        "10.1016/j.jbiomech.2020.109645"
    )

    def at_load(self, psi, fraction):
        return psi / fraction
