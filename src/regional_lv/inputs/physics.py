"""What simulations depend on, out of a configuration."""

from collections.abc import Mapping

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.mechanics.materials import MATERIALS
from regional_lv.mechanics.supports import supports_from_config

SECTIONS = ("material", "fibres", "loading", "supports", "observables", "solver")
"""Sections that describe the simulator."""


def physics_of(config: dict) -> dict:
    """What a checked configuration says of the simulator, as `make_simulator` takes it.

    Raises InputError for parameters that do not fit the material law.
    """
    return {section: config[section] for section in SECTIONS} | {
        "geometry": {"wall_thickness_scale": config["geometry"]["wall_thickness_scale"]},
        "parameters": StiffnessInputs.from_config(config).spec(),
    }


def why_not_scaling(physics: Mapping) -> str:
    """Why stresses of this study do not scale with theta and pressure alone; empty if they do."""
    law, factors = physics["material"]["law"], physics["parameters"]["factors"]
    stress = MATERIALS[law].stress_factor()
    if factors and stress not in factors:
        return f"{stress}, to which all stresses are proportional, is not among the parameters"
    if physics["material"]["bulk_modulus_kpa"]:
        return "material.bulk_modulus_kpa does not scale with the pressure"
    for support in supports_from_config(physics["supports"]):
        if not support.scales_with_pressure:
            return f"the springs of supports.{support.name} do not scale with the pressure"
    for key, size in physics["loading"].items():
        if key not in ("pressure_mmhg", "frames") and size:
            return f"loading.{key} does not scale with the pressure"
    return ""
