"""Inputs of the loads and supports."""

import math

from regional_lv.aha import SEPTUM
from regional_lv.inputs.base import KeyInput
from regional_lv.inputs.keys import value_at, with_value
from regional_lv.inputs.scales import Saturating

PFALLER = "Pfaller et al. 2019, Biomech Model Mechanobiol 18:503-529, doi 10.1007/s10237-018-1098-4"


class SeptalLoad(KeyInput):
    name = "septal_load"
    family = "loads"
    path = ("loading", "septal_pressure_mmhg")
    parameter = "right-ventricular pressure"
    unit = "mmHg"
    low, high = 0.0, 6.0
    stress_power = 1
    segments = SEPTUM
    description = (
        "The right ventricle's end-diastolic pressure pushes the septum into the left cavity: a "
        "dead load along the normal of the unloaded epicardium of segments 2, 3, 8 and 9, which "
        "grows with the cavity's pressure."
    )
    source = (
        "Little et al. 1984, Circ Res 54:719-730, doi 10.1161/01.RES.54.6.719; right-heart "
        "pressures: Rudski et al. 2010, doi 10.1016/j.echo.2010.05.010"
    )


class BaseCompliance(KeyInput):
    """The compliance of the base in one component, 0 where it is held."""

    family = "supports"
    unit = "mm/kPa"
    low = least = 0.0
    scale = Saturating(1.0)  # mm/kPa, about as compliant as the base itself
    stress_power, length_power = -1, 1

    @classmethod
    def why_not(cls, model):
        if math.isinf(value_at(model, cls.path)):
            return f"{'.'.join(cls.path)} is free: the base is not held there"
        return ""


class BasalMotion(BaseCompliance):
    name = "basal_motion"
    path = ("supports", "base", "radial")
    parameter = "radial compliance of the base"
    high = 100.0  # all but free
    description = (
        "The valve ring of a living heart is fibrous, not rigid: its area changes by a fifth or "
        "more in a cycle. The radial displacement per traction of a spring on the base: from 0, "
        "where it is held, the ring widens up to free motion."
    )
    source = (
        "Levine et al. 2015, Nat Rev Cardiol 12:689-710, doi 10.1038/nrcardio.2015.161; springs: "
        f"{PFALLER}"
    )


class BasalAxial(BaseCompliance):
    name = "basal_axial"
    path = ("supports", "base", "axial")
    parameter = "axial compliance of the base"
    high = 10.0  # a centimetre under a filling pressure
    description = (
        "The valve plane moves along the long axis by a centimetre or more in a cycle, and tilts. "
        "The axial displacement per traction of a spring on the base, which carries the pressure "
        "on the valves: stiff sectors of the basal wall stay behind and soft ones give way."
    )
    source = (
        "Carlsson et al. 2007, Am J Physiol Heart Circ Physiol 292:H1452-H1459, doi "
        f"10.1152/ajpheart.01148.2006; springs: {PFALLER}"
    )


class BasalTwist(KeyInput):
    name = "basal_twist"
    family = "supports"
    path = ("supports", "base", "circumferential")
    parameter = "circumferential stiffness of the base"
    unit = "kPa/mm"
    low, high, least = 0.0, 100.0, 0.0
    scale = Saturating(1.0)  # kPa/mm, about as stiff as the base itself
    stress_power, length_power = 1, -1
    description = (
        "Filling twists a wall of oblique fibres, its inner layers against its outer ones; the "
        "fibrous ring of a living heart ties them together. The stiffness of springs along the "
        "circle of the base, from 0, where it is free, up to a base that hardly turns."
    )
    source = (
        "Streeter et al. 1969, Circ Res 24:339-347, doi 10.1161/01.RES.24.3.339; springs: "
        + PFALLER
    )

    @classmethod
    def why_not(cls, model):
        if value_at(model, cls.path) == 0:
            return f"{'.'.join(cls.path)} is held: the base cannot twist"
        return ""

    def value_in(self, model):
        return 1 / value_at(model, self.path)

    def act(self, model, value):
        return with_value(model, self.path, 1 / value if value else math.inf)


class EpicardialSupport(KeyInput):
    name = "epicardial_support"
    family = "supports"
    path = ("supports", "epicardium_kpa_per_mm")
    parameter = "stiffness of the epicardial springs"
    unit = "kPa/mm"
    low, high, least = 0.0, 0.2, 0.0
    scale = Saturating(0.3)  # kPa/mm, about as stiff as the wall
    stress_power, length_power = 1, -1
    description = (
        "Pericardium and what lies around it resist the outward motion of the epicardium: the "
        "stiffness of springs along the unloaded normal, all over the epicardium. The larger it "
        "is, the less the wall moves where it moves most, at the free wall and the apex."
    )
    source = (
        f"{PFALLER}; Strocchi et al. 2020, J Biomech 101:109645, doi 10.1016/j.jbiomech.2020.109645"
    )
