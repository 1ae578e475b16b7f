"""Effects in the simulator: the base model inside, exact slopes, limits that mechanics knows."""

import copy

import numpy as np
import pandas as pd
import pytest
from scipy.spatial import cKDTree

from regional_lv import aha
from regional_lv.channels import Channels
from regional_lv.criticism.hypotheses import REGISTRY, SimulatorHypothesis
from regional_lv.criticism.hypotheses.base import with_value
from regional_lv.criticism.injection import Ventricles, read_effects
from regional_lv.criticism.simulation import SLOPE_STEP, Extended, simulate_extension
from regional_lv.geometry.mesh import EPICARDIUM, read_mesh
from regional_lv.geometry.thickness import thickened
from regional_lv.mechanics.continuation import Effort, Solver
from regional_lv.mechanics.observables.segments import turned_membership
from regional_lv.mechanics.predictor import Predictor, save_predictors
from regional_lv.parameters import Parameterisation
from regional_lv.registry import temporary
from regional_lv.simulations import make_simulator
from regional_lv.strain_field import strain_field

from .conftest import PRESSURE, THETA

SIMULATED = [name for name, h in REGISTRY.items() if isinstance(h, SimulatorHypothesis)]
# Of Green's strain a line's is the tensor's; the study of these tests reports Green's.
SLOPED = [
    (n, "8" if len(REGISTRY[n].components) > 1 else "")
    for n in SIMULATED
    if REGISTRY[n].slope_at_base and n != "line_strain"
] + [("strain_measure", "material line")]
RADIAL, AXIAL, CIRCUMFERENTIAL = (
    ("supports", "base", component) for component in ("radial", "axial", "circumferential")
)
PARAMETERS = Parameterisation()
STRESS = PARAMETERS.scales_stress


@pytest.fixture(scope="module")
def extended_base(small_mesh, physics):
    """Solver of the base model with the terms of all effects, all of them off."""
    return Solver(make_simulator(small_mesh, physics, extended=True), physics["solver"])


def observed(simulator, w):
    return simulator.observables(w)[0]


def solve(small_mesh, physics, start):
    simulator = make_simulator(small_mesh, physics)
    solver = Solver(simulator, physics["solver"])
    return simulator, solver.newton(start.w, start.theta, start.pressure, Effort())


@pytest.mark.parametrize("name", SIMULATED)
def test_base_value_is_the_base_model(physics, name):
    """The same physics, key by key: no form, no number differs."""
    hypothesis = REGISTRY[name].for_study(physics)
    assert hypothesis.extend(physics, hypothesis.base) == physics


