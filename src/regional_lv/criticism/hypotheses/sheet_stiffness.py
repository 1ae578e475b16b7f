"""Sheets stiffer or softer against the matrix than in the reference material."""

from regional_lv.criticism.hypotheses.base import ScaledConstant


class SheetStiffness(ScaledConstant):
    name = "sheet_stiffness"
    constant = "a_s_kpa"
    parameter = "factor on a_s"
    unit = "1"
    low, high = 0.25, 4.0
    nodes = (0.25, 4.0)
    description = (
        "The stiffness along the sheets is the least certain ratio of the reference material: it "
        "was found from shear tests of small cubes, and published values of a_s / a lie between "
        "5 and 50. Psi multiplies a_s alone. Sheets resist only where they are stretched: above 1 "
        "the wall thins less where its sheets lie across it."
    )
    source = (
        "Dokos et al. 2002, Am J Physiol Heart Circ Physiol 283:H2650-H2659, doi "
        "10.1152/ajpheart.00111.2002; Holzapfel and Ogden 2009, doi 10.1098/rsta.2009.0091; "
        "Wang et al. 2013, doi 10.1002/cnm.2497"
    )
