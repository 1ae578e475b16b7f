"""What holds the ventricle: its base, component by component, and springs on the epicardium.

A support is one class and one entry in `SUPPORTS`, under the key of the section `supports` that
describes it. Sizes are constants of the forms, so that another value compiles no other form.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from regional_lv.errors import InputError
from regional_lv.geometry.mesh import BASE, EPICARDIUM
from regional_lv.registry import Registry

COMPONENTS = ("radial", "circumferential", "axial")
"""Of a displacement in cylindrical coordinates about the long axis."""


class Support(ABC):
    """Something that resists displacements.

    `section` is what the configuration says under `supports.<name>`; the constructor raises
    InputError for what cannot be used.
    """

    name: ClassVar[str]

    def __init__(self, section):
        self.section = section

    @property
    @abstractmethod
    def springs(self) -> dict[str, float]:
        """Stiffness (kPa/mm) of each of its springs, 0 where there is none, always the same
        names."""

    @abstractmethod
    def energy(self, surroundings, stiffness: Mapping):
        """Potential (kPa mm3) of its springs, a UFL form, nothing where all of them have none.

        surroundings: a `Surroundings`. stiffness: constants by name of the springs.
        """

    @property
    def scales_with_pressure(self) -> bool:
        """Whether a heart whose stresses and pressures are all multiplied by one number moves as
        before: springs do not."""
        return not any(self.springs.values())

    @property
    def holds_axially(self) -> bool:
        """Whether it keeps the heart from moving along its axis."""
        return False

    @property
    def holds_across(self) -> bool:
        """Whether it keeps the heart from moving across its axis."""
        return False


class Surroundings:
    """The wall's surfaces and displacement, in which supports and loads express themselves (UFL).

    u: displacement. ds: measure of the surfaces, by their tag. segment (cells,): number less one.
    """

    def __init__(self, domain, u, ds, segment: np.ndarray):
        self.domain, self.u, self.ds, self.segment = domain, u, ds, segment

    @property
    def place(self):
        import ufl

        return ufl.SpatialCoordinate(self.domain)

    @property
    def radial(self):
        """Change of the distance from the long axis."""
        import ufl

        x, u = self.place, self.u
        return ufl.sqrt((x[0] + u[0]) ** 2 + (x[1] + u[1]) ** 2) - ufl.sqrt(x[0] ** 2 + x[1] ** 2)

    @property
    def circumferential(self):
        """Distance along the circle about the long axis, the unloaded radius times the angle.

        tan(angle / 2) = cross / (product of the radii + dot), which has no seam at 180 degrees.
        """
        import ufl

        x, u = self.place, self.u
        there = (x[0] + u[0], x[1] + u[1])
        before = ufl.sqrt(x[0] ** 2 + x[1] ** 2)
        after = ufl.sqrt(there[0] ** 2 + there[1] ** 2)
        cross = x[0] * there[1] - x[1] * there[0]
        along = x[0] * there[0] + x[1] * there[1]
        return before * 2 * ufl.atan(cross / (before * after + along))

    @property
    def axial(self):
        return self.u[2]

    @property
    def along_normal(self):
        """Displacement along the unloaded normal, in cylindrical components: N_r (r - R) + N_z u_z.

        N_theta is left out (the section is nearly a circle), so that neither load nor spring turns
        the ventricle about its axis: a node that holds it against that bears nothing.
        """
        import ufl

        normal, x = ufl.FacetNormal(self.domain), self.place
        radius = ufl.sqrt(x[0] ** 2 + x[1] ** 2)
        return (normal[0] * x[0] + normal[1] * x[1]) / radius * self.radial + normal[2] * self.u[2]


class Base(Support):
    """The valve plane: each component of its displacement held, free, or on a spring.

    section: by component `held`, `free`, or the compliance of a spring in mm/kPa (0 holds).
    """

    name = "base"

    def __init__(self, section):
        super().__init__(section)
        self.compliance = {c: _compliance(f"supports.base.{c}", section[c]) for c in COMPONENTS}

    def holds(self, component: str) -> bool:
        return self.compliance[component] == 0

    @property
    def springs(self):
        return {
            c: 1 / value if 0 < value < math.inf else 0.0 for c, value in self.compliance.items()
        }

    @property
    def holds_axially(self):
        return math.isfinite(self.compliance["axial"])

    @property
    def holds_across(self):
        return any(math.isfinite(self.compliance[c]) for c in ("radial", "circumferential"))

    def energy(self, surroundings, stiffness):
        return sum(
            stiffness[c] / 2 * getattr(surroundings, c) ** 2 * surroundings.ds(BASE)
            for c in stiffness
        )

    def held(self, dofs: np.ndarray, nodes: np.ndarray):
        """Held degrees of freedom, and the turned nodes (`equilibrium.Rotation`).

        dofs (n, 3) of the displacement at the nodes (n, 3) mm of the base.
        """
        from regional_lv.mechanics.equilibrium import Rotation

        angle = np.arctan2(nodes[:, 1], nodes[:, 0])
        radial, around, axial = dofs.T
        held = [
            d for c, d in zip(COMPONENTS, (radial, around, axial), strict=True) if self.holds(c)
        ]
        if math.isinf(self.compliance["circumferential"]):
            # Equilibrium leaves the rotation about the long axis free: one node is held. While the
            # base stays in its plane no load turns the heart, and the node bears nothing; a warped
            # base is turned a little (which node is held changes strains by less than 3e-4).
            held.append(around[:1])
        circle = None
        if self.holds("radial") and not self.holds("circumferential"):
            circle = nodes[:, :2]
        fixed = np.concatenate(held) if held else np.zeros(0, dtype=int)
        return fixed, Rotation(radial, around, angle, circle)


class Epicardium(Support):
    """Springs all over the epicardium along its unloaded normal: pericardium and lungs.

    section: stiffness in kPa/mm.
    """

    name = "epicardium_kpa_per_mm"

    def __init__(self, section):
        super().__init__(section)
        if not 0 <= section < math.inf:
            raise InputError(
                f"supports.{self.name}: {section} is no stiffness; give a number of 0 or more"
            )

    @property
    def springs(self):
        return {"epicardial_spring": float(self.section)}

    @property
    def holds_axially(self):
        return self.section > 0

    holds_across = holds_axially

    def energy(self, surroundings, stiffness):
        spring = stiffness["epicardial_spring"]
        return spring / 2 * surroundings.along_normal**2 * surroundings.ds(EPICARDIUM)


SUPPORTS = Registry("support", "supports", (Base, Epicardium))


def supports_from_config(section: Mapping) -> list[Support]:
    """The supports of the section `supports`. Raises InputError for what cannot be used."""
    found = [SUPPORTS[name](value) for name, value in section.items()]
    for key, way, holds in (
        ("axial", "along", "holds_axially"),
        ("radial", "across", "holds_across"),
    ):
        if not any(getattr(support, holds) for support in found):
            raise InputError(
                f"supports.base.{key}: with `free`, nothing holds the ventricle {way} its axis; "
                "hold it, give a compliance in mm/kPa, or put springs on the epicardium "
                "(supports.epicardium_kpa_per_mm)"
            )
    return found


def _compliance(key: str, value) -> float:
    words = {"held": 0.0, "free": math.inf}
    if value in words:
        return words[value]
    if isinstance(value, str) or not value >= 0:
        raise InputError(
            f"{key}: {value!r} is no support; give `held`, `free`, or a compliance in mm/kPa"
        )
    return float(value)
