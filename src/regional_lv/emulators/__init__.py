"""Emulators by name.

A new emulator is one file in this folder, one entry in `REGISTRY` (the test suite then covers it),
and its settings in `config.sections.settings`. A plugin adds one with `REGISTRY.add` and says
its settings itself (`base.Emulator`). Names and labels are known without importing torch, which
takes seconds.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from regional_lv.emulators.architecture import Architecture
from regional_lv.registry import Lazy, Registry

if TYPE_CHECKING:
    from regional_lv.emulators.base import Emulator


@dataclass(frozen=True)
class Listed(Lazy):
    """An emulator of the package, and what it is."""

    architecture: Architecture


REGISTRY = Registry(
    "emulator",
    "emulators.names",
    (
        Listed(
            "exact_gp",
            "regional_lv.emulators.exact_gp:ExactGP",
            Architecture("Exact GP", "GP", "global", "multi-output"),
        ),
        Listed(
            "gradient_gp",
            "regional_lv.emulators.gradient_gp:GradientGP",
            Architecture("Gradient GP", "GP", "global", "multi-output"),
        ),
        Listed(
            "joint_gp",
            "regional_lv.emulators.joint_gp:JointGP",
            Architecture("Joint GP", "GP", "global", "multi-output"),
        ),
    ),
    listed_in="regional_lv.paper.emulators:EMULATORS",
)
"""Name in the configuration -> class."""


OF_INPUTS = "joint_gp"
"""The one that learns from simulations over all inputs, and from nothing else."""


LEAST_WITH_SENSITIVITIES = 10
"""Simulations with sensitivities that an emulator of any number of parameters can learn from: they
say what each parameter does, and enough of them are left out to tell the error."""


def least_simulations(inputs: int, with_sensitivities: bool) -> int:
    """Simulations that an emulator of so many parameters needs; with_sensitivities: whether it
    learns from them, too."""
    return min(inputs + 2, LEAST_WITH_SENSITIVITIES) if with_sensitivities else inputs + 2


def create(name: str, settings: dict | None = None) -> "Emulator":
    """A new emulator. Raises InputError for a name that is not registered."""
    return REGISTRY[name](**(settings or {}))


def load(path: str | Path) -> "Emulator":
    """Whichever emulator a file holds."""
    import torch

    content = torch.load(path, weights_only=True)
    return REGISTRY[content["emulator"]].from_content(content, path)


def architecture_of(name: str) -> Architecture:
    """What kind of emulator it is. Raises InputError for a name that is not registered."""
    return REGISTRY.entry(name).architecture


def label_of(name: str) -> str:
    """What an emulator is called in figures and tables."""
    return architecture_of(name).label
