"""What tests share: the default config and one small heart, made once."""

from pathlib import Path

import pytest

from regional_lv import config as study_config
from tests.durations import DEEP, Durations
from tests.small import Small, small

ROOT = Path(__file__).parents[1]


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", f"{DEEP}(why): only `make test-all` runs it")
    config.pluginmanager.register(Durations(config))


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


@pytest.fixture(scope="session")
def smoke_config() -> dict:
    return study_config.load(ROOT / "config" / "smoke.yaml")


@pytest.fixture(scope="session")
def small_study(root, tmp_path_factory) -> Small:
    """A study up to its screening (`tests/small.py`); tests work in copies of it."""
    return small(root, tmp_path_factory)


@pytest.fixture(scope="session")
def small_mesh(tmp_path_factory, smoke_config) -> Path:
    """The default heart on the mesh of the smoke study."""
    from regional_lv.geometry.make import make_mesh

    folder = tmp_path_factory.mktemp("mesh")
    geometry = smoke_config["geometry"]
    make_mesh(
        geometry["segments"],
        geometry["endo_apex_z_mm"],
        geometry["epi_apex_z_mm"],
        smoke_config["mesh"],
        smoke_config["fibres"],
        folder / "mesh.msh",
        folder / "mesh.vtu",
        folder / "segments.csv",
        folder / "summary.json",
    )
    return folder / "mesh.vtu"
