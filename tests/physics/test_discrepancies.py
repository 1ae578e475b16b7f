"""Ventricles that differ from every model, simulated on the smallest mesh."""

import numpy as np
import pytest
import ufl

from regional_lv.geometry.mesh import ENDOCARDIUM, read_mesh
from regional_lv.hidden_effects.discrepancies import DISCREPANCIES, HydrostaticPressure, changed
from regional_lv.inputs.space import Inputs, sections_of
from regional_lv.mechanics import dolfinx_api as api
from regional_lv.mechanics.equilibrium import deformation_gradient, deformed_normal
from regional_lv.mechanics.problem import Problem
from regional_lv.mechanics.supports import Surroundings
from regional_lv.simulation.ventricles import Ventricles


@pytest.fixture(scope="module")
def ventricles(small_mesh, smoke_config):
    """One zone, and strains read at a lower load than the volume."""
    parameters = smoke_config["parameters"] | {"zones": "whole"}
    roles = {"mixed_frames": "suspected", "fibre_rotation": "suspected"}
    study = smoke_config | {"parameters": parameters, "inputs": roles}
    return Ventricles(small_mesh, Inputs.from_config(sections_of(study)))


@pytest.fixture(scope="module")
def plain(ventricles):
    return ventricles.outputs(ventricles.inputs.reference)


def test_closed_forms_are_simulated_exactly(ventricles, plain):
    """Strains at 70 % of the pressure are those of a wall that is as many times stiffer."""
    names, x = ventricles.inputs.names, ventricles.inputs.reference.copy()
    x[names.index("mixed_frames")] = 0.3
    mixed = ventricles.outputs(x)
    stiffer = ventricles.inputs.reference.copy()
    stiffer[names.index("C_a_whole")] = 1 / 0.7
    wanted = ventricles.outputs(stiffer)
    assert mixed[0] == pytest.approx(plain[0], rel=1e-8)
    np.testing.assert_allclose(mixed[1:], wanted[1:], atol=1e-8)


def test_another_law_has_the_volume_and_other_strains(ventricles, plain):
    outputs, law = DISCREPANCIES["other_law"].outputs(
        ventricles, ventricles.inputs.reference, np.random.default_rng(0)
    )
    assert law == "guccione" and outputs[0] == pytest.approx(plain[0], abs=0.2)
    assert np.abs(outputs[1:] - plain[1:]).max() > 0.01


def test_fibres_differ_in_the_septum_most(ventricles, plain):
    outputs, _ = DISCREPANCIES["septal_fibres"].outputs(
        ventricles, ventricles.inputs.reference, np.random.default_rng(0)
    )
    change = np.abs(outputs[1:] - plain[1:]).reshape(3, 17)
    septal = np.isin(np.arange(1, 18), (2, 3, 8, 9, 14))
    assert change[:, septal].mean() > 3 * change[:, ~septal].mean() > 0


def test_fibres_that_differ_everywhere_are_another_rule(ventricles, small_mesh):
    """Turned by as much in all segments they are those of other angles at both surfaces."""
    reference, base = ventricles.inputs.reference, ventricles.inputs.base
    turned = {"segment_helix_deg": dict.fromkeys(range(1, 18), 10.0)}
    ends = {key: base["fibres"][key] + 10.0 for key in ("helix_endo_deg", "helix_epi_deg")}
    residuals = []
    for more in ({}, turned, ends):
        inputs = changed(ventricles.inputs, "fibres", more).simulated
        problem = Problem(read_mesh(small_mesh), inputs)
        problem.set(reference[ventricles.inputs.are_simulated], 8.0)
        x = problem.displacement_nodes
        w = np.zeros(problem.size)
        w[problem.displacement_dofs] = 1e-3 * x * (x[:, [2]] - x[:, [0]])
        residuals.append(problem.residual(w))
    scale = np.abs(residuals[1]).max()
    np.testing.assert_allclose(residuals[1], residuals[2], atol=1e-9 * scale)
    assert np.abs(residuals[1] - residuals[0]).max() > 1e-2 * scale


def test_the_potential_of_a_hydrostatic_pressure_is_a_pressure(small_mesh):
    """Its derivative about a field is the work of p(z) on the deformed endocardium, with the base
    in its plane."""
    mesh = read_mesh(small_mesh)
    domain, origin = api.hexahedral_mesh(mesh.points, mesh.cells)
    space = api.mixed_space(domain, api.element_order(mesh.cells)).sub(0)
    collapsed = space.collapse()[0]
    u, v = api.fem.Function(collapsed), ufl.TestFunction(collapsed)
    tags = api.facet_tags(domain, mesh.facets[:, :4], mesh.surface)
    ds = ufl.Measure("ds", domain, subdomain_data=tags, metadata={"quadrature_degree": 8})
    u.interpolate(lambda x: np.stack([0.1 * x[0] + 1e-3 * x[2] * x[1], -0.05 * x[1], 0.08 * x[2]]))
    surroundings = Surroundings(domain, u, ds, mesh.segment[origin] - 1)
    size, lowest = 2.0, mesh.points[:, 2].min()
    work = ufl.derivative(HydrostaticPressure().potential(surroundings, size), u, v)
    height = surroundings.place[2] + u[2]
    pressure = size * (height - lowest / 2) / lowest
    direct = pressure * ufl.inner(deformed_normal(deformation_gradient(u), domain), v)
    found, wanted = (
        api.assemble_vector(np.zeros(api.dimension(collapsed)), api.compile_form(form))
        for form in (work, direct * ds(ENDOCARDIUM))
    )
    assert np.abs(wanted).max() > 1
    # Where the base's edge would leave its plane, the cavity would be open.
    free = np.ones(len(found), dtype=bool)
    for i in range(3):
        dofs, places = api.tabulated_dofs(collapsed.sub(i))
        free[dofs[np.isclose(places[:, 2], 0)]] = i < 2
    np.testing.assert_allclose(found[free], wanted[free], atol=1e-6 * np.abs(wanted).max())


def test_the_apex_bears_more_where_it_lies_below(ventricles, plain):
    load = {HydrostaticPressure.name: 6.0}
    other = ventricles.altered(changed(ventricles.inputs, "loading", load))
    more = np.abs(other.outputs(ventricles.inputs.reference)) - np.abs(plain)
    names = ventricles.channels.names
    base, apex = (
        [names.index(f"circumferential_{s:02d}") for s in segments]
        for segments in (range(1, 7), range(13, 17))
    )
    assert more[base].max() < 0 < more[apex].min()
