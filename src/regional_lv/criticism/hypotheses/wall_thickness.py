"""A wall thicker or thinner than in the table."""

from regional_lv.criticism.hypotheses.base import SimulatorHypothesis
from regional_lv.inputs.scales import Logarithmic


class WallThickness(SimulatorHypothesis):
    name = "wall_thickness"
    parameter = "scale of the wall thickness"
    unit = "1"
    base, low, high = 1.0, 0.75, 1.25
    scale = Logarithmic()
    path = ("geometry", "wall_thickness_scale")
    nodes = (0.75, 1.25)
    description = (
        "Wall thickness is measured on slices of finite depth, with a border between muscle, fat "
        "and trabeculae that observers draw differently: a millimetre in ten. Psi multiplies it "
        "everywhere, with the endocardium as it is. A thicker wall strains less on average, while "
        "the cavity's volume hardly changes: the circumferential fibres of the mid-wall move "
        "outwards, where they are stretched less."
    )
    source = (
        "Kawel et al. 2012, Circ Cardiovasc Imaging 5:500-508, doi 10.1161/CIRCIMAGING.112.973560"
    )
