"""The strain field against the simulator's own segment means, and a motion known exactly."""

import numpy as np
import pytest

from regional_lv import aha
from regional_lv.geometry.mesh import read_mesh
from regional_lv.strains import cell_means, nodal_displacement, strain_field


@pytest.fixture(scope="module")
def geometry(small_mesh):
    return read_mesh(small_mesh)


def test_segment_means_are_the_simulators(simulator, solved, geometry):
    """Two ways to the same integral: compiled forms there, shape functions here."""
    field = strain_field(geometry, nodal_displacement(simulator, solved.w, geometry.points))
    weighted = field[list(aha.DIRECTIONS)].mul(field["volume_mm3"], axis=0)
    volume = field.groupby("segment")["volume_mm3"].sum()
    means = weighted.groupby(field["segment"]).sum().div(volume, axis=0)
    expected = simulator.observables(solved.w)[1:].reshape(3, 17).T
    np.testing.assert_allclose(means.to_numpy(), expected, atol=1e-10)


def test_a_uniform_stretch_has_one_strain_in_every_cell(geometry):
    """x -> 1.1 x: looking back, J F^-1 = 1.1^2 I, so that every strain is (1.1^4 - 1) / 2."""
    field = strain_field(geometry, 0.1 * geometry.points)
    means = cell_means(field)
    assert means.shape == (len(geometry.cells), 3)
    np.testing.assert_allclose(means.to_numpy(), (1.1**4 - 1) / 2, rtol=1e-9)


def test_foreign_points_are_refused(simulator, solved, geometry):
    with pytest.raises(ValueError, match="not the nodes"):
        nodal_displacement(simulator, solved.w, geometry.points + 1.0)
