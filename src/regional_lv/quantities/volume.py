"""The volume of the left ventricle's cavity."""

from typing import ClassVar

from regional_lv.quantities.base import Quantity


class Volume(Quantity):
    name, column = "volume", "volume_ml"
    unit = "mL"
    units: ClassVar = {"mL": 1.0}
    limits = (20.0, 600.0)
    noise = "volume"
    is_positive = True

    def values(self, motion, places):
        return motion.cavity_volume_ml[None]
