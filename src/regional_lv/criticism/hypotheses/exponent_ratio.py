"""Fibres that stiffen faster or slower with stretch than the reference material."""

from regional_lv.criticism.hypotheses.base import ScaledConstant


class ExponentRatio(ScaledConstant):
    name = "exponent_ratio"
    constant = "b_f"
    parameter = "factor on b_f"
    unit = "1"
    low, high = 0.5, 2.0
    nodes = (0.5, 2.0)
    description = (
        "C_b scales the exponents of matrix, fibres, sheets and shear together; how fast fibres "
        "stiffen against the matrix is inherited from one reference set. Psi multiplies b_f "
        "alone: above 1 the fibres lock earlier, so that segments which are stretched most along "
        "their fibres are evened out."
    )
    source = (
        "Holzapfel and Ogden 2009, doi 10.1098/rsta.2009.0091; Wang et al. 2013, doi "
        "10.1002/cnm.2497"
    )
