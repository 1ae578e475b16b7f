"""A base that widens."""

from regional_lv.criticism.hypotheses.base import BaseSupport


class BasalMotion(BaseSupport):
    name = "basal_motion"
    component = "radial"
    high = 100.0  # all but free: 30 differs from it by a tenth of a strain's noise
    nodes = (0.3, 3.0, 100.0)
    parameter = "radial compliance of the base"
    description = (
        "The simulated base stays on its circle. The valve ring of a living heart is fibrous, not "
        "rigid: its area changes by a fifth or more in a cycle. Psi is the radial displacement "
        "per traction of a spring on the base; from 0, where it is held, the ring widens with psi "
        "up to free motion, and the basal wall thins and shortens as the rest does."
    )
    source = (
        "Levine et al. 2015, Nat Rev Cardiol 12:689-710, doi 10.1038/nrcardio.2015.161; springs "
        "at the base: Pfaller et al. 2019, doi 10.1007/s10237-018-1098-4"
    )
