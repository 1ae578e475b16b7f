"""Another helix angle at the endocardium alone."""

from regional_lv.criticism.hypotheses.base import ChangedValue


class HelixEndo(ChangedValue):
    name = "helix_endo"
    parameter = "change of the endocardial helix angle"
    unit = "deg"
    low, high = -30.0, 30.0
    path = ("fibres",)
    signs = (("helix_endo_deg", 1),)
    nodes = (-30.0, -12.0, 12.0, 30.0)
    description = (
        "The rule sets one helix angle at each surface of the wall; measured ones differ between "
        "hearts by ten degrees and more, at the endocardium most, where trabeculae begin. Psi is "
        "added to the endocardial angle alone: above 0 the inner wall gets stiffer along its "
        "length and softer around it."
    )
    source = (
        "Streeter et al. 1969, Circ Res 24:339-347, doi 10.1161/01.RES.24.3.339; Lombaert et al. "
        "2012, IEEE Trans Med Imaging 31:1436-1447, doi 10.1109/TMI.2012.2192743"
    )
