"""What every hypothesis is: one number psi that the base model holds at a special value.

Torch is imported where it is needed: every job of a run reads the catalogue.
"""

import copy
from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import cache
from typing import ClassVar

import numpy as np

from regional_lv.channels import Channel, Channels
from regional_lv.inputs.keys import value_at, with_value
from regional_lv.inputs.scales import Linear, Logarithmic, Saturating, Scale
from regional_lv.mechanics.materials import MATERIALS, material_from_config
from regional_lv.mechanics.supports import supports_from_config
from regional_lv.quantities import QUANTITIES
from regional_lv.registry import Registry

REGISTRY = Registry("hypothesis", "criticism.hypotheses")
"""Name (part of the contract with the findings) -> hypothesis. The package fills it."""


class Hypothesis(ABC):
    """A physical extension of the base model, f(theta, psi) with f(theta, base) = f(theta).

    parameter: the field's term for psi; `base` lies in the plausible range [low, high]. scale: on
    which the prior is uniform over that range, and the effect is smooth. components: the places or
    kinds that the effect can have, one of them at a time; empty for what needs no name.
    description: the physics, and which way psi works; source: the literature that the range and the
    physics come from.

    A new hypothesis is one file and one entry in `REGISTRY`: in the package's own list, or by
    `REGISTRY.add` of a plugin.
    """

    name: ClassVar[str]
    parameter: ClassVar[str]
    unit: ClassVar[str]
    description: ClassVar[str]
    source: ClassVar[str]
    base: float
    low: float
    high: float
    nodes: tuple[float, ...]
    """Of a `SimulatorHypothesis` alone."""
    scale: ClassVar[Scale] = Linear()
    components: tuple[str, ...] = ("",)
    order: ClassVar[int] = 0
    """Of several effects at once, those of a lower order act first: 0 in the ventricle and where it
    is looked at, 1 on the measure of the strains, 2 on what is reported of them."""
    signature_at: ClassVar[float | None] = None
    """Psi up to which the signature is a secant from the base value, for effects that begin unlike
    they go on; None for the derivative at the base value."""

    def why_not(self, physics: Mapping) -> str:
        """Why it cannot be tested in a study with these physics; empty if it can."""
        return ""

    def for_study(self, physics: Mapping) -> "Hypothesis":
        """The same with base and range as this study has them."""
        return self

    # What a ventricle with this effect does differently, for injecting it. The default of each is
    # to leave things as they are.

    def extend(self, physics: Mapping, value: float, component: str = "") -> Mapping:
        """The physics of the simulator with the effect."""
        return physics

    def at_load(self, psi, fraction: float):
        """The psi (float or tensor) of a heart at its full load that acts as `psi` does at a
        `fraction` of the load: springs are as many times stiffer as all other stresses."""
        return psi

    def load_fraction(self, channel: Channel, value: float) -> float:
        """Share of the end-diastolic pressure at which `channel` is observed in truth."""
        return channel.load_fraction

    def strain_exponent(self, psi, own: float):
        """Exponent (float, or a tensor as psi is) of the measure of the strains with the effect;
        `own` is the study's."""
        return own

    def noise(self, shape, value: float, rng: np.random.Generator) -> np.ndarray | None:
        """Noise of unit scale, or None where it stays Gaussian."""
        return None


class SimulatorHypothesis(Hypothesis):
    """One key of the physics, at `path`; `nodes` are the values of psi that are simulated.

    Between the base and the nodes, differences from the base model are interpolated by the
    polynomial on the `scale`.

    path: the section of the physics and the keys below it. in_the_form: whether psi is the size of
    an optional term of the weak form (a spring, a dead load, compressibility), so that the base
    model needs the term, too, to be followed from there. needs_solving: whether the effect changes
    the solution, or only what is observed of it. in_depth: whether it matters where in the wall's
    depth strains are, which a mesh of one element through the wall has wrong. slope_at_base:
    whether outputs have a derivative about psi at the base value. anchors: how many anchors are
    simulated at most, None for all of them.
    """

    path: ClassVar[tuple[str, ...]]
    in_the_form: ClassVar[bool] = False
    needs_solving: ClassVar[bool] = True
    in_depth: ClassVar[bool] = False
    slope_at_base: ClassVar[bool] = True
    anchors: ClassVar[int | None] = None

    def extend(self, physics, value, component=""):
        return with_value(physics, self.path, float(value))

    def why_not(self, physics):
        found = value_at(physics, self.path)
        if found != value_at(self.extend(physics, self.base), self.path):
            return f"{'.'.join(self.path)} is {found} already, part of the base model"
        return ""


class ChangedValue(SimulatorHypothesis):
    """Psi is added to the study's own values.

    path: as of `SimulatorHypothesis`. signs: of all keys that change, below `path`, the sign with
    which psi is added to each.
    """

    signs: ClassVar[tuple[tuple[str, int], ...]]
    base = 0.0

    def extend(self, physics, value, component=""):
        for key, sign in self.signs:
            path = (*self.path, key)
            physics = with_value(physics, path, value_at(physics, path) + sign * float(value))
        return physics

    def why_not(self, physics):
        return ""


