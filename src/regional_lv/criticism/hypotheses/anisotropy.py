"""Fibres stiffer or softer against the matrix than in the reference material."""

from regional_lv.criticism.hypotheses.base import ScaledConstant


class Anisotropy(ScaledConstant):
    name = "anisotropy"
    constant = "a_f_kpa"
    parameter = "factor on a_f"
    unit = "1"
    low, high = 0.25, 4.0
    nodes = (0.25, 4.0)
    description = (
        "C_a scales matrix, fibres, sheets and shear together: their ratios are those of one "
        "reference set, fitted to the tissue of other hearts, and published sets differ by an "
        "order of magnitude in a_f / a. Psi multiplies a_f alone: above 1 the wall resists along "
        "its fibres, around the mid-wall, more than across them."
    )
    source = (
        "Wang et al. 2013, Int J Numer Method Biomed Eng 29:83-103, doi 10.1002/cnm.2497; "
        "Holzapfel and Ogden 2009, doi 10.1098/rsta.2009.0091"
    )
