"""Strains of lines in the wall, or components of the strain tensor."""

from regional_lv.criticism.hypotheses.base import MeasureHypothesis


class LineStrain(MeasureHypothesis):
    name = "line_strain"
    parameter = "share of the material line's strain"
    unit = "1"
    base, low, high = 0.0, 0.0, 1.0
    path = ("observables", "line_share")
    values = (0.0, 0.5, 1.0)
    nodes = (0.5, 1.0)
    description = (
        "A code reports the component of a strain tensor along a direction; an image shows how "
        "much longer a line of tissue along that direction became. In a wall that shears the two "
        "differ, except for Green's strain, of which they are the same. "
        "Psi mixes linearly from the tensor's component (0) to the line's strain (1)."
    )
    source = (
        "Hill 1968, J Mech Phys Solids 16:229-242, doi 10.1016/0022-5096(68)90031-8; in imaging: "
        "Claus et al. 2015, JACC Cardiovasc Imaging 8:1444-1460, doi 10.1016/j.jcmg.2015.11.001"
    )

    def why_not(self, physics):
        if physics["observables"]["strain_exponent"] == 2:
            return "Green's strain (observables.strain_exponent 2) of a line is that of the tensor"
        return super().why_not(physics)
