"""The strain energy against formulas derived by hand: dolfinx differentiates what is written here,
so an error in the energy would be in everything and show nowhere else."""

import numpy as np
import pytest
import ufl

from regional_lv.mechanics.material import HolzapfelOgden, strain_energy

REFERENCE = HolzapfelOgden(0.24, 5.1, 7.2, 6.5, 1.3, 2.4, 0.41, 4.7)
FIBRE = np.array([0.8, 0.6, 0.0])
SHEET = np.array([-0.48, 0.64, 0.6])
C_A, C_B = 1.7, 0.6


def energy(F, reference=REFERENCE):
    value = strain_energy(
        ufl.as_matrix(F.tolist()),
        ufl.as_vector(FIBRE.tolist()),
        ufl.as_vector(SHEET.tolist()),
        reference,
        C_A,
        C_B,
    )
    return float(value(()))


def stress(F):
    """First Piola-Kirchhoff stress by hand: sum of (d energy / d I) (d I / d F)."""
    m = REFERENCE
    C = F.T @ F
    first = C_A * m.a * np.exp(C_B * m.b * (np.trace(C) - 3)) * F
    P = first - C_A * m.a * np.linalg.inv(F).T
    for d, a, b in ((FIBRE, m.a_f, m.b_f), (SHEET, m.a_s, m.b_s)):
        e = max(d @ C @ d - 1, 0.0)
        P += 2 * C_A * a * e * np.exp(C_B * b * e**2) * F @ np.outer(d, d)
    i8 = FIBRE @ C @ SHEET
    mixed = np.outer(FIBRE, SHEET) + np.outer(SHEET, FIBRE)
    return P + C_A * m.a_fs * i8 * np.exp(C_B * m.b_fs * i8**2) * F @ mixed


def random_gradient(seed):
    return np.eye(3) + 0.15 * np.random.default_rng(seed).normal(size=(3, 3))


def rotation(seed):
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


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


@pytest.mark.parametrize("seed", range(4))
def test_energy_does_not_see_rotations_of_space(seed):
    F = random_gradient(seed)
    assert energy(rotation(seed) @ F) == pytest.approx(energy(F), rel=1e-12)


def test_reference_and_rotated_states_are_free_of_energy_and_stress():
    for F in (np.eye(3), rotation(1)):
        assert energy(F) == pytest.approx(0.0, abs=1e-13)
        np.testing.assert_allclose(stress(F), 0.0, atol=1e-13)


def test_fibres_and_sheets_carry_no_compression():
    shortened = np.eye(3) - 0.1 * np.outer(FIBRE, FIBRE)
    without = REFERENCE._replace(a_f=0.0)
    assert energy(shortened) == pytest.approx(energy(shortened, without))
    lengthened = np.eye(3) + 0.1 * np.outer(FIBRE, FIBRE)
    assert energy(lengthened) > 2 * energy(shortened)


@pytest.mark.parametrize("direction", [FIBRE, SHEET])
def test_fibres_and_sheets_begin_to_carry_smoothly(direction):
    """At the switch energy and stress are continuous: they begin as the square and the first
    power of I4 - 1."""
    h = 1e-5
    m = REFERENCE
    a = m.a_f if direction is FIBRE else m.a_s
    longer, shorter = (np.eye(3) + s * h * np.outer(direction, direction) for s in (1, -1))
    matrix_only = m._replace(a_f=0.0, a_s=0.0)
    for F, carried in ((longer, C_A * a / 2 * (2 * h) ** 2), (shorter, 0.0)):
        assert energy(F) - energy(F, matrix_only) == pytest.approx(carried, rel=1e-4, abs=1e-15)


def test_energy_of_a_stretch_by_hand():
    """Fibre stretched by 1.2 at constant volume, across it 1.2^-1/2: numbers of a calculator."""
    across = np.eye(3) - np.outer(FIBRE, FIBRE)
    F = 1.2 * np.outer(FIBRE, FIBRE) + 1.2**-0.5 * across
    # I1 = 1.44 + 2 / 1.2, I4 = 1.44 in the fibre, 1 / 1.2 in the sheet, I8 = 0, J = 1.
    matrix = 1.7 * 0.24 / (2 * 0.6 * 5.1) * (np.exp(0.6 * 5.1 * 0.10666667) - 1)
    fibre = 1.7 * 7.2 / (2 * 0.6 * 6.5) * (np.exp(0.6 * 6.5 * 0.1936) - 1)
    assert energy(F) == pytest.approx(matrix + fibre, rel=1e-7)


def test_global_factors_scale_the_two_groups():
    material = {f"{n}_kpa" if n[0] == "a" else n: v for n, v in REFERENCE._asdict().items()}
    scaled = HolzapfelOgden.from_config(material | {"factor_a": 2.0, "factor_b": 0.5})
    for name, value in REFERENCE._asdict().items():
        assert getattr(scaled, name) == pytest.approx(value * (2.0 if name[0] == "a" else 0.5))
