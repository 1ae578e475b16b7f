"""Effects in the simulator: the base model inside, exact slopes, limits that mechanics knows."""

import copy

import numpy as np
import pytest
from scipy.spatial import cKDTree

from regional_lv import aha
from regional_lv.criticism.hypotheses import REGISTRY, SimulatorHypothesis
from regional_lv.criticism.hypotheses.base import with_value
from regional_lv.criticism.planted import Ventricles, read_effects
from regional_lv.criticism.simulation import SLOPE_STEP, Extended, simulate_extension
from regional_lv.geometry.mesh import EPICARDIUM, read_mesh
from regional_lv.geometry.thickness import thickened
from regional_lv.mechanics.continuation import Effort, Solver
from regional_lv.mechanics.predictor import Predictor
from regional_lv.mechanics.segments import turned_membership
from regional_lv.simulations import make_simulator

from .conftest import PRESSURE, THETA

SIMULATED = [name for name, h in REGISTRY.items() if isinstance(h, SimulatorHypothesis)]
SLOPED = [name for name in SIMULATED if REGISTRY[name].slope_at_base]
BASAL_COMPLIANCE = ("loading", "basal_compliance_mm_per_kpa")


@pytest.fixture(scope="module")
def extended_base(small_mesh, smoke_config):
    """Solver of the base model with the terms of all effects, all of them off."""
    return Solver(make_simulator(small_mesh, smoke_config, extended=True), smoke_config["solver"])


def solve(small_mesh, physics, start):
    simulator = make_simulator(small_mesh, physics)
    solver = Solver(simulator, physics["solver"])
    return simulator, solver.newton(start.w, start.theta, start.pressure, Effort())


@pytest.mark.parametrize("name", SIMULATED)
def test_base_value_is_the_base_model(smoke_config, name):
    """The same physics, key by key: no form, no number differs."""
    hypothesis = REGISTRY[name]
    assert hypothesis.extend(smoke_config, hypothesis.base) == smoke_config


