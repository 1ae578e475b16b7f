"""What the example adds from outside, against the contracts of its kinds."""

import runpy
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import pytest

from regional_lv.registry import load_plugins, temporary
from regional_lv.testing import EmulatorContract, InputContract, MaterialContract, QuantityContract

PATH = Path(__file__).parents[2] / "config" / "examples" / "plugin.py"

with temporary():
    example = SimpleNamespace(**runpy.run_path(str(PATH)))


@pytest.fixture(scope="module", autouse=True)
def _registered():
    with temporary():
        load_plugins([PATH])
        yield


class TestQuadratic(EmulatorContract):
    plugin = example.Quadratic


class TestDemiray(MaterialContract):
    plugin = example.Demiray


class TestSphericity(QuantityContract):
    plugin = example.Sphericity


class TestSheetAtEpicardium(InputContract):
    plugin = example.SheetAtEpicardium


class TestApicalTether(InputContract):
    plugin = example.ApicalTether
    study: ClassVar = {"supports": {"apical_spring_kpa_per_mm": 0.01}}
