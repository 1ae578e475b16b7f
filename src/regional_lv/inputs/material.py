"""Inputs of the material beside its factors in the zones: ratios, scars, compressibility."""

from typing import ClassVar

from regional_lv.inputs.base import LOGARITHMIC, Input, KeyInput, SegmentInput, multiplied
from regional_lv.inputs.stiffness import SCAR
from regional_lv.mechanics.materials import MATERIALS

WANG = "Wang et al. 2013, Int J Numer Method Biomed Eng 29:83-103, doi 10.1002/cnm.2497"
HOLZAPFEL = "Holzapfel and Ogden 2009, doi 10.1098/rsta.2009.0091"


class ConstantRatio(Input):
    """Multiplies one `constant` of the material law."""

    family = "material"
    changes = "material"
    scale = LOGARITHMIC
    constant: ClassVar[str]

    @classmethod
    def why_not(cls, model):
        if cls.constant not in model["material"]["constants"]:
            return f"the law {model['material']['law']} has no constant {cls.constant}"
        return ""

    def value_in(self, model):
        return 1.0

    def act(self, model, value):
        material = model["material"]
        constants = material["constants"]
        scaled = {**constants, self.constant: constants[self.constant] * value}
        return {**model, "material": {**material, "constants": scaled}}


class Anisotropy(ConstantRatio):
    name = "anisotropy"
    constant = "a_f_kpa"
    parameter = "factor on a_f"
    low, high = 0.25, 4.0
    description = (
        "Published sets differ by an order of magnitude in the ratio a_f / a of fibres to matrix. "
        "Above 1 the wall resists more along its fibres than across them."
    )
    source = f"{WANG}; {HOLZAPFEL}"


class SheetStiffness(ConstantRatio):
    name = "sheet_stiffness"
    constant = "a_s_kpa"
    parameter = "factor on a_s"
    low, high = 0.25, 4.0
    description = (
        "The stiffness along the sheets comes from shear tests of small cubes; published ratios "
        "a_s / a lie between 5 and 50. Above 1 the wall thins less where its sheets lie across it."
    )
    source = (
        "Dokos et al. 2002, Am J Physiol Heart Circ Physiol 283:H2650-H2659, doi "
        f"10.1152/ajpheart.00111.2002; {HOLZAPFEL}; {WANG}"
    )


class ExponentRatio(ConstantRatio):
    name = "exponent_ratio"
    constant = "b_f"
    parameter = "factor on b_f"
    low, high = 0.5, 2.0
    description = (
        "How fast fibres stiffen with stretch against the matrix. Above 1 the fibres lock earlier, "
        "so that segments which are stretched most along their fibres are evened out."
    )
    source = f"{HOLZAPFEL}; {WANG}"


class FocalScar(SegmentInput):
    name = SCAR
    family = "material"
    changes = "factors"
    scale = LOGARITHMIC
    parameter = "multiplier of the stiffness in one segment"
    low, high = 0.3, 5.0
    description = (
        "An infarct keeps to part of a zone, and is several times stiffer than the muscle around "
        "it; freshly damaged muscle is softer. Multiplies all stresses of one AHA segment."
    )
    source = (
        "Holmes, Borg and Covell 2005, Annu Rev Biomed Eng 7:223-253, doi "
        "10.1146/annurev.bioeng.7.060804.100453; segments: Cerqueira et al. 2002, doi "
        "10.1161/hc0402.102975"
    )

    def __init__(self, model, segment):
        super().__init__(model, segment)
        self._factor = MATERIALS[model["material"]["law"]].stress_factor()

    @property
    def block(self):
        return FocalScar.name

    @property
    def field(self):
        return self._factor  # on its scale it adds to the factor of the zone

    def value_in(self, model):
        return 1.0

    def act(self, model, value):
        factors = model["factors"]
        changed = multiplied(factors[self._factor], self.segment - 1, value)
        return {**model, "factors": {**factors, self._factor: changed}}


class Compressibility(KeyInput):
    name = "compressibility"
    family = "material"
    path = ("material", "compressibility_per_kpa")
    parameter = "compressibility of the wall"
    unit = "1/kPa"
    low, high, least = 0.0, 0.05, 0.0
    stress_power = -1
    description = (
        "Blood leaves the wall as pressure squeezes it: its volume was seen to change by 2 to 10 % "
        "within a beat. The inverse of the bulk modulus, 0 for a wall that keeps its volume."
    )
    source = (
        "Yin et al. 1996, Am J Physiol 271:H1864-H1870; Ashikaga et al. 2008, Am J Physiol Heart "
        "Circ Physiol 295:H610-H618, doi 10.1152/ajpheart.00041.2008"
    )
