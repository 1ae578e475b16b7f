"""Another helix angle at the epicardium alone."""

from regional_lv.criticism.hypotheses.base import ChangedValue


class HelixEpi(ChangedValue):
    name = "helix_epi"
    parameter = "change of the epicardial helix angle"
    unit = "deg"
    low, high = -30.0, 30.0
    path = ("fibres",)
    signs = (("helix_epi_deg", 1),)
    nodes = (-30.0, -12.0, 12.0, 30.0)
    description = (
        "The rule sets one helix angle at each surface of the wall; measured ones differ between "
        "hearts by ten degrees and more. Psi is added to the epicardial angle alone: below 0 it "
        "gets steeper (-60 becomes -60 + psi), and the outer wall stiffer along its length and "
        "softer around it."
    )
    source = (
        "Streeter et al. 1969, Circ Res 24:339-347, doi 10.1161/01.RES.24.3.339; Lombaert et al. "
        "2012, IEEE Trans Med Imaging 31:1436-1447, doi 10.1109/TMI.2012.2192743"
    )
