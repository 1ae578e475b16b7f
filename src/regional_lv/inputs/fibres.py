"""Inputs of the fibres and sheets."""

from regional_lv.inputs.base import AddedInput
from regional_lv.mechanics.materials import MATERIALS

HELIX = (
    "Streeter et al. 1969, Circ Res 24:339-347, doi 10.1161/01.RES.24.3.339; Lombaert et al. 2012, "
    "IEEE Trans Med Imaging 31:1436-1447, doi 10.1109/TMI.2012.2192743"
)


class FibreInput(AddedInput):
    """A change of angles of the rule, in degrees."""

    family = "fibres"
    changes = "fibres"
    unit = "deg"
    low, high = -30.0, 30.0


class HelixEndo(FibreInput):
    name = "helix_endo"
    parameter = "change of the endocardial helix angle"
    signs = (("helix_endo_deg", 1),)
    description = (
        "Measured helix angles differ between hearts by ten degrees and more, at the endocardium "
        "most. Above 0 the inner wall gets stiffer along its length and softer around it."
    )
    source = HELIX


class HelixEpi(FibreInput):
    name = "helix_epi"
    parameter = "change of the epicardial helix angle"
    signs = (("helix_epi_deg", 1),)
    description = (
        "Added to the epicardial angle alone: below 0 it gets steeper (-60 becomes -60 + psi), and "
        "the outer wall stiffer along its length and softer around it."
    )
    source = HELIX


class FibreRotation(FibreInput):
    name = "fibre_rotation"
    parameter = "rotation of the helix angle"
    signs = (("helix_endo_deg", 1), ("helix_epi_deg", -1))
    moves = (HelixEndo.name, HelixEpi.name)
    carries = True
    description = (
        "Both helix angles steeper by as much (60 and -60 become 60 + psi and -60 - psi): the wall "
        "gets stiffer along its length and softer around it."
    )
    source = HELIX

    def carry(self, other, there, value):
        sign = dict(self.signs)[other.signs[0][0]] * other.signs[0][1]
        return there + sign * value, 1 + 0 * value, sign + 0 * value


class SheetAngle(FibreInput):
    name = "sheet_angle"
    parameter = "change of the sheet angle's amplitude"
    signs = (("sheet_endo_deg", 1), ("sheet_epi_deg", -1))
    description = (
        "Layers of muscle change their slope through the wall, from place to place by tens of "
        "degrees. Positive values make both ends steeper (45 and -45 become 45 + psi and -45 - "
        "psi): sheets leave the direction across the wall, along which a filling wall thins."
    )
    source = (
        "LeGrice et al. 1995, Am J Physiol 269:H571-H582, doi 10.1152/ajpheart.1995.269.2.H571; "
        "Helm et al. 2005, Ann N Y Acad Sci 1047:296-307, doi 10.1196/annals.1341.026"
    )

    @classmethod
    def why_not(cls, model):
        law = model["material"]["law"]
        return "" if MATERIALS[law].has_sheets else f"the law {law} has no sheets"
