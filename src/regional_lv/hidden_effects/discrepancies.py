"""Model discrepancies: ways in which a ventricle, or its measurement, differs from the study's
model and that no catalogue of inputs lists. The benchmark hides them; whoever criticises must not
take them for something else.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from scipy import optimize

from regional_lv.aha import WALLS
from regional_lv.channels import Channels
from regional_lv.emulators.reduction import VOLUME
from regional_lv.geometry.mesh import ENDOCARDIUM
from regional_lv.inputs.model import completed
from regional_lv.inputs.space import Inputs, catalogue
from regional_lv.inputs.stiffness import Stiffness, StiffnessInputs
from regional_lv.mechanics.continuation import NotConverged
from regional_lv.mechanics.loads import LOADS, Load
from regional_lv.mechanics.materials import MATERIALS
from regional_lv.quantities import QUANTITIES
from regional_lv.registry import Registry
from regional_lv.simulation.ventricles import Ventricles

SAME_VOLUME = 1e-3
"""Change of the logarithm of a stiffness at which two laws give the same volume (0.1 mL)."""

MOST_STEPS = 12
"""Of the search for that stiffness."""


class Discrepancy(ABC):
    """One discrepancy. A new one is one class and one entry in `DISCREPANCIES`.

    Attributes: name; has_stiffness, whether its ventricles have the study's inferred inputs, so
    that an interval of them can be right.
    """

    name: ClassVar[str]
    has_stiffness: ClassVar[bool] = True

    def why_not(self, channels: Channels) -> str:
        """Why ventricles of which these channels are observed cannot have it; empty if they can."""
        return ""

    @abstractmethod
    def outputs(
        self, ventricles: Ventricles, x: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, str]:
        """Outputs (D,) without noise of the ventricle at values x (K,), and what is different, in
        words.

        Raises ArithmeticError for a ventricle that cannot be inflated.
        """


class OtherLaw(Discrepancy):
    """Another material law: Guccione's for a study with another one, else that of Holzapfel and
    Ogden. Each zone is as many times stiffer than the others as before, and the wall as a whole so
    stiff that the end-diastolic volume is the same."""

    name = "other_law"
    has_stiffness = False

    def why_not(self, channels):
        return "" if VOLUME in channels.quantities else "no volume is observed"

    def outputs(self, ventricles, x, rng):
        volume = ventricles.channels.names.index(f"{VOLUME}_ml")
        wanted = ventricles.outputs(x)[volume]
        other = ventricles.altered(self._inputs(ventricles.inputs))
        values = dict(zip(ventricles.inputs.names, x, strict=True))
        start, stress = self._values(ventricles.inputs, other.inputs, values)
        found: dict[float, np.ndarray] = {}

        def too_large(log_factor: float) -> float:
            found[log_factor] = other.outputs(np.where(stress, np.exp(log_factor), 1.0) * start)
            return float(np.log(found[log_factor][volume] / wanted))

        result = optimize.root_scalar(
            too_large, x0=0.0, x1=0.2, xtol=SAME_VOLUME, maxiter=MOST_STEPS
        )
        if not result.converged:
            raise NotConverged(f"no stiffness gives the volume of {wanted:.4g} mL")
        law = other.inputs.base["material"]["law"]
        return found[min(found, key=lambda at: abs(at - result.root))], law

    @staticmethod
    def _inputs(inputs: Inputs) -> Inputs:
        """The inferred and measured inputs of the study under the other law."""
        base = inputs.base
        law = "holzapfel_ogden" if base["material"]["law"] == "guccione" else "guccione"
        parameters = StiffnessInputs(base["parameters"]["zones"], law).spec()
        material = {**base["material"], "law": law, "constants": {}, "reference": {}}
        model = completed({**base, "material": material, "parameters": parameters})
        roles = dict(zip(inputs.names, inputs.roles, strict=True))
        kept = {name for name, role in roles.items() if role.kind == "measured"}
        every = catalogue(model)
        return Inputs(
            model, [e for e in every if isinstance(e, Stiffness) or e.name in kept], roles
        )

    @staticmethod
    def _values(
        inputs: Inputs, other: Inputs, values: Mapping[str, float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Values of the other law's inputs, and which of them all stresses are proportional to."""
        laws = (MATERIALS[each.base["material"]["law"]] for each in (inputs, other))
        factors = [[factor.name for factor in law.factors] for law in laws]
        start, stress = [], []
        for each in other:
            own = each.name
            if isinstance(each, Stiffness):
                own = f"{factors[0][factors[1].index(each.factor)]}_{each.zone}"
            start.append(values.get(own, 1.0))
            stress.append(isinstance(each, Stiffness) and each.stress_power == 1)
        return np.array(start), np.array(stress)


