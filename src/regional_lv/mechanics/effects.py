"""What a study can add to the base model: effects whose sizes are numbers, not forms.

Each effect is one key of the physics; at its value in `BASE` the model is the base model. With all
of them off, the base model's own forms are compiled; with any on, the extended ones, which hold the
terms of all effects with constants for sizes, so that no further value compiles a further form.
"""

from types import SimpleNamespace

import numpy as np
import ufl

from regional_lv import aha
from regional_lv.geometry.mesh import BASE as BASE_SURFACE
from regional_lv.geometry.mesh import EPICARDIUM
from regional_lv.mechanics import dolfinx_api as api
from regional_lv.units import KPA_PER_MMHG

BASE = {
    ("fibres", "rotation_deg"): 0.0,
    ("material", "anisotropy"): 1.0,
    ("material", "bulk_modulus_kpa"): None,
    ("loading", "basal_compliance_mm_per_kpa"): 0.0,
    ("loading", "septal_pressure_mmhg"): 0.0,
    ("loading", "epicardial_spring_kpa_per_mm"): 0.0,
}
"""Section and key of each effect in the weak form, and its value in the base model."""

SEPTUM = np.flatnonzero(aha.SEGMENT_ZONE == aha.ZONES.index("septal"))
"""Segments (number - 1) whose epicardium is the right ventricle's wall."""


def any_on(config: dict) -> bool:
    """Whether any effect in the weak form differs from the base model."""
    return any(config[section].get(key, base) != base for (section, key), base in BASE.items())


def segment_factors(config: dict) -> np.ndarray:
    """Multipliers (17,) of C_a by AHA segment, 1 where the config names none."""
    factors = np.ones(len(aha.SEGMENTS))
    for segment, factor in config["material"].get("segment_factors", {}).items():
        factors[int(segment) - 1] = factor
    return factors


class Constants(SimpleNamespace):
    """Sizes of all effects as constants of the forms.

    rotation (rad), anisotropy (1), compressibility (1/kPa, the inverse of the bulk modulus),
    basal_spring (kPa/mm), septal_load (kPa), epicardial_spring (kPa/mm).
    """

    def __init__(self, domain, config: dict):
        value = {key: config[section].get(key, base) for (section, key), base in BASE.items()}
        bulk, compliance = value["bulk_modulus_kpa"], value["basal_compliance_mm_per_kpa"]
        sizes = {
            "rotation": np.deg2rad(value["rotation_deg"]),
            "anisotropy": value["anisotropy"],
            "compressibility": 0.0 if bulk is None else 1 / bulk,
            # Without compliance the supports hold the base, and no spring is needed.
            "basal_spring": 1 / compliance if compliance else 0.0,
            "septal_load": value["septal_pressure_mmhg"] * KPA_PER_MMHG,
            "epicardial_spring": value["epicardial_spring_kpa_per_mm"],
        }
        super().__init__(
            **{name: api.fem.Constant(domain, float(size)) for name, size in sizes.items()}
        )


def surface_energy(domain, u, constants: Constants, segment: np.ndarray, ds):
    """Potential (kPa mm^3) of the springs and the load on base and epicardium.

    `segment` (cells,) is the number of each cell's segment less one.

    The spring of the base acts on its distance from the long axis. On the epicardium both the
    spring and the septal load act on the displacement along the reference normal, in cylindrical
    components: N_r (r - R) + N_z u_z. This load is dead: it keeps its size per reference area and
    turns with the material about the long axis only, so that it has a potential and the tangent
    stays symmetric; a follower pressure on part of a surface has none. And as N_theta is left out
    (the section is nearly a circle), neither load nor spring turns the ventricle about its axis:
    the node that holds it against that still bears nothing.
    """
    normal = ufl.FacetNormal(domain)
    x = ufl.SpatialCoordinate(domain)
    radius = ufl.sqrt(x[0] ** 2 + x[1] ** 2)
    outward = (normal[0] * x[0] + normal[1] * x[1]) / radius
    distance = radial_displacement(domain, u)
    along_normal = outward * distance + normal[2] * u[2]
    septal = api.fem.Function(api.space(domain, "DG", 0))
    septal.x.array[:] = np.isin(segment, SEPTUM)
    return (
        constants.basal_spring / 2 * distance**2 * ds(BASE_SURFACE)
        + constants.epicardial_spring / 2 * along_normal**2 * ds(EPICARDIUM)
        + constants.septal_load * septal * along_normal * ds(EPICARDIUM)
    )


def radial_displacement(domain, u):
    """Change of the distance from the long axis."""
    x = ufl.SpatialCoordinate(domain)
    return ufl.sqrt((x[0] + u[0]) ** 2 + (x[1] + u[1]) ** 2) - ufl.sqrt(x[0] ** 2 + x[1] ** 2)
