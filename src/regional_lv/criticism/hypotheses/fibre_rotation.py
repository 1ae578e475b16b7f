"""Steeper or flatter fibres than the rule has them."""

from regional_lv.criticism.hypotheses.base import SimulatorHypothesis


class FibreRotation(SimulatorHypothesis):
    name = "fibre_rotation"
    parameter = "rotation of the helix angle"
    unit = "deg"
    base, low, high = 0.0, -30.0, 30.0
    path = ("fibres", "rotation_deg")
    nodes = (-30.0, -12.0, 12.0, 30.0)
    description = (
        "Fibres of a living ventricle are not imaged; a rule gives them one helix angle at the "
        "endocardium and one at the epicardium. Measured angles differ between hearts by ten "
        "degrees and more. Positive psi makes both steeper (60 and -60 become 60 + psi and -60 - "
        "psi): the wall gets stiffer along its length and softer around it."
    )
    source = (
        "Streeter et al. 1969, Circ Res 24:339-347, doi 10.1161/01.RES.24.3.339; Lombaert et al. "
        "2012, IEEE Trans Med Imaging 31:1436-1447, doi 10.1109/TMI.2012.2192743"
    )