def test_terms_that_are_off_add_nothing(simulator, extended_base, solved):
    extended = extended_base.simulator
    for each in (simulator, extended):
        each.set(THETA, PRESSURE)
    moved = solved.w.copy()
    moved[simulator.displacement_dofs] *= 1.001
    residuals = [each.residual(moved) for each in (simulator, extended)]
    np.testing.assert_allclose(*residuals, rtol=0, atol=1e-10 * np.abs(residuals[0]).max())
    tangents = []
    for each in (simulator, extended):
        each.assemble(moved)
        tangents.append(each._data.copy())
    np.testing.assert_allclose(*tangents, rtol=0, atol=1e-11 * np.abs(tangents[0]).max())
    outputs = [observed(each, moved) for each in (simulator, extended)]
    np.testing.assert_allclose(*outputs, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize(("name", "component"), SLOPED)
def test_slope_at_the_base_is_the_change_of_the_solution(
    small_mesh, physics, solver, extended_base, solved, name, component
):
    """d(outputs)/d(psi) from the tangent against two solutions beside the base."""
    hypothesis = REGISTRY[name]
    base = extended_base if hypothesis.in_the_form else solver
    extended = Extended(small_mesh, physics, hypothesis, component, base)
    start = extended.solve(solved.w, THETA, hypothesis.base, 1.0, Effort())
    field, exact = extended.slope(start, 1.0)
    # No step leaves the range: beyond it a spring or a window may mean nothing.
    h = SLOPE_STEP * (hypothesis.high - hypothesis.low)
    ends = min(hypothesis.base + h, hypothesis.high), max(hypothesis.base - h, hypothesis.low)
    sides = []
    for psi in ends:
        guess = start.w + (psi - hypothesis.base) * field
        state = extended.solve(guess, THETA, psi, 1.0, Effort())
        sides.append(observed(extended.simulator(psi), state.w))
    numeric = (sides[0] - sides[1]) / (ends[0] - ends[1])
    unit = np.array([1.0] + [0.01] * 51)
    scale = np.abs(exact / unit).max()
    assert scale * (hypothesis.high - hypothesis.low) > 0.5
    np.testing.assert_allclose(numeric / unit, exact / unit, rtol=0, atol=2e-3 * scale)


@pytest.mark.parametrize(
    "name", ["septal_load", "epicardial_support", "anisotropy", "sheet_stiffness", "exponent_ratio"]
)
def test_what_resists_the_filling_makes_the_cavity_smaller(
    small_mesh, physics, solver, extended_base, solved, name
):
    hypothesis = REGISTRY[name]
    base = extended_base if hypothesis.in_the_form else solver
    extended = Extended(small_mesh, physics, hypothesis, "", base)
    start = extended.solve(solved.w, THETA, hypothesis.base, 1.0, Effort())
    field, slope = extended.slope(start, 1.0)
    assert slope[0] < 0
    if name == "septal_load":
        mesh, simulator = read_mesh(small_mesh), extended.simulator(0.0)
        outer = np.unique(mesh.facets[mesh.surface == EPICARDIUM])
        septal = np.unique(mesh.cells[np.isin(mesh.segment, (2, 3, 8, 9))])
        nodes = mesh.points[np.intersect1d(outer, septal)]
        nearest = cKDTree(simulator.displacement_nodes).query(nodes)[1]
        moved = field[simulator.displacement_dofs[nearest]]
        assert (nodes[:, :2] * moved[:, :2]).sum() < 0


def test_septal_load_and_springs_do_not_turn_the_ventricle(small_mesh, physics, solved):
    """The node that holds the base against rotation bears nothing, whatever pushes."""
    physics = with_value(physics, ("loading", "septal_pressure_mmhg"), 3.0)
    physics = with_value(physics, ("supports", "epicardium_kpa_per_mm"), 0.05)
    simulator, state = solve(small_mesh, physics, solved)
    simulator._place(state.w)
    fixed = simulator.fixed
    simulator.fixed = np.zeros(0, dtype=int)
    reaction = simulator.residual(state.w)
    simulator.fixed = fixed
    held = np.intersect1d(fixed, simulator._y)
    assert len(held) == 1
    assert np.abs(reaction[held]).max() < 1e-6 * np.abs(reaction).max()


def test_a_compliant_base_lies_between_held_and_free(small_mesh, physics, solved):
    volume = {}
    start = solved
    for compliance in (1e-3, 1.0, 5.0, 1e4, 1e6):
        simulator, start = solve(small_mesh, with_value(physics, RADIAL, compliance), start)
        volume[compliance] = observed(simulator, start.w)[0]
    held = observed(make_simulator(small_mesh, physics), solved.w)[0]
    assert volume[1e-3] == pytest.approx(held, rel=2e-3)
    assert held < volume[1.0] < volume[1e4]
    assert volume[1e4] == pytest.approx(volume[1e6], rel=1e-4)


def test_a_base_that_moves_along_the_axis_strains_where_its_sectors_differ(
    small_mesh, physics, simulator, solved
):
    """Near held at a small compliance. The mean of the axial motion strains nothing: from a
    compliance of 5 to 10 the base moves on by about a valve plane's traction times 5 mm/kPa, and
    outputs change by less than in the first half millimetre."""
    held, found, start = observed(simulator, solved.w), {}, solved
    for psi in (1e-3, 1.0, 5.0, 10.0):
        extended = REGISTRY["basal_axial"].extend(physics, psi)
        moving, start = solve(small_mesh, extended, start)
        found[psi] = observed(moving, start.w)
    unit = np.array([1.0] + [0.01] * 51)
    size = {psi: np.abs((value - held) / unit).max() for psi, value in found.items()}
    assert size[1e-3] < 0.02 * size[10.0]
    assert size[1.0] > 0.5
    assert np.abs((found[10.0] - found[5.0]) / unit).max() < size[1.0]


def test_springs_around_the_base_hold_it_in_the_end(small_mesh, physics, simulator, solved):
    """From free to held, and a wall that shears less takes in less."""
    free, volume, start = observed(simulator, solved.w), {}, solved
    for psi in (1e-3, 1.0, 10.0, 1e3):
        extended = REGISTRY["basal_twist"].extend(physics, psi)
        twisting, start = solve(small_mesh, extended, start)
        volume[psi] = observed(twisting, start.w)[0]
    around = with_value(physics, CIRCUMFERENTIAL, "held")
    held, state = solve(small_mesh, around, start)
    volume["held"] = observed(held, state.w)[0]
    assert volume[1e-3] == pytest.approx(free[0], abs=0.01 * abs(free[0] - volume["held"]))
    assert volume[1e3] == pytest.approx(volume["held"], abs=0.02 * abs(free[0] - volume["held"]))
    assert free[0] > volume[1.0] > volume[10.0] > volume["held"]


def test_a_stiff_bulk_is_incompressible(small_mesh, physics, simulator, solved):
    outputs, dilation = {}, {}
    for bulk in (1e7, 20.0):
        soft = with_value(physics, ("material", "bulk_modulus_kpa"), bulk)
        compressible, state = solve(small_mesh, soft, solved)
        outputs[bulk] = observed(compressible, state.w)
        dilation[bulk] = compressible.dilation(state.w)
    np.testing.assert_allclose(outputs[1e7], observed(simulator, solved.w), rtol=1e-4, atol=1e-5)
    assert dilation[1e7] == pytest.approx(simulator.dilation(solved.w), rel=1e-3)
    # What leaves the wall is volume: it thins more than its area grows.
    radial = slice(18, 35)
    assert outputs[20.0][radial].mean() > outputs[1e7][radial].mean()
    # The map of the strains is of the same wall (`compressible` is the soft one).
    moved, allowed = compressible.displacement(state.w), compressible.wall_dilation(state.w)
    field = strain_field(compressible.observer, moved, allowed)
    means = (
        field.assign(weighted=field["radial"] * field["volume_mm3"])
        .groupby("segment")[["weighted", "volume_mm3"]]
        .sum()
    )
    means = means["weighted"] / means["volume_mm3"]
    np.testing.assert_allclose(means, outputs[20.0][radial], rtol=1e-9)


def test_all_segments_stiffer_is_all_zones_stiffer(small_mesh, physics, simulator, solved):
    factors = {str(number): 2.0 for number in range(1, 18)}
    twice = make_simulator(
        small_mesh, with_value(physics, ("material", "segment_factors"), factors)
    )
    twice.set(THETA, PRESSURE)
    doubled = np.where(STRESS, 2 * THETA, THETA)
    simulator.set(doubled, PRESSURE)
    np.testing.assert_array_equal(twice.residual(solved.w), simulator.residual(solved.w))


def test_a_thicker_wall_keeps_its_cavity(small_mesh, physics, simulator):
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
    thicker = make_simulator(
        small_mesh, with_value(physics, ("geometry", "wall_thickness_scale"), 1.2)
    )
    rest = np.zeros(simulator.size)
    assert observed(thicker, rest)[0] == pytest.approx(observed(simulator, rest)[0], rel=1e-12)
    # The outer layers are longer than the inner ones: more than a fifth is added.
    more, less = (each.observer.wall.volume.sum() for each in (thicker, simulator))
    assert 1.2 < more / less < 1.4


def test_turned_segments(simulator, small_mesh, physics, solved):
    """Continuous in the angle, the base at none, and no strain is lost on the way."""
    straight = observed(simulator, solved.w)
    turned = {
        angle: make_simulator(
            small_mesh, with_value(physics, ("observables", "segment_rotation_deg"), angle)
        )
        for angle in (1e-6, 10.0)
    }
    np.testing.assert_allclose(observed(turned[1e-6], solved.w), straight, rtol=0, atol=1e-7)
    ten = turned[10.0]
    difference = observed(ten, solved.w) - straight
    assert difference[0] == 0 and np.abs(difference[[17, 34, 51]]).max() < 1e-12
    assert np.abs(difference).max() > 1e-3
    volumes = []
    for angle in (0.0, 10.0):
        # What a point counts for in a segment is its share times its volume over the segment's.
        wall = ten.observer.wall
        shares = wall.shares((0.0, 1.0), angle).matrix.T.toarray()
        volumes.append(np.linalg.lstsq(shares, wall.volume, rcond=None)[0])
    for level in aha.LEVELS.values():
        mine = np.array(level) - 1
        sums = [
            (observed(s, solved.w)[1:].reshape(3, 17) * volume)[:, mine].sum(axis=1)
            for s, volume in zip((simulator, ten), volumes, strict=True)
        ]
        np.testing.assert_allclose(*sums, rtol=1e-9)


@pytest.mark.parametrize("name", ["endocardial_sampling", "epicardial_sampling"])
def test_layers_shrink_to_their_surface(small_mesh, physics, simulator, solved, name):
    """Filling strains the inner wall more: strains grow, or shrink, with the share not seen; and
    they get to the surface without a jump."""
    whole = observed(simulator, solved.w)
    found = {
        psi: observed(make_simulator(small_mesh, REGISTRY[name].extend(physics, psi)), solved.w)
        for psi in (0.5, 0.999, 1.0)
    }
    towards = 1 if name == "endocardial_sampling" else -1
    size = [np.abs(v[1:18]).mean() for v in (whole, found[0.5], found[1.0])]
    assert (towards * np.diff(size) > 0).all()
    np.testing.assert_allclose(found[0.999], found[1.0], rtol=0, atol=2e-3)
    assert all(value[0] == whole[0] for value in found.values())


def test_measures_are_those_of_their_stretches(small_mesh, physics, simulator, solved):
    """Psi is the exponent: smaller ones report smaller strains, and about the nominal strain the
    material line is longer than the tensor's component says."""
    green = observed(simulator, solved.w)
    found = {
        n: observed(
            make_simulator(small_mesh, REGISTRY["strain_measure"].extend(physics, n)), solved.w
        )
        for n in (-2.0, 0.0, 1.0, 2.0)
    }
    np.testing.assert_allclose(found[2.0], green, rtol=1e-12)
    assert (np.diff(np.stack([v[1:] for v in found.values()]), axis=0) > 0).all()
    nominal = with_value(physics, ("observables", "strain_exponent"), 1.0)
    lines = REGISTRY["line_strain"].for_study(nominal)
    assert lines.why_not(nominal) == "" and REGISTRY["line_strain"].why_not(physics)
    line = observed(make_simulator(small_mesh, lines.extend(nominal, 1.0)), solved.w)
    half = observed(make_simulator(small_mesh, lines.extend(nominal, 0.5)), solved.w)
    assert ((line - found[1.0])[1:] > 0).all()
    kind = REGISTRY["strain_measure"].extend(physics, 1.0, "material line")
    np.testing.assert_array_equal(observed(make_simulator(small_mesh, kind), solved.w), line)
    np.testing.assert_allclose(half, (line + found[1.0]) / 2, atol=1e-12)


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


@pytest.mark.parametrize(
    "lines", [range(0, 361, 15), [0, 30, 60, 75, 90, 120, 150, 180, 240, 270, 300, 360]]
)
@pytest.mark.parametrize("degrees", [-7.5, 1.0, 2.0, 3.0, 5.0, 10.0, 15.0])
def test_turned_means_of_a_smooth_field_are_its_integrals(lines, degrees):
    """Of cos(angle) over the six turned segments of a level, wherever mesh lines lie."""
    border = np.deg2rad(np.array(lines))
    count = 4 * (len(border) - 1)
    middle = (border[:-1] + border[1:]) / 2
    corner = np.tile(np.stack([border[:-1], border[1:]] * 4, axis=1), (4, 1))
    sector = middle // (np.pi / 3), 6 + middle // (np.pi / 3), 12 + middle // (np.pi / 2)
    segment = np.concatenate([*sector, np.full(len(middle), 16)]).astype(int)
    nodes, weights = np.polynomial.legendre.leggauss(3)
    cell = np.repeat(np.arange(count), 3)
    half = np.tile(np.diff(border) / 2, 4)
    angle = np.tile(middle, 4)[cell] + np.tile(nodes, count) * half[cell]
    weight = np.tile(weights, count) * half[cell]
    turn = np.deg2rad(degrees)
    share = turned_membership(angle, cell, corner, segment, turn).toarray()[:6] * weight
    found = share @ np.cos(angle) / share.sum(axis=1)
    first = np.arange(6) * np.pi / 3 + turn
    exact = (np.sin(first + np.pi / 3) - np.sin(first)) / (np.pi / 3)
    np.testing.assert_allclose(found, exact, atol=0.01 * abs(turn))


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
    tangents = np.stack(tangents)
    predictor = Predictor.fit(theta, fields, tangents, PARAMETERS.coordinates)
    save_predictors({1.0: predictor}, folder / "predictor.npz")
    arrays = {"fields@1": fields, "tangents@1": tangents}
    np.savez(folder / "batch-0000.npz", theta=theta, **arrays)
    return folder


def simulate(folder, mesh, physics, name, anchors="batch-0000.npz"):
    table = folder / f"{name}.parquet"
    simulate_extension(mesh, folder / anchors, physics, name, "0000", 1, table)
    return pd.read_parquet(table)


def test_anchors_are_simulated_at_every_node(small_mesh, physics, known, simulator, solved):
    """Rows of the base and of each node, for two components that share the base."""
    hypothesis = copy.copy(REGISTRY["focal_scar"])
    hypothesis.components = ("8", "11")
    with temporary():
        REGISTRY.add(hypothesis)
        table = simulate(known, small_mesh, physics, "focal_scar")
    assert len(table) == 2 * (1 + len(hypothesis.nodes))
    assert (table["status"] == "converged").all()
    base = table[table["psi"] == hypothesis.base]
    straight, outputs = observed(simulator, solved.w), list(simulator.channels.names)
    np.testing.assert_allclose(base[outputs], np.tile(straight, (2, 1)), atol=1e-7)
    assert all(len(slope) == 52 for slope in base["slope"])
    # A softer segment 8 is stretched more, and no other changes as much.
    soft = table[(table["component"] == "8") & (table["psi"] < 1)].iloc[0]
    change = soft[outputs].to_numpy(float) - straight
    assert np.abs(change[1:18]).argmax() == 7 and change[8] < 0
    assert np.reshape(soft["sensitivity"], (52, 10)).shape == (52, 10)


def test_anchors_are_simulated_at_every_load(tmp_path, small_mesh, physics, solver, solved, known):
    """Channels of all loads, each load from its own fields; a stiff spring counts for more at a
    lower one."""
    half = solver.inflate(THETA, PRESSURE / 2, Effort())
    arrays = dict(np.load(known / "batch-0000.npz"))
    arrays = {name: array[:1] for name, array in arrays.items()}
    arrays |= {"fields@0.5": half.w[None], "tangents@0.5": arrays["tangents@1"]}
    np.savez(tmp_path / "two.npz", **arrays)
    two = with_value(physics, ("loading", "frames"), [0.5])
    two = with_value(two, ("observables", "quantities"), ["volume", "radial", "torsion"])
    table = simulate(tmp_path, small_mesh, two, "compressibility", "two.npz")
    channels = Channels.from_config(two)
    assert set(channels.names) <= set(table) and (table["status"] == "converged").all()
    base = table[table["psi"] == 0].iloc[0]
    straight = [observed(solver.simulator, state.w)[np.r_[0, 18:35]] for state in (solved, half)]
    for fraction, values in zip((1.0, 0.5), straight, strict=True):
        mine = channels.at(fraction) & ~channels.of_quantity("torsion")
        names = [name for name, m in zip(channels.names, mine, strict=True) if m]
        np.testing.assert_allclose(base[names].to_numpy(float), values, rtol=1e-6, atol=1e-7)
    assert len(base["slope"]) == len(channels) and np.isfinite(base["slope"]).all()
    last = table[table["psi"] == 0.05].iloc[0]
    assert np.reshape(last["sensitivity"], (len(channels), 10)).shape == (len(channels), 10)
    for fraction in (1.0, 0.5):
        radial = channels.at(fraction) & channels.of_quantity("radial")
        names = [name for name, m in zip(channels.names, radial, strict=True) if m]
        assert last[names].astype(float).mean() > base[names].astype(float).mean()


def test_a_failure_is_a_row(small_mesh, physics, known):
    physics = with_value(physics, ("solver", "max_newton_steps"), 1)
    hypothesis = REGISTRY["wall_thickness"]
    table = simulate(known, small_mesh, physics, "wall_thickness")
    assert len(table) == 1 + len(hypothesis.nodes)
    assert (table.loc[table["psi"] != 1, "status"] == "failed").all()
    assert table["reason"].str.contains("Newton").any()


def test_injected_effects_are_those_of_the_closed_forms(small_mesh, physics, known):
    """Pressure, mixed frames and radial scale by the simulator, against what they stand for."""
    ventricles = Ventricles(small_mesh, physics, known / "predictor.npz")

    def outputs(theta, effects):
        return ventricles.outputs(theta, read_effects(effects))

    softer = np.where(STRESS, THETA * 8 / 9, THETA)
    np.testing.assert_allclose(
        outputs(THETA, {"end_diastolic_pressure": 9.0}), outputs(softer, {}), rtol=1e-6, atol=1e-7
    )
    plain = outputs(THETA, {})
    scaled = outputs(THETA, {"radial_scale": 0.8})
    np.testing.assert_allclose(scaled[18:35], 0.8 * plain[18:35])
    np.testing.assert_array_equal(np.delete(scaled, range(18, 35)), np.delete(plain, range(18, 35)))
    stiffer = np.where(STRESS, THETA / 0.75, THETA)
    mixed = outputs(THETA, {"mixed_frames": 0.25})
    assert mixed[0] == pytest.approx(plain[0], rel=1e-9)
    np.testing.assert_allclose(mixed[1:], outputs(stiffer, {})[1:], rtol=1e-5, atol=1e-6)
