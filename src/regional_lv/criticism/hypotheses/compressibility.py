"""A wall that gives up volume."""

from regional_lv.criticism.hypotheses.base import SimulatorHypothesis, with_value


class Compressibility(SimulatorHypothesis):
    name = "compressibility"
    parameter = "compressibility of the wall"
    unit = "1/kPa"
    base, low, high = 0.0, 0.0, 0.05
    path = ("material", "bulk_modulus_kpa")
    in_the_form = True
    nodes = (0.02, 0.05)
    description = (
        "Muscle is nearly incompressible, but blood leaves the wall as pressure squeezes it: its "
        "volume was seen to change by 2 to 10 % within a beat. Psi is the inverse of the bulk "
        "modulus, the relative change of volume per kPa of pressure in the wall; at 0 the volume "
        "is kept. The more it gives, the more the wall thins: radial strains grow beyond what the "
        "others imply."
    )
    source = (
        "Yin et al. 1996, Am J Physiol 271:H1864-H1870; Ashikaga et al. 2008, Am J Physiol Heart "
        "Circ Physiol 295:H610-H618, doi 10.1152/ajpheart.00041.2008"
    )

    def at_load(self, psi, fraction):
        return psi * fraction

    def extend(self, physics, value, component=""):
        bulk = None if value == 0 else 1 / float(value)
        return with_value(physics, self.path, bulk)
