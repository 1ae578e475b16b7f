"""What every material law does."""

import numpy as np
import pytest

from regional_lv.mechanics.materials import MATERIALS
from regional_lv.testing.contract import Contract

FIBRE = np.array([0.8, 0.6, 0.0])
SHEET = np.array([-0.48, 0.64, 0.6])


def energy(law, F: np.ndarray, constants) -> float:
    """Of a law at a deformation gradient F (3, 3)."""
    import ufl

    fibre, sheet = (ufl.as_vector(direction.tolist()) for direction in (FIBRE, SHEET))
    return float(law.energy(ufl.as_matrix(F.tolist()), fibre, sheet, constants)(()))


def random_gradient(seed: int) -> np.ndarray:
    """A deformation gradient (3, 3) of any volume."""
    return np.eye(3) + 0.15 * np.random.default_rng(seed).normal(size=(3, 3))


def rotation(seed: int) -> np.ndarray:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


class MaterialContract(Contract):
    """Of a `mechanics.materials.Material`: needs the simulator's UFL."""

    registry = MATERIALS

    @pytest.fixture
    def law(self, kind):
        """With its reference values."""
        return kind()

    @pytest.fixture
    def constants(self, law):
        return law.scaled(dict.fromkeys(law.references, 1.3))

    @pytest.mark.parametrize("seed", range(4))
    def test_energy_does_not_see_rotations_of_space(self, law, constants, seed):
        F = random_gradient(seed)
        turned = energy(law, rotation(seed) @ F, constants)
        assert turned == pytest.approx(energy(law, F, constants), rel=1e-12)

    def test_reference_and_rotated_states_are_free_of_energy(self, law, constants):
        for F in (np.eye(3), rotation(1)):
            assert energy(law, F, constants) == pytest.approx(0.0, abs=1e-13)

    @pytest.mark.parametrize("seed", range(4))
    def test_unloaded_states_are_free_of_stress_and_stable(self, law, constants, seed):
        """Energy grows from the reference state in all isochoric directions, and to first order in
        none."""
        change = np.random.default_rng(seed).normal(size=(3, 3))
        change -= np.trace(change) / 3 * np.eye(3)
        change = (change + change.T) / 2
        rise = {}
        for h in (1e-3, -1e-3, 2e-3):
            F = np.eye(3) + h * change
            rise[h] = energy(law, F / np.cbrt(np.linalg.det(F)), constants)
        assert min(rise.values()) > 0
        assert rise[2e-3] / rise[1e-3] == pytest.approx(4, rel=0.1)

    def test_stresses_are_proportional_to_the_factor_that_says_so(self, law):
        others = [factor.name for factor in law.factors if not factor.scales_stress]
        assert [f.name for f in law.factors if f.scales_stress] == [law.stress_factor()]
        once, thrice = (
            law.scaled(dict.fromkeys(others, 1.3) | {law.stress_factor(): factor})
            for factor in (1.0, 3.0)
        )
        F = random_gradient(2)
        assert energy(law, F, thrice) == pytest.approx(3 * energy(law, F, once), rel=1e-12)
