"""What simulations depend on, out of a configuration."""

from regional_lv.parameters import Parameterisation

SECTIONS = ("material", "fibres", "loading", "supports", "observables", "solver")
"""Sections that describe the simulator."""


def physics_of(config: dict) -> dict:
    """What a checked configuration says of the simulator, as `make_simulator` takes it.

    Raises InputError for parameters that do not fit the material law.
    """
    return {section: config[section] for section in SECTIONS} | {
        "geometry": {"wall_thickness_scale": config["geometry"]["wall_thickness_scale"]},
        "parameters": Parameterisation.from_config(config).spec(),
    }
