"""The benchmark and the exact solution, on meshes that a test can afford."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import ufl
from scipy.integrate import trapezoid

import regional_lv
from regional_lv.channels import Channels
from regional_lv.verification import convergence, land, mesh_study
from regional_lv.verification.body import block, join
from regional_lv.verification.input_derivatives import relative_error

PARTICIPANTS = Path(regional_lv.__file__).parent / "data" / "land_2015.csv"


@pytest.fixture(scope="module")
def benchmark(smoke_config):
    return land.run(smoke_config["solver"], beams=[(20, 2, 2)], ellipsoids=[(3, 9, 2)])


@pytest.mark.parametrize("quantity", ["tip_z_mm", "endo_apex_z_mm", "epi_apex_z_mm", "cavity_mm3"])
def test_benchmark_is_within_the_participants_range(benchmark, quantity):
    published = pd.read_csv(PARTICIPANTS)[quantity]
    (ours,) = benchmark[quantity].dropna()
    assert published.min() < ours < published.max()


def test_guccione_energy_is_the_benchmarks_formula():
    """In fibre axes Q = b_f E11^2 + b_t (E22^2 + E33^2 + 2 E23^2) + 2 b_fs (E12^2 + E13^2)."""
    F = np.eye(3) + 0.2 * np.random.default_rng(0).normal(size=(3, 3))
    E = (F.T @ F - np.eye(3)) / 2
    Q = 8 * E[0, 0] ** 2 + 2 * (E[1, 1] ** 2 + E[2, 2] ** 2 + 2 * E[1, 2] ** 2)
    Q += 8 * (E[0, 1] ** 2 + E[0, 2] ** 2)
    fibre = ufl.as_vector([1.0, 0.0, 0.0])
    value = land.guccione(ufl.as_matrix(F.tolist()), 2.0, 8.0, 2.0, 4.0, fibre)
    assert value(()) == pytest.approx(np.exp(Q) - 1, rel=1e-12)


@pytest.mark.parametrize("rotation", [0.0, 20.0])
def test_exact_tube_keeps_its_wall_and_carries_the_pressure(smoke_config, rotation):
    fibres = smoke_config["fibres"] | {"rotation_deg": rotation}
    tube = convergence.Tube(smoke_config | {"fibres": fibres})
    assert tube.pressure_at(convergence.INNER) == pytest.approx(0.0, abs=1e-12)
    assert tube.pressure_at(tube.radius) == pytest.approx(tube.pressure)
    # Work of the pressure on the cavity is the energy of the wall: both per length and angle.
    radii = np.linspace(convergence.INNER, tube.radius, 201)
    work = trapezoid([tube.pressure_at(a) * a for a in radii], radii)
    done = work * convergence.KPA_PER_MMHG
    assert done == pytest.approx(wall_energy(tube), rel=1e-4)


def test_tube_of_another_law_is_that_of_the_reference_material(smoke_config):
    other = {"law": "guccione", "constants": {}, "reference": {}}
    tube = convergence.Tube(smoke_config | {"material": smoke_config["material"] | other})
    assert tube.radius == convergence.Tube(smoke_config).radius


def wall_energy(tube):
    """Strain energy of the tube per length and angle (kPa mm^2), straight from the material."""
    R = np.linspace(convergence.INNER, convergence.OUTER, 201)
    depth = (R - convergence.INNER) / (convergence.OUTER - convergence.INNER)
    values = []
    for place, at in zip(R, depth, strict=True):
        stretch = np.sqrt(1 + tube.shift / place**2)
        helix = np.deg2rad(
            (1 - at) * tube.fibres["helix_endo_deg"]
            + at * tube.fibres["helix_epi_deg"]
            + (1 - 2 * at) * tube.fibres["rotation_deg"]
        )
        value = tube.material.energy(
            ufl.as_matrix(np.diag([1 / stretch, stretch, 1.0]).tolist()),
            ufl.as_vector([0.0, float(np.cos(helix)), float(np.sin(helix))]),
            ufl.as_vector([1.0, 0.0, 0.0]),
            tube.constants,
        )
        values.append(float(value(())) * place)
    return trapezoid(values, R)


def test_orders_of_convergence(smoke_config):
    """Theory's orders, less a half for meshes that are not yet fine."""
    orders = convergence.tube_orders(convergence.run_tube(smoke_config, (2, 4, 6)))
    assert (orders["order"] > orders["theory"] - 0.5).all(), orders


def test_order_of_a_known_sequence():
    values = [1 + 0.3 * k**-2.7 for k in (1, 2, 3)]
    ratio = (values[0] - values[1]) / (values[1] - values[2])
    assert convergence._order(ratio) == pytest.approx(2.7)
    assert np.isnan(convergence._order(1.0))


def test_bullseye_is_a_disk_of_whole_elements():
    """No point twice, no cell turned over or without area, and a node at the pole."""
    points, cells = land.bullseye(4, 8, 2)
    assert len(cells) == (16 + 4 * 4 * 8) * 2
    assert len(points) == (9**2 + 32 * 16) * 5
    corner = points[cells[:, :4]][..., :2]
    ahead = np.roll(corner, -1, axis=1)
    area = (corner[..., 0] * ahead[..., 1] - corner[..., 1] * ahead[..., 0]).sum(axis=1) / 2
    assert area.min() > 0
    assert np.hypot(*points[:, :2].T).min() == 0.0


def test_blocks_are_joined_where_they_touch():
    left, right = (block((1, 1, 1), lambda unit, s=s: unit + np.array([s, 0, 0])) for s in (0, 1))
    points, cells = join([left, right])
    assert len(points) == 45
    assert len(set(cells[0]) & set(cells[1])) == 9


@pytest.mark.parametrize("quantities", [["volume"], ["circumferential"], ["volume", "radial"]])
def test_mesh_study_of_what_is_observed(quantities):
    channels = Channels.of(quantities)
    coarse = pd.DataFrame(1.1, range(2), channels.names).assign(unknowns=9, mean_dilation=0.0)
    fine = coarse.assign(**dict.fromkeys(channels.names, 1.0))
    found = mesh_study.compare({"coarse": coarse, "fine": fine}, "fine", channels)
    summary = mesh_study.summarise(found).set_index("mesh")
    assert summary["points"].tolist() == [2, 2]
    volume, strain = summary.loc["coarse", ["volume_percent_worst", "max_strain_worst"]]
    assert volume == pytest.approx(10 if "volume" in quantities else np.nan, nan_ok=True)
    assert strain == pytest.approx(0.1 if quantities != ["volume"] else np.nan, nan_ok=True)
    assert found["channel"].astype(bool).all() == (quantities != ["volume"])


def test_a_derivative_of_what_does_not_change_is_an_error():
    nothing, wrong = np.zeros(3), np.array([0.0, 5.0, 0.0])
    assert relative_error(nothing, wrong, 1e-6) == relative_error(wrong, nothing, 1e-6) == 1.0
    assert relative_error(nothing, wrong * 1e-8, 1e-6) == 0.0
