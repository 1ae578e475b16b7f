"""Material laws by name: one file each, and one entry here."""

from collections.abc import Mapping

from regional_lv.mechanics.materials.base import Constant, Factor, Material
from regional_lv.mechanics.materials.guccione import Guccione
from regional_lv.mechanics.materials.holzapfel_ogden import HolzapfelOgden
from regional_lv.registry import Registry

__all__ = ["MATERIALS", "Constant", "Factor", "Material", "material_from_config"]

MATERIALS = Registry("material law", "material.law", (HolzapfelOgden, Guccione))


def material_from_config(section: Mapping) -> Material:
    """The law of the section `material`, with its constants and references."""
    return MATERIALS[section["law"]](section["constants"], section["reference"])
