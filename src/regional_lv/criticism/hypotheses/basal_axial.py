"""A base that moves along the long axis."""

from regional_lv.criticism.hypotheses.base import BaseSupport


class BasalAxial(BaseSupport):
    name = "basal_axial"
    component = "axial"
    high = 10.0  # a centimetre under a filling pressure; beyond, the heart moves as a whole
    nodes = (1.0, 10.0)
    parameter = "axial compliance of the base"
    description = (
        "The simulated base stays in its plane. In a living heart the valve plane moves along the "
        "long axis by a centimetre or more in a cycle, and it tilts. Psi is the axial displacement "
        "per traction of a spring on the base, which carries the pressure on the valves. Moving as "
        "a whole the base strains nothing: what shows is that stiff sectors of the basal wall stay "
        "behind and soft ones give way."
    )
    source = (
        "Carlsson et al. 2007, Am J Physiol Heart Circ Physiol 292:H1452-H1459, doi "
        "10.1152/ajpheart.01148.2006; springs at the base: Pfaller et al. 2019, doi "
        "10.1007/s10237-018-1098-4"
    )