class ScaledConstant(SimulatorHypothesis):
    """Psi multiplies one `constant` of the material law, as the study has it."""

    path = ("material", "constants")
    constant: ClassVar[str]
    base = 1.0
    scale = Logarithmic()

    def extend(self, physics, value, component=""):
        if value == self.base:
            return physics
        own = material_from_config(physics["material"]).values[self.constant]
        return with_value(physics, (*self.path, self.constant), own * float(value))

    def why_not(self, physics):
        law = physics["material"]["law"]
        if self.constant not in {constant.name for constant in MATERIALS[law].constants}:
            return f"the law {law} has no constant {self.constant}"
        return ""


class BaseSupport(SimulatorHypothesis):
    """One `component` of the base's displacement that is held in the base model, on a spring.

    Psi is the compliance, from 0 where the base is held.
    """

    component: ClassVar[str]
    unit = "mm/kPa"
    base, low = 0.0, 0.0
    scale = Saturating(1.0)  # mm/kPa, about as compliant as the base itself
    in_the_form = True
    slope_at_base = False
    signature_at = 3.0  # a hardly loosened base only gives at its edge; then all of it moves

    def __init_subclass__(cls):
        cls.path = ("supports", "base", cls.component)

    def at_load(self, psi, fraction):
        return psi * fraction

    def extend(self, physics, value, component=""):
        return physics if value == self.base else with_value(physics, self.path, float(value))

    def why_not(self, physics):
        found = value_at(physics, self.path)
        if found not in ("held", 0):
            return f"{'.'.join(self.path)} is {found}: the base is not held there"
        return ""


class ObservationHypothesis(SimulatorHypothesis):
    """The base model's solution, observed otherwise: of the wall strains."""

    needs_solving = False

    def why_not(self, physics):
        if not any(QUANTITIES[name].is_strain for name in physics["observables"]["quantities"]):
            return "no strain is observed (observables.quantities)"
        return super().why_not(physics)


class MeasureHypothesis(ObservationHypothesis):
    """Another value of a key that says which strain is reported; its base value is the study's.

    values: those of psi that are simulated, but for the base value.
    """

    values: ClassVar[tuple[float, ...]]

    def for_study(self, physics):
        found = copy.copy(self)
        found.base = float(value_at(physics, self.path))
        found.nodes = tuple(value for value in self.values if value != found.base)
        found.low, found.high = min(self.low, found.base), max(self.high, found.base)
        return found

    def why_not(self, physics):
        return super(MeasureHypothesis, self.for_study(physics)).why_not(physics)


class LayerHypothesis(ObservationHypothesis):
    """Strains of a part of the wall's depth, where the base model's are means over all of it.

    Psi is the share of the wall that is not seen.
    """

    in_depth = True
    path = ("observables", "layer")
    unit = "1"
    base, low, high = 0.0, 0.0, 1.0
    nodes = (0.5, 1.0)


class LoadHypothesis(Hypothesis):
    """Channels observed under another load than the study's, with all other effects there are: a
    closed form, as stresses scale (`pressure_scaled`)."""

    @abstractmethod
    def share(self, psi):
        """The load (...) at tensors `psi` (...), in shares of the study's."""

    def concerned(self, outputs: tuple[str, ...]) -> np.ndarray:
        """Mask (D,) of the channels observed under that load."""
        return np.ones(len(outputs), dtype=bool)

    def why_not(self, physics):
        return why_not_scaling(physics)


class ReportHypothesis(Hypothesis):
    """Outputs reported otherwise than they are: a closed form."""

    order = 2

    @abstractmethod
    def reported(self, mean, outputs: tuple[str, ...], psi):
        """What is reported (..., D) of the outputs `mean` (..., D), of these names, at tensors
        `psi` (...). Each channel depends on itself alone. Differentiable."""


class NoiseHypothesis(Hypothesis):
    """Another distribution of the noise about the base model's outputs."""


@cache  # a fit asks thousands of times
def mask_of(outputs: tuple[str, ...], quantity: str) -> np.ndarray:
    """Mask (D,) of one quantity's channels among `outputs`."""
    return Channels.parse(outputs).of_quantity(quantity)


# ------------------------------------------------------------------ effects in a configuration


def psi_and_component(value: float | Mapping) -> tuple[float, str]:
    """Of an effect as a configuration has it: a number, `{segment, multiplier}` or `{component,
    value}`. Raises KeyError for another form."""
    if not isinstance(value, Mapping):
        return float(value), ""
    if value.keys() == {"segment", "multiplier"}:
        return float(value["multiplier"]), str(value["segment"])
    if value.keys() == {"component", "value"}:
        return float(value["value"]), str(value["component"])
    raise KeyError(f"{sorted(value)} is no form of an effect")


def configured(psi: float, component: str) -> float | dict:
    """An effect as a configuration has it, the inverse of `psi_and_component`."""
    if not component:
        return psi
    if component.isdigit():
        return {"segment": int(component), "multiplier": psi}
    return {"component": component, "value": psi}


# --------------------------------------------------------------------- scaling of stresses


def pressure_scaled(parameters, theta, factor):
    """Theta (..., P) at which the pressure p does what `factor` (...) times p does at `theta`.

    parameters: the `Parameterisation` of theta. All stresses of the base model are proportional to
    some of them, which multiplied by one number together with the pressure change no displacement:
    f(theta; factor p) = f(theta with these over the factor; p).
    """
    import torch

    return torch.where(torch.as_tensor(parameters.scales_stress), theta / factor[..., None], theta)


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
