"""Sheets that lie flatter or steeper in the wall."""

from regional_lv.criticism.hypotheses.base import ChangedValue
from regional_lv.mechanics.materials import MATERIALS


class SheetAngle(ChangedValue):
    name = "sheet_angle"
    parameter = "change of the sheet angle's amplitude"
    unit = "deg"
    low, high = -30.0, 30.0
    path = ("fibres",)
    signs = (("sheet_endo_deg", 1), ("sheet_epi_deg", -1))
    nodes = (-30.0, 30.0)
    description = (
        "Layers of muscle branch and change their slope through the wall, from place to place by "
        "tens of degrees; the rule lets the sheet angle go linearly from one surface to the other. "
        "Positive psi makes both ends steeper (45 and -45 become 45 + psi and -45 - psi): sheets "
        "leave the direction across the wall, along which a filling wall thins."
    )
    source = (
        "LeGrice et al. 1995, Am J Physiol 269:H571-H582, doi 10.1152/ajpheart.1995.269.2.H571; "
        "Helm et al. 2005, Ann N Y Acad Sci 1047:296-307, doi 10.1196/annals.1341.026"
    )

    def why_not(self, physics):
        law = physics["material"]["law"]
        return "" if MATERIALS[law].has_sheets else f"the law {law} has no sheets"
