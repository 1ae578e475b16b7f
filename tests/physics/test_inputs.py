"""One simulator for all inputs: the present one inside it, and exact derivatives."""

import numpy as np
import pytest

from regional_lv.geometry.mesh import read_mesh
from regional_lv.inputs.model import model_of
from regional_lv.inputs.space import Inputs, catalogue, stencil
from regional_lv.mechanics.continuation import Effort, NotConverged, Solver
from regional_lv.mechanics.problem import Problem
from regional_lv.quantities import QUANTITIES
from regional_lv.simulation.batches import make_simulator
from regional_lv.verification.input_derivatives import (
    EVERYTHING_ON,
    TIGHT,
    check_derivatives,
)

from .conftest import PRESSURE, THETA

# Segments that stand for all seventeen: a free wall, a septal one, the apex.
SEGMENTS = (1, 9, 17)


def made(mesh, config):
    model = model_of(config)
    members = [
        each
        for each in catalogue(model)
        if getattr(each, "segment", None) is None or each.segment in SEGMENTS
    ]
    return Solver(Problem(read_mesh(mesh), Inputs(model, members)), config["solver"] | TIGHT)


@pytest.fixture(scope="module")
def solver(small_mesh, smoke_config):
    return made(small_mesh, smoke_config)


@pytest.fixture(scope="module")
def twisted(small_mesh, smoke_config):
    """One that observes every quantity, also those that turn on the unloaded shape itself."""
    return made(small_mesh, merged(smoke_config, {"observables": {"quantities": list(QUANTITIES)}}))


def values(problem, **given):
    """Nominal values, but for theta and what is given."""
    at = dict(zip(problem.inputs.names, problem.inputs.nominal, strict=True))
    at |= dict(zip(problem.parameters.names, THETA, strict=True)) | given
    return np.array(list(at.values()))


@pytest.fixture(scope="module")
def held(solver):
    return solver.inflate(values(solver.simulator), PRESSURE, Effort())