def test_terms_that_are_off_add_nothing(simulator, extended_base, solved):
    extended = extended_base.simulator
    for each in (simulator, extended):
        each.set(THETA, PRESSURE)
    moved = solved.w.copy()
    moved[simulator.displacement_dofs] *= 1.001
    residuals = [each.residual(moved) for each in (simulator, extended)]
    np.testing.assert_allclose(*residuals, rtol=0, atol=1e-11 * np.abs(residuals[0]).max())
    tangents = []
    for each in (simulator, extended):
        each.assemble(moved)
        tangents.append(each._data.copy())
    np.testing.assert_allclose(*tangents, rtol=0, atol=1e-11 * np.abs(tangents[0]).max())
    outputs = [each.observables(moved) for each in (simulator, extended)]
    np.testing.assert_allclose(*outputs, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("name", SLOPED)
def test_slope_at_the_base_is_the_change_of_the_solution(
    small_mesh, smoke_config, solver, extended_base, solved, name
):
    """d(outputs)/d(psi) from the tangent against two solutions beside the base."""
    hypothesis = REGISTRY[name]
    component = "8" if len(hypothesis.components) > 1 else ""
    extended = Extended(small_mesh, smoke_config, hypothesis, component)
    base = extended_base if extended._in_the_form else solver
    extended = Extended(small_mesh, smoke_config, hypothesis, component, base)
    start = extended.solve(solved.w, THETA, hypothesis.base, Effort())
    field, exact = extended.slope(start)
    h = SLOPE_STEP * (hypothesis.high - hypothesis.low)
    sides = []
    for sign in (1, -1):
        psi = hypothesis.base + sign * h
        state = extended.solve(start.w + sign * h * field, THETA, psi, Effort())
        sides.append(extended.simulator(psi).observables(state.w))
    numeric = (sides[0] - sides[1]) / (2 * h)
    unit = np.array([1.0] + [0.01] * 51)
    scale = np.abs(exact / unit).max()
    assert scale * (hypothesis.high - hypothesis.low) > 0.5
    np.testing.assert_allclose(numeric / unit, exact / unit, rtol=0, atol=2e-3 * scale)


@pytest.mark.parametrize("name", ["septal_load", "epicardial_support", "anisotropy"])
def test_what_resists_the_filling_makes_the_cavity_smaller(
    small_mesh, smoke_config, extended_base, solved, name
):
    extended = Extended(small_mesh, smoke_config, REGISTRY[name], "", extended_base)
    start = extended.solve(solved.w, THETA, REGISTRY[name].base, Effort())
    field, slope = extended.slope(start)
    assert slope[0] < 0
    if name == "septal_load":
        mesh, simulator = read_mesh(small_mesh), extended.simulator(0.0)
        outer = np.unique(mesh.facets[mesh.surface == EPICARDIUM])
        septal = np.unique(mesh.cells[np.isin(mesh.segment, (2, 3, 8, 9))])
        nodes = mesh.points[np.intersect1d(outer, septal)]
        nearest = cKDTree(simulator.displacement_nodes).query(nodes)[1]
        moved = field[simulator.displacement_dofs[nearest]]
        assert (nodes[:, :2] * moved[:, :2]).sum() < 0


def test_septal_load_and_springs_do_not_turn_the_ventricle(small_mesh, smoke_config, solved):
    """The node that holds the base against rotation bears nothing, whatever pushes."""
    physics = with_value(smoke_config, "loading", "septal_pressure_mmhg", 3.0)
    physics = with_value(physics, "loading", "epicardial_spring_kpa_per_mm", 0.05)
    simulator, state = solve(small_mesh, physics, solved)
    simulator._place(state.w)
    fixed = simulator.fixed
    simulator.fixed = np.zeros(0, dtype=int)
    reaction = simulator.residual(state.w)
    simulator.fixed = fixed
    held = np.intersect1d(fixed, simulator._y)
    assert len(held) == 1
    assert np.abs(reaction[held]).max() < 1e-6 * np.abs(reaction).max()


def test_a_compliant_base_lies_between_held_and_free(small_mesh, smoke_config, solved):
    volume = {}
    start = solved
    for compliance in (1e-3, 1.0, 5.0, 1e4, 1e6):
        physics = with_value(smoke_config, *BASAL_COMPLIANCE, compliance)
        simulator, start = solve(small_mesh, physics, start)
        volume[compliance] = simulator.observables(start.w)[0]
    held = make_simulator(small_mesh, smoke_config).observables(solved.w)[0]
    assert volume[1e-3] == pytest.approx(held, rel=2e-3)
    assert held < volume[1.0] < volume[1e4]
    assert volume[1e4] == pytest.approx(volume[1e6], rel=1e-4)
    spring = with_value(smoke_config, "loading", "base", "radial_spring")
    simulator, state = solve(small_mesh, spring, start)
    assert simulator.observables(state.w)[0] == pytest.approx(volume[1.0], rel=1e-9)


def test_a_stiff_bulk_is_incompressible(small_mesh, smoke_config, simulator, solved):
    outputs, dilation = {}, {}
    for bulk in (1e7, 20.0):
        physics = with_value(smoke_config, "material", "bulk_modulus_kpa", bulk)
        compressible, state = solve(small_mesh, physics, solved)
        outputs[bulk] = compressible.observables(state.w)
        dilation[bulk] = compressible.dilation(state.w)
    np.testing.assert_allclose(outputs[1e7], simulator.observables(solved.w), rtol=1e-4, atol=1e-5)
    assert dilation[1e7] == pytest.approx(simulator.dilation(solved.w), rel=1e-3)
    # What leaves the wall is volume: it thins more than its area grows.
    radial = slice(18, 35)
    assert outputs[20.0][radial].mean() > outputs[1e7][radial].mean()


def test_all_segments_stiffer_is_all_zones_stiffer(small_mesh, smoke_config, simulator, solved):
    factors = {str(number): 2.0 for number in range(1, 18)}
    twice = make_simulator(
        small_mesh, with_value(smoke_config, "material", "segment_factors", factors)
    )
    twice.set(THETA, PRESSURE)
    doubled = THETA.copy()
    doubled[0::2] *= 2
    simulator.set(doubled, PRESSURE)
    np.testing.assert_array_equal(twice.residual(solved.w), simulator.residual(solved.w))


def test_a_thicker_wall_keeps_its_cavity(small_mesh, smoke_config, simulator):
    mesh = read_mesh(small_mesh)
    outer = np.unique(mesh.facets[mesh.surface == EPICARDIUM])
    thick = thickened(mesh, 1.2)
    np.testing.assert_array_equal(
        thick.points[mesh.transmural == 0], mesh.points[mesh.transmural == 0]
    )
    inwards = thickened(mesh, 0.0).points
    before, after = (
        np.linalg.norm(p[outer] - inwards[outer], axis=1) for p in (mesh.points, thick.points)
    )
    np.testing.assert_allclose(after, 1.2 * before, rtol=1e-12)
    thicker = make_simulator(small_mesh, smoke_config | {"geometry": {"wall_thickness_scale": 1.2}})
    rest = np.zeros(simulator.size)
    assert thicker.observables(rest)[0] == pytest.approx(simulator.observables(rest)[0], rel=1e-12)
    # The outer layers are longer than the inner ones: more than a fifth is added.
    assert 1.2 < thicker.segment_volume.sum() / simulator.segment_volume.sum() < 1.4


def test_turned_segments(simulator, small_mesh, smoke_config, solved):
    """Continuous in the angle, the base at none, and no strain is lost on the way."""
    straight = simulator.observables(solved.w)
    turned = {
        angle: make_simulator(
            small_mesh, with_value(smoke_config, "observables", "segment_rotation_deg", angle)
        )
        for angle in (1e-6, 10.0)
    }
    np.testing.assert_allclose(turned[1e-6].observables(solved.w), straight, rtol=0, atol=1e-7)
    ten = turned[10.0]
    difference = ten.observables(solved.w) - straight
    assert difference[0] == 0 and np.abs(difference[[17, 34, 51]]).max() < 1e-12
    assert np.abs(difference).max() > 1e-3
    for level in aha.LEVELS.values():
        mine = np.array(level) - 1
        sums = [
            (s.observables(solved.w)[1:].reshape(3, 17) * s.segment_volume)[:, mine].sum(axis=1)
            for s in (simulator, ten)
        ]
        np.testing.assert_allclose(*sums, rtol=1e-9)


def test_turning_by_a_sector_hands_the_strains_on():
    """Twelve cells around each level, three points each; 60 degrees hand the basal ones on."""
    border = np.arange(13) * np.pi / 6
    corner = np.tile(np.stack([border[:-1], border[1:]] * 4, axis=1), (4, 1))
    place = np.tile(np.arange(12), 4)
    first, width = np.repeat([0, 6, 12, 16], 12), np.repeat([2, 2, 3, 12], 12)
    segment = first + place // width
    cell = np.repeat(np.arange(48), 3)
    angle = border[place[cell]] + np.tile([0.1127, 0.5, 0.8873], 48) * np.pi / 6
    basal = slice(0, 36)
    table = turned_membership(angle, cell, corner, segment, np.pi / 3).toarray()
    handed_on = np.roll(segment[cell[basal]], 6) == np.arange(6)[:, None]
    np.testing.assert_allclose(table[:6, basal], handed_on, atol=1e-12)
    np.testing.assert_allclose(table[16], segment[cell] == 16)
    half = turned_membership(angle, cell, corner, segment, np.pi / 6).toarray()
    np.testing.assert_allclose(half.sum(axis=0), 1.0)
    np.testing.assert_allclose(half[0, :9], [0, 0, 0, 1, 1, 1, 1, 1, 1], atol=1e-12)


# ------------------------------------------------------------------------ simulated at anchors


@pytest.fixture(scope="module")
def known(tmp_path_factory, solver, solved):
    """Files of an anchor, and of a predictor that knows two solutions."""
    folder = tmp_path_factory.mktemp("known")
    simulator, states = solver.simulator, [solved]
    along = simulator.field_sensitivities
    states.append(solver.inflate(np.ones(10), PRESSURE, Effort()))
    tangents = []
    for state in states:
        again = solver.newton(state.w, state.theta, state.pressure, Effort())
        tangents.append(along(again.w))
    theta, fields = np.stack([s.theta for s in states]), np.stack([s.w for s in states])
    Predictor.fit(theta, fields, np.stack(tangents)).save(folder / "predictor.npz")
    np.savez(folder / "batch-0000.npz", theta=theta, fields=fields, tangents=np.stack(tangents))
    return folder


def test_anchors_are_simulated_at_every_node(small_mesh, smoke_config, known, simulator, solved):
    """Rows of the base and of each node, for two components that share the base."""
    hypothesis = copy.copy(REGISTRY["focal_scar"])
    hypothesis.components = ("8", "11")
    table = simulate_extension(
        small_mesh, smoke_config, known / "batch-0000.npz", hypothesis, 1, "scar"
    )
    assert len(table) == 2 * (1 + len(hypothesis.nodes))
    assert (table["status"] == "converged").all()
    base = table[table["psi"] == hypothesis.base]
    straight = simulator.observables(solved.w)
    np.testing.assert_allclose(base[list(aha.OUTPUTS)], np.tile(straight, (2, 1)), atol=1e-7)
    # A softer segment 8 is stretched more, and no other changes as much.
    soft = table[(table["component"] == "8") & (table["psi"] < 1)].iloc[0]
    change = soft[list(aha.OUTPUTS)].to_numpy(float) - straight
    assert np.abs(change[1:18]).argmax() == 7 and change[8] < 0
    assert np.reshape(soft["sensitivity"], (52, 10)).shape == (52, 10)


def test_a_failure_is_a_row(small_mesh, smoke_config, known):
    physics = with_value(smoke_config, "solver", "max_newton_steps", 1)
    hypothesis = REGISTRY["wall_thickness"]
    table = simulate_extension(
        small_mesh, physics, known / "batch-0000.npz", hypothesis, 1, "thickness"
    )
    assert len(table) == 1 + len(hypothesis.nodes)
    assert (table.loc[table["psi"] != 1, "status"] == "failed").all()
    assert table["reason"].str.contains("Newton").any()


def test_planted_effects_are_those_of_the_closed_forms(small_mesh, smoke_config, known):
    """Pressure, mixed frames and radial scale by the simulator, against what they stand for."""
    ventricles = Ventricles(small_mesh, smoke_config, known / "predictor.npz")

    def outputs(theta, effects):
        return ventricles.outputs(theta, read_effects(effects))

    softer = THETA.copy()
    softer[0::2] *= 8 / 9
    np.testing.assert_allclose(
        outputs(THETA, {"end_diastolic_pressure": 9.0}), outputs(softer, {}), rtol=1e-6, atol=1e-7
    )
    plain = outputs(THETA, {})
    scaled = outputs(THETA, {"radial_scale": 0.8})
    np.testing.assert_allclose(scaled[18:35], 0.8 * plain[18:35])
    np.testing.assert_array_equal(np.delete(scaled, range(18, 35)), np.delete(plain, range(18, 35)))
    stiffer = THETA.copy()
    stiffer[0::2] /= 0.75
    mixed = outputs(THETA, {"mixed_frames": 0.25})
    assert mixed[0] == pytest.approx(plain[0], rel=1e-9)
    np.testing.assert_allclose(mixed[1:], outputs(stiffer, {})[1:], rtol=1e-5, atol=1e-6)