class SeptalFibres(Discrepancy):
    """A septum with other fibres: helix angles there are 20 degrees larger, or smaller, at all
    depths (a tenth of what they change by through the wall)."""

    name = "septal_fibres"
    angle_deg = 20.0

    def outputs(self, ventricles, x, rng):
        angle = float(rng.choice((-1, 1)) * self.angle_deg)
        fibres = {"segment_helix_deg": dict.fromkeys(WALLS["septal"], angle)}
        other = ventricles.altered(changed(ventricles.inputs, "fibres", fibres))
        return other.outputs(x), f"{angle:+g} deg"


@LOADS.add
class HydrostaticPressure(Load):
    """What a column of blood along the axis adds to the cavity's pressure; `size` is how much more
    the apex bears than the base. Half way between them it adds nothing.

    It follows the wall. Its potential is minus the integral of p over the cavity, p its pressure at
    a height: by the divergence theorem that of Q n_z over the endocardium, with Q' = p, and with
    Q = 0 in the plane of the base, which closes the cavity.
    """

    name = "hydrostatic_mmhg"

    def potential(self, surroundings, size):
        from regional_lv.mechanics.equilibrium import deformation_gradient, deformed_normal

        lowest = float(surroundings.domain.geometry.x[:, 2].min())
        height = surroundings.place[2] + surroundings.u[2]
        integral = size * (height**2 - lowest * height) / (2 * lowest)
        normal = deformed_normal(deformation_gradient(surroundings.u), surroundings.domain)
        return integral * normal[2] * surroundings.ds(ENDOCARDIUM)


class PressureGradient(Discrepancy):
    """A cavity pressure that differs from base to apex: by that of a column of blood as long as the
    ventricle, with the apex below or above."""

    name = "pressure_gradient"
    size_mmhg = 6.0
    """Of 77 mm of blood, 1,060 kg/m3."""

    def outputs(self, ventricles, x, rng):
        size = float(rng.choice((-1, 1)) * self.size_mmhg)
        load = {HydrostaticPressure.name: size}
        other = ventricles.altered(changed(ventricles.inputs, "loading", load))
        return other.outputs(x), f"{size:+g} mmHg from base to apex"


class SmoothBias(Discrepancy):
    """A bias of the measurement which is smooth over the wall: of one direction of strain, once up
    and down around the ventricle, larger at one end of it than at the other."""

    name = "smooth_bias"
    size = 0.02
    """Root mean square over the segments."""

    def outputs(self, ventricles, x, rng):
        channels = ventricles.channels
        quantity = str(rng.choice(_strains(channels)))
        field = self._field(rng)
        outputs = ventricles.outputs(x)
        for i, channel in enumerate(channels):
            if channel.quantity == quantity and channel.segment is not None:
                outputs[i] += field[channel.segment - 1]
        return outputs, quantity

    def why_not(self, channels):
        return "" if _strains(channels) else "no strain is observed"

    def _field(self, rng: np.random.Generator) -> np.ndarray:
        """(17,), by AHA segment."""
        angle, level = _places()
        slope, phase = rng.uniform(-1, 1), rng.uniform(0, 2 * np.pi)
        field = (1 + slope * level) * np.cos(angle - phase)
        return self.size * field / np.sqrt(np.mean(field**2))


def _strains(channels: Channels) -> list[str]:
    return [name for name in channels.quantities if QUANTITIES[name].is_strain]


def _places() -> tuple[np.ndarray, np.ndarray]:
    """Angle (rad) of the middle of each AHA segment around the axis, and its level from -1 (base)
    to 1 (apex); (17,)."""
    six, four = np.arange(6) * np.pi / 3, np.arange(4) * np.pi / 2
    angle = np.concatenate([six, six, four, [0.0]])
    return angle, np.repeat([-1.0, -1 / 3, 1 / 3, 1.0], [6, 6, 4, 1])


def changed(inputs: Inputs, section: str, more: Mapping) -> Inputs:
    """The same inputs of a model with more keys in one section."""
    base = {**inputs.base, section: {**inputs.base[section], **more}}
    return Inputs(base, inputs, dict(zip(inputs.names, inputs.roles, strict=True)))


DISCREPANCIES = Registry(
    "model discrepancy",
    "criticism.benchmark",
    (OtherLaw(), SeptalFibres(), PressureGradient(), SmoothBias()),
)
"""By name."""
