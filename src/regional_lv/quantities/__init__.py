"""Observed quantities by name: one file each, and one entry here."""

from regional_lv.quantities.base import NOWHERE, SEGMENT_PLACES, Quantity
from regional_lv.quantities.shortening import Shortening
from regional_lv.quantities.strains import Circumferential, Longitudinal, Radial
from regional_lv.quantities.torsion import Torsion
from regional_lv.quantities.volume import Volume
from regional_lv.registry import Registry

__all__ = ["NOWHERE", "QUANTITIES", "SEGMENT_PLACES", "Quantity"]

QUANTITIES = Registry(
    "quantity",
    "observables.quantities",
    (Volume, Circumferential, Radial, Longitudinal, Torsion, Shortening),
)
