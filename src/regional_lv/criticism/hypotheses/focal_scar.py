"""One segment stiffer, or softer, than the zone it belongs to."""

from regional_lv import aha
from regional_lv.criticism.hypotheses.base import SimulatorHypothesis, with_value
from regional_lv.inputs.scales import Logarithmic


class FocalScar(SimulatorHypothesis):
    name = "focal_scar"
    parameter = "multiplier of the stiffness in one segment"
    unit = "1"
    base, low, high = 1.0, 0.3, 5.0
    scale = Logarithmic()
    components = tuple(str(segment.number) for segment in aha.SEGMENTS)
    path = ("material", "segment_factors")
    nodes = (0.3, 5.0)
    anchors = 16
    description = (
        "Zones follow the coronary supply only roughly, and an infarct keeps to part of one. A "
        "scar is several times stiffer than the muscle around it; freshly damaged muscle is "
        "softer. Psi multiplies all stresses of one AHA segment, not known beforehand; the zone's "
        "factors take up the mean, and what is left is the contrast within the zone."
    )
    source = (
        "Holmes, Borg and Covell 2005, Annu Rev Biomed Eng 7:223-253, doi "
        "10.1146/annurev.bioeng.7.060804.100453; segments: Cerqueira et al. 2002, doi "
        "10.1161/hc0402.102975"
    )

    def extend(self, physics, value, component=""):
        factors = {component: float(value)} if component else {}
        return with_value(physics, self.path, factors)
