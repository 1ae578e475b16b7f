"""The strain energy against formulas derived by hand: dolfinx differentiates what is written here,
so an error in the energy would be in everything and show nowhere else."""

import numpy as np
import pytest

from regional_lv.errors import InputError
from regional_lv.mechanics.materials import MATERIALS, material_from_config
from regional_lv.mechanics.materials.holzapfel_ogden import HolzapfelOgden
from regional_lv.testing import MaterialContract, materials
from regional_lv.testing.materials import FIBRE, SHEET, random_gradient, rotation

REFERENCE = {
    "a_kpa": 0.24,
    "b": 5.1,
    "a_f_kpa": 7.2,
    "b_f": 6.5,
    "a_s_kpa": 1.3,
    "b_s": 2.4,
    "a_fs_kpa": 0.41,
    "b_fs": 4.7,
}
C_A, C_B = 1.7, 0.6
LAW = HolzapfelOgden(REFERENCE, {"C_a": 1.0, "C_b": 1.0})


class TestRegistered(MaterialContract):
    @pytest.fixture(scope="class", params=MATERIALS)
    @classmethod
    def kind(cls, request):
        return MATERIALS[request.param]


def energy(F, **without):
    return materials.energy(LAW, F, LAW.scaled({"C_a": C_A, "C_b": C_B}) | without)


def stress(F):
    """First Piola-Kirchhoff stress by hand: sum of (d energy / d I) (d I / d F)."""
    m = REFERENCE
    C = F.T @ F
    first = C_A * m["a_kpa"] * np.exp(C_B * m["b"] * (np.trace(C) - 3)) * F
    P = first - C_A * m["a_kpa"] * np.linalg.inv(F).T
    for d, a, b in ((FIBRE, m["a_f_kpa"], m["b_f"]), (SHEET, m["a_s_kpa"], m["b_s"])):
        e = max(d @ C @ d - 1, 0.0)
        P += 2 * C_A * a * e * np.exp(C_B * b * e**2) * F @ np.outer(d, d)
    i8 = FIBRE @ C @ SHEET
    mixed = np.outer(FIBRE, SHEET) + np.outer(SHEET, FIBRE)
    return P + C_A * m["a_fs_kpa"] * i8 * np.exp(C_B * m["b_fs"] * i8**2) * F @ mixed


@pytest.mark.parametrize("seed", range(6))
def test_stress_is_the_derivative_of_the_energy(seed):
    F, h = random_gradient(seed), 1e-6
    numeric = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            step = np.zeros((3, 3))
            step[i, j] = h
            numeric[i, j] = (energy(F + step) - energy(F - step)) / (2 * h)
    np.testing.assert_allclose(numeric, stress(F), rtol=1e-6, atol=1e-7)


def test_reference_and_rotated_states_are_free_of_stress():
    for F in (np.eye(3), rotation(1)):
        np.testing.assert_allclose(stress(F), 0.0, atol=1e-13)


def test_bad_material_is_refused_with_what_there_is():
    section = {"law": "holzapfel_ogden", "constants": {"a_g_kpa": 1.0}, "reference": {}}
    with pytest.raises(InputError, match=r"material.constants.a_g_kpa.*a_f_kpa"):
        material_from_config(section)
    with pytest.raises(InputError, match=r"material.constants.b: -1 is not positive"):
        material_from_config(section | {"constants": {"b": -1.0}})
    with pytest.raises(InputError, match=r"material.reference.C_c.*C_a, C_b"):
        material_from_config(section | {"constants": {}, "reference": {"C_c": 2.0}})
    with pytest.raises(InputError, match="did you mean guccione"):
        material_from_config(section | {"law": "gucione"})


def test_fibres_and_sheets_carry_no_compression():
    shortened = np.eye(3) - 0.1 * np.outer(FIBRE, FIBRE)
    assert energy(shortened) == pytest.approx(energy(shortened, a_f_kpa=0.0))
    lengthened = np.eye(3) + 0.1 * np.outer(FIBRE, FIBRE)
    assert energy(lengthened) > 2 * energy(shortened)


@pytest.mark.parametrize("direction", [FIBRE, SHEET])
def test_fibres_and_sheets_begin_to_carry_smoothly(direction):
    """At the switch energy and stress are continuous: they begin as the square and the first
    power of I4 - 1."""
    h = 1e-5
    a = REFERENCE["a_f_kpa" if direction is FIBRE else "a_s_kpa"]
    longer, shorter = (np.eye(3) + s * h * np.outer(direction, direction) for s in (1, -1))
    for F, carried in ((longer, C_A * a / 2 * (2 * h) ** 2), (shorter, 0.0)):
        matrix = energy(F, a_f_kpa=0.0, a_s_kpa=0.0)
        assert energy(F) - matrix == pytest.approx(carried, rel=1e-4, abs=1e-15)


def test_energy_of_a_stretch_by_hand():
    """Fibre stretched by 1.2 at constant volume, across it 1.2^-1/2: numbers of a calculator."""
    across = np.eye(3) - np.outer(FIBRE, FIBRE)
    F = 1.2 * np.outer(FIBRE, FIBRE) + 1.2**-0.5 * across
    # I1 = 1.44 + 2 / 1.2, I4 = 1.44 in the fibre, 1 / 1.2 in the sheet, I8 = 0, J = 1.
    matrix = 1.7 * 0.24 / (2 * 0.6 * 5.1) * (np.exp(0.6 * 5.1 * 0.10666667) - 1)
    fibre = 1.7 * 7.2 / (2 * 0.6 * 6.5) * (np.exp(0.6 * 6.5 * 0.1936) - 1)
    assert energy(F) == pytest.approx(matrix + fibre, rel=1e-7)


def test_references_scale_the_two_groups():
    scaled = HolzapfelOgden(REFERENCE, {"C_a": 2.0, "C_b": 0.5}).scaled({"C_a": 1.0, "C_b": 1.0})
    for name, value in REFERENCE.items():
        assert scaled[name] == pytest.approx(value * (2.0 if name[0] == "a" else 0.5))
