"""What every hypothesis is: one number psi that the base model holds at a special value.

Torch is imported where it is needed: every job of a run reads the catalogue.
"""

import copy
import math
from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from regional_lv import aha


class Hypothesis(ABC):
    """A physical extension of the base model, f(theta, psi) with f(theta, base) = f(theta).

    parameter: the field's term for psi; `base` lies in the plausible range [low, high], on which
    the prior is uniform. components: the places the effect can have, one of them unknown, or just
    one without a name. description: the physics, and which way psi works; source: the literature
    that the range and the physics come from.

    A new hypothesis is one file in this folder, one entry in `REGISTRY`, and its name among the
    effects in the schema of the configuration.
    """

    name: ClassVar[str]
    parameter: ClassVar[str]
    unit: ClassVar[str]
    description: ClassVar[str]
    source: ClassVar[str]
    base: float
    low: float
    high: float
    components: tuple[str, ...] = ("",)
    signature_at: ClassVar[float | None] = None
    """Psi up to which the signature is a secant from the base value, for effects that begin unlike
    they go on; None for the derivative at the base value."""

    def why_not(self, physics: dict) -> str:
        """Why it cannot be asked of a study with these physics; empty if it can."""
        return ""

    def for_study(self, physics: dict) -> "Hypothesis":
        """The same with base and range as this study has them."""
        return self

    # What a ventricle with this effect does differently, for planting it. The default of each is
    # to leave things as they are.

    def extend(self, physics: dict, value: float, component: str = "") -> dict:
        """The physics of the simulator with the effect."""
        return physics

    def at_load(self, psi, fraction: float):
        """The psi (float or tensor) of a heart at its full load that acts as `psi` does at a
        `fraction` of the load: springs are as many times stiffer as all other stresses."""
        return psi

    def strain_fraction(self, value: float) -> float:
        """Share of the end-diastolic pressure at which the strains are observed."""
        return 1.0

    def measure(self, outputs: np.ndarray, names: tuple[str, ...], value: float) -> np.ndarray:
        """What is measured of `outputs` (..., D), called `names`."""
        return outputs

    def noise(self, shape, value: float, rng: np.random.Generator) -> np.ndarray | None:
        """Noise of unit scale, or None where it stays Gaussian."""
        return None


class SimulatorHypothesis(Hypothesis):
    """One key of the physics, `section` and `key`; `nodes` are the values that are simulated.

    Between the base and the nodes, differences from the base model are interpolated by the
    polynomial in `coordinate`, the scale on which the effect is smooth.

    needs_solving: whether the effect changes the solution, or only what is observed of it.
    anchors: how many anchors are simulated at most, None for all of them.
    """

    section: ClassVar[str]
    key: ClassVar[str]
    nodes: ClassVar[tuple[float, ...]]
    needs_solving: ClassVar[bool] = True
    slope_at_base: ClassVar[bool] = True
    anchors: ClassVar[int | None] = None

    def extend(self, physics: dict, value: float, component: str = "") -> dict:
        return with_value(physics, self.section, self.key, float(value))

    def coordinate(self, psi):
        """A smooth growing function of psi (float or tensor)."""
        return psi

    def why_not(self, physics: dict) -> str:
        found = self._found(physics)
        if found != self._found(self.extend(physics, self.base)):
            return f"{self.section}.{self.key} is {found} already, part of the base model"
        return ""

    def _found(self, physics: dict):
        return physics[self.section][self.key]


class ObservationHypothesis(SimulatorHypothesis):
    """The base model's solution, observed otherwise."""

    needs_solving = False


class TransformHypothesis(Hypothesis):
    """A closed form through the base emulator."""

    @abstractmethod
    def predict(self, emulator, theta, psi):
        """Mean (..., D) of the outputs at tensors `theta` (..., 10) and `psi` (...).

        `emulator` is the base model's. Differentiable.
        """

    def emulated_at(self, theta, psi):
        """Where (..., 10) `predict` asks the emulator; outside its box it extrapolates."""
        return theta


class NoiseHypothesis(Hypothesis):
    """Another distribution of the noise about the base model's outputs."""


def logarithm(psi):
    """Of a float or a tensor."""
    return math.log(psi) if isinstance(psi, float | int) else psi.log()


# --------------------------------------------------------------------- scaling of stresses

UNSCALED = (
    ("material", "bulk_modulus_kpa"),
    ("loading", "septal_pressure_mmhg"),
    ("loading", "epicardial_spring_kpa_per_mm"),
    ("loading", "basal_compliance_mm_per_kpa"),
)


def pressure_scaled(theta, factor):
    """Theta (..., 10) at which the pressure p does what `factor` (...) times p does at `theta`.

    All stresses of the base model are proportional to the a-type constants, so that pressure and
    C_a times one number change no displacement: f(C_a, C_b; factor p) = f(C_a / factor, C_b; p).
    """
    import torch

    return torch.where(torch.as_tensor(aha.IS_C_A), theta / factor[..., None], theta)


def why_not_scaling(physics: dict) -> str:
    """Why stresses of this study do not scale with C_a and pressure alone; empty if they do."""
    if physics["loading"]["base"] == "radial_spring":
        return "the springs of loading.base do not scale with the pressure"
    for section, key in UNSCALED:
        if physics[section].get(key):
            return f"{section}.{key} does not scale with the pressure"
    return ""


def with_value(physics: dict, section: str, key: str, value) -> dict:
    """`physics` with one key set, the rest shared."""
    changed = copy.copy(physics)
    changed[section] = physics[section] | {key: value}
    return changed
