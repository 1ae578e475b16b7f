"""One of each from outside the package: what docs/extending.md adds, step by step."""

from typing import ClassVar

import torch
import ufl

from regional_lv.emulators import REGISTRY as EMULATORS
from regional_lv.emulators.base import Architecture, Emulator, Prediction
from regional_lv.geometry.mesh import EPICARDIUM
from regional_lv.inputs.base import KeyInput
from regional_lv.inputs.catalogue import INPUTS
from regional_lv.mechanics.loads import LOADS, Load
from regional_lv.mechanics.materials import MATERIALS, Constant, Factor, Material
from regional_lv.mechanics.supports import SUPPORTS, Support
from regional_lv.quantities import QUANTITIES, Quantity


@INPUTS.add
class SheetAtEpicardium(KeyInput):
    """The sheet angle at the epicardium alone."""

    name = "sheet_epi"
    family = "fibres"
    path = ("fibres", "sheet_epi_deg")
    parameter = "epicardial sheet angle"
    unit = "deg"
    low, high = -75.0, -15.0
    description = "Sheets of the outer wall are seen in a few hearts only."
    source = "LeGrice et al. 1995, doi 10.1152/ajpheart.1995.269.2.H571"


@MATERIALS.add
class Demiray(Material):
    """W = a / (2 b) (exp(b (I1 - 3)) - 1): the isotropic part of Holzapfel and Ogden's law."""

    name = "demiray"
    source = "Demiray 1972, doi 10.1016/0021-9290(72)90047-4; values for a test, of no tissue"
    factors = (
        Factor("C_a", "scales a", scales_stress=True),
        Factor("C_b", "scales b"),
    )
    constants = (
        Constant("a_kpa", 0.6, "kPa", "C_a", "stiffness"),
        Constant("b", 4.0, "1", "C_b", "exponent"),
    )

    def energy(self, F, fibre, sheet, constants):
        a, b = constants["a_kpa"], constants["b"]
        # The logarithm frees the unloaded state of stress.
        stretched = ufl.exp(b * (ufl.tr(F.T * F) - 3)) - 1
        return a / (2 * b) * stretched - a * ufl.ln(ufl.det(F))


@QUANTITIES.add
class Sphericity(Quantity):
    """Cavity volume over that of the sphere whose diameter is the long axis."""

    name = "sphericity"
    limits = (0.0, 2.0)
    noise = "sphericity"

    def values(self, motion, places):
        length, _ = motion.long_axis_mm
        return (motion.cavity_volume_ml * 1e3 / (torch.pi / 6 * length**3))[None]


@SUPPORTS.add
class ApicalSpring(Support):
    """Springs along the long axis over the epicardium, as if the apex were tethered.

    section: stiffness in kPa/mm.
    """

    name = "apical_spring_kpa_per_mm"

    @property
    def springs(self):
        return {"apical_spring": float(self.section)}

    @property
    def holds_axially(self):
        return self.section > 0

    def energy(self, surroundings, stiffness):
        spring = stiffness["apical_spring"]
        return spring / 2 * surroundings.axial**2 * surroundings.ds(EPICARDIUM)


@LOADS.add
class ChestPressure(Load):
    """A pressure all around the heart, as a breath held in makes it."""

    name = "chest_pressure_mmhg"

    def potential(self, surroundings, size):
        return size * surroundings.along_normal * surroundings.ds(EPICARDIUM)


@EMULATORS.add
class Quadratic(Emulator):
    """Least squares on all monomials of the logarithms up to order two."""

    name = "quadratic"
    architecture = Architecture("Quadratic", "polynomial", "global", "multi-output")
    defaults: ClassVar = {"input_transform": "log", "ridge": 1e-3}

    def _fit(self, training, seed):
        features = self._features(training.x)
        eye = torch.eye(features.shape[1], dtype=features.dtype)
        gram = features.T @ features + self.settings["ridge"] * eye
        self.weights = torch.linalg.solve(gram, features.T @ training.y)
        # Residuals of each simulation when the others alone are fitted: those of the fit are small.
        leverage = (features * torch.linalg.solve(gram, features.T).T).sum(1, keepdim=True)
        residual = (training.y - features @ self.weights) / (1 - leverage)
        self.spread = residual.T @ residual / len(residual) + 1e-9 * torch.eye(
            residual.shape[1], dtype=features.dtype
        )
        self.info = {"features": features.shape[1], "seconds": 0.0}

    def _features(self, x):
        pairs = torch.combinations(torch.arange(x.shape[-1]), with_replacement=True)
        squares = x[..., pairs[:, 0]] * x[..., pairs[:, 1]]
        return torch.cat([torch.ones_like(x[..., :1]), x, squares], dim=-1)

    def _predict(self, theta):
        mean = self._features(self.standardise(theta)) @ self.weights
        covariance = self.output_sd[:, None] * self.spread * self.output_sd
        return Prediction(
            self.output_mean + self.output_sd * mean, covariance.expand(*mean.shape, -1)
        )

    def _select(self, index):
        self.weights, self.spread = self.weights[:, index], self.spread[index][:, index]

    def _state(self):
        return {"weights": self.weights, "spread": self.spread}

    def _restore(self, state):
        self.weights, self.spread = state["weights"], state["spread"]


@INPUTS.add
class ApicalTether(KeyInput):
    """The cause that goes with the support: a heart whose apex is tethered."""

    name = "apical_tether"
    family = "supports"
    path = ("supports", "apical_spring_kpa_per_mm")
    parameter = "stiffness of the apical springs"
    unit = "kPa/mm"
    low, high = 0.0, 0.1
    stress_power, length_power = 1, -1
    description = "Springs along the axis hold the epicardium; the model of the example has few."
    source = "none: an example"
