"""The strain field against the simulator's own segment means, and a motion known exactly."""

import numpy as np
import pytest
import ufl

from regional_lv import aha
from regional_lv.criticism.hypotheses.base import with_value
from regional_lv.geometry.mesh import read_mesh
from regional_lv.mechanics import dolfinx_api as api
from regional_lv.mechanics.equilibrium import deformation_gradient
from regional_lv.mechanics.simulator import square_root
from regional_lv.simulations import make_simulator
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


def test_square_root_of_a_tensor(simulator, solved):
    """Against eigenvalues, in every cell of a solved ventricle, and where all three are equal."""
    domain = simulator.domain
    simulator.w.x.array[:] = solved.w
    u, _ = ufl.split(simulator.w)
    F = deformation_gradient(u)
    space = api.space(domain, "DG", 0, 9)
    test = ufl.TestFunction(space)
    dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": 1})  # one point in each cell

    def values(tensor):
        entries = ufl.as_vector([tensor[i, j] for i in range(3) for j in range(3)])
        form = api.compile_form(ufl.inner(entries, test) * dx)
        found = api.assemble_vector(np.zeros(9 * len(simulator.segment)), form)
        return found.reshape(-1, 3, 3)

    volume = values(ufl.Identity(3))[:, 0, 0, None, None]
    c = values(F.T * F) / volume
    eigenvalues, vectors = np.linalg.eigh(c)
    assert eigenvalues.max() > 1.5
    expected = (vectors * np.sqrt(eigenvalues)[:, None]) @ np.swapaxes(vectors, 1, 2)
    np.testing.assert_allclose(values(square_root(F.T * F)) / volume, expected, atol=1e-8)
    flat = values(square_root(4 * ufl.Identity(3) + 0 * F)) / volume
    np.testing.assert_allclose(flat, np.broadcast_to(2 * np.eye(3), flat.shape), atol=1e-8)


def test_nominal_strain_is_bounded_by_greens(small_mesh, smoke_config, solved):
    """The length of V^-1 d is at least its component along d, and a mean of roots is at most the
    root of the mean: (1 + e)^2 <= 1 + 2 E. By Hadamard and Hoelder, the product of 1 + e over three
    directions is at least one, as far as this coarse wall keeps its volume."""
    physics = with_value(smoke_config, "observables", "nominal_share", 1.0)
    green = make_simulator(small_mesh, smoke_config).observables(solved.w)
    nominal = make_simulator(small_mesh, physics).observables(solved.w)
    assert green[0] == nominal[0]
    gap = np.sqrt(1 + 2 * green[1:]) - 1 - nominal[1:]
    assert gap.min() > 0 and np.median(gap) < 0.02
    assert np.abs(green - nominal)[1:].max() > 0.05
    volume = np.prod(1 + nominal[1:].reshape(3, 17), axis=0)
    assert volume.min() > 0.99 and np.median(volume) < 1.03