def test_the_present_simulator_is_inside(solver, held, simulator, physics):
    """To round-off: held nodes are those of the base, and what is off adds nothing."""
    state = Solver(simulator, physics["solver"] | TIGHT).inflate(THETA, PRESSURE, Effort())
    solver.simulator.set(held.theta, PRESSURE)
    found = solver.simulator.observables(held.w)[0]
    np.testing.assert_allclose(found, simulator.observables(state.w)[0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("given", "section", "tolerance"),
    [
        ({"septal_load": 3.0}, {"loading": {"septal_pressure_mmhg": 3.0}}, 1e-8),
        ({"epicardial_support": 0.05}, {"supports": {"epicardium_kpa_per_mm": 0.05}}, 1e-8),
        ({"fibre_rotation": 6.0}, {"fibres": {"rotation_deg": 6.0}}, 1e-8),
        ({"wall_thickness": 1.1}, {"geometry": {"wall_thickness_scale": 1.1}}, 1e-8),
        ({"compressibility": 0.02}, {"material": {"bulk_modulus_kpa": 50.0}}, 1e-8),
        # Springs at the nodes of the base here, at its Gauss points there.
        ({"basal_motion": 3.0}, {"supports": {"base": {"radial": 3.0}}}, 3e-3),
    ],
)
def test_sizes_are_other_programs_of_the_present_simulator(
    solver, held, small_mesh, physics, given, section, tolerance
):
    problem = solver.simulator
    state = solver.newton(held.w, values(problem, **given), PRESSURE, Effort())
    found = problem.observables(state.w)[0]
    other = merged(physics, section)
    present = make_simulator(small_mesh, other)
    reached = Solver(present, physics["solver"] | TIGHT).inflate(THETA, PRESSURE, Effort())
    expected = present.observables(reached.w)[0]
    assert found[0] == pytest.approx(expected[0], rel=tolerance)
    np.testing.assert_allclose(found[1:], expected[1:], atol=10 * tolerance)


def merged(base, changed):
    return base | {
        key: merged(base[key], value) if isinstance(value, dict) else value
        for key, value in changed.items()
    }


@pytest.mark.parametrize("given", [{"segment_rotation": 1.0}, EVERYTHING_ON], ids=["held", "all"])
def test_derivatives_about_every_input(twisted, given):
    """Where the base is held, free around the axis and nothing else acts, derivatives are those at
    the ends of ranges. Segments counted from where mesh lines are have none at no rotation."""
    problem = twisted.simulator
    start = twisted.inflate(values(problem, **given), PRESSURE, Effort())
    table = check_derivatives(twisted, start)
    assert len(table) == len(problem.inputs)
    worse = table[table["error"] > 1e-4]
    assert worse.empty, worse.to_string()


@pytest.mark.parametrize("given", [{}, EVERYTHING_ON], ids=["held", "all"])
def test_the_change_along_a_direction_is_that_of_all_derivatives(solver, given):
    """Of the displacements, of all inputs at once and into their ranges: what the way from one
    solution to another is predicted by."""
    problem = solver.simulator
    state = solver.inflate(values(problem, **given), PRESSURE, Effort())
    units = problem.coordinates.units
    direction = np.random.default_rng(3).uniform(0.5, 1.5, len(units)) * units
    found = solver.change_along(state, direction)[problem.displacement_dofs]
    expected = (direction @ problem.tangents(state))[problem.displacement_dofs]
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize("given", [{}, EVERYTHING_ON], ids=["held", "all"])
def test_changes_of_the_residual_are_those_of_differences(solver, given):
    """Away from equilibrium, too, where forces on held nodes count; but for the node that is held
    against a rotation of the whole, which bears nothing in equilibrium."""
    problem = solver.simulator
    inputs, at = problem.inputs, values(problem, **given)
    rng = np.random.default_rng(5)
    w = 0.01 * rng.normal(size=problem.size)
    problem.set(at, PRESSURE)
    w = problem.retract(w)
    perturbation = problem._perturbation(at)
    problem._place(w)
    exact = problem._resisted(problem._changes(perturbation))
    exact[:, problem._base_dofs] += problem._changes_at_base(w, perturbation)
    for k, each in enumerate(inputs):
        if each.changes == "observables":
            assert not exact[k].any()
            continue
        here, low, high = (each.scale(float(v)) for v in (at[k], each.low, each.high))
        numeric = np.zeros(problem.size)
        for offset, weight in stencil(here, 1e-4 * (high - low), low, high):
            x = at.copy()
            x[k] = each.scale.inverse(here + offset)
            problem.set(x, PRESSURE)
            numeric += weight * problem.residual(w)
        numeric[problem._y[0]] = exact[k, problem._y[0]]
        scale = np.abs(numeric).max()
        np.testing.assert_allclose(exact[k], numeric, atol=2e-4 * scale, err_msg=each.name)
    problem.set(at, PRESSURE)


def test_a_shape_without_a_smooth_wall_is_not_converged(solver, held):
    """As one on the way between two others may be; it ends no job."""
    problem = solver.simulator
    problem.set(held.theta, PRESSURE)
    places, at, effort = problem.mesh.points, values(problem, wall_thickness_9=0.3), Effort()
    with pytest.raises(NotConverged, match="no smooth surface"):
        solver.newton(held.w, at, PRESSURE, effort)
    # Neither is it solved at another load as the shape before it, which is left as it was.
    with pytest.raises(NotConverged, match="no smooth surface"):
        solver.inflate(at, PRESSURE, effort)
    assert effort.newton_steps == 0
    problem.set(held.theta, PRESSURE)
    assert problem.mesh.points is places


def test_solutions_of_many_vectors_are_those_of_each(solver, held):
    problem = solver.simulator
    problem.set(held.theta, PRESSURE)
    problem.factorise(held.w)
    vectors = np.random.default_rng(3).normal(size=(4, problem.size))
    each = np.stack([problem.solve(vector) for vector in vectors])
    np.testing.assert_allclose(problem.solve(vectors), each, atol=1e-10 * np.abs(each).max())


def test_a_solution_is_observed_many_times(solver, held, small_mesh, physics):
    problem = solver.simulator
    state = solver.newton(held.w, held.theta, PRESSURE, Effort())
    found, steps = problem.linearised(state), Effort()
    looks = {"layer": (0.0, 0.4), "strain_exponent": 0.0, "line_share": 1.0}
    observed, slopes = problem.observed(found, looking=looks)
    assert steps.newton_steps == 0
    present = make_simulator(small_mesh, merged(physics, {"observables": looks}))
    np.testing.assert_allclose(observed, present.observables(state.w)[0], atol=1e-12)
    present.set(THETA, PRESSURE)
    present.factorise(state.w)
    exact = present.observables(state.w, present.tangents(state))[1]
    np.testing.assert_allclose(slopes[:10], exact, atol=1e-5 * np.abs(exact).max())
