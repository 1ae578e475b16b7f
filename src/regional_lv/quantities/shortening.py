"""Long-axis shortening, from the loaded state back to the unloaded one."""

from regional_lv.quantities.base import Quantity


class Shortening(Quantity):
    """(L - L0) / L of the distance between the base's mean height and the endocardial apex.

    Looking back from the loaded state a filling ventricle shortens: positive.
    """

    name = "shortening"
    sign = 1
    limits = (-0.5, 0.7)
    noise = "shortening"

    def values(self, motion, places):
        loaded, unloaded = motion.long_axis_mm
        return ((loaded - unloaded) / loaded)[None]
