"""What tests share: the default config and one small heart, made once."""

import shutil
from pathlib import Path

import pytest
from selenium import webdriver

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


@pytest.fixture
def paths(tmp_path) -> tuple[Path, Path]:
    """Where a figure and its table go; the folder is not there yet."""
    return tmp_path / "figures" / "one.png", tmp_path / "figures" / "one.csv"


@pytest.fixture
def figures(monkeypatch) -> list:
    """Every figure that `style.save` has seen."""
    from regional_lv.plots import style

    seen, save = [], style.save

    def remember(fig, *args):
        seen.append(fig)
        save(fig, *args)

    monkeypatch.setattr(style, "save", remember)
    return seen


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


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Chromium without a window, drawing 3-D in software."""
    programs = {name: shutil.which(name) for name in ("chromium", "chromedriver")}
    absent = [name for name, path in programs.items() if path is None]
    assert not absent, f"no {' and no '.join(absent)}: install envs/debian-packages-test.txt"
    options = webdriver.ChromeOptions()
    options.binary_location = programs["chromium"]
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    for flag in (
        *("headless", "no-sandbox", "disable-dev-shm-usage", "disable-quic", "no-first-run"),
        *("use-angle=swiftshader", "enable-unsafe-swiftshader"),
        *("disable-background-networking", "disable-component-update", "disable-sync"),
        *("window-size=1200,900", f"user-data-dir={tmp_path_factory.mktemp('chromium')}"),
    ):
        options.add_argument(f"--{flag}")
    driver = webdriver.Chrome(options, webdriver.ChromeService(programs["chromedriver"]))
    yield driver
    driver.quit()
