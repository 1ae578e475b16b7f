"""The discretised problem against finite differences and exact laws of mechanics."""

import json

import meshio
import numpy as np
import pandas as pd
import pytest
import ufl
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from regional_lv import aha
from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.geometry.elements import QUAD_NODES, facet_normals, gauss, lagrange
from regional_lv.geometry.make import make_mesh
from regional_lv.geometry.mesh import BASE, EPICARDIUM, read_mesh
from regional_lv.geometry.table import read_segments
from regional_lv.mechanics import dolfinx_api as api
from regional_lv.mechanics.continuation import Effort, Mixing, Runner, Solver
from regional_lv.mechanics.equilibrium import LinearSolveError
from regional_lv.mechanics.fibres import fibre_directions
from regional_lv.mechanics.predictor import Known
from regional_lv.mechanics.supports import supports_from_config
from regional_lv.simulation.batches import make_simulator

from .conftest import PRESSURE, THETA


def observed(simulator, state):
    """The 52 default channels of a state."""
    return simulator.observables(state.w)[0]


def with_base(physics, **components):
    """The physics with other supports of the base."""
    supports = physics["supports"]
    return physics | {"supports": supports | {"base": supports["base"] | components}}


BASES = {
    "paper": {},
    "twist held": {"radial": "free", "circumferential": "held"},
    "all held": {"circumferential": "held"},
    "radial spring": {"radial": 1.0},
}


def test_tangent_is_the_derivative_of_the_residual(simulator, solved):
    """A wrong tangent still converges, slowly and not everywhere: nothing else would show it."""
    simulator.set(THETA, PRESSURE)
    rng = np.random.default_rng(0)
    direction = rng.normal(size=simulator.size)
    direction[simulator.fixed] = 0.0
    simulator.residual(solved.w)
    step = simulator._rotate(direction.copy(), -1.0)

    # So short that hardly a fibre passes the switch at I4 = 1, where the tangent jumps.
    h = 1e-6
    moved = (simulator.retract(solved.w + sign * h * step) for sign in (1, -1))
    forth, back = (simulator.residual(w) for w in moved)
    numeric = (forth - back) / (2 * h)
    simulator.factorise(solved.w)
    indptr, indices = simulator._pattern
    tangent = csr_matrix((simulator._data, indices, indptr), shape=(simulator.size,) * 2)
    exact = tangent @ direction
    np.testing.assert_allclose(numeric, exact, rtol=0, atol=1e-6 * np.abs(exact).max())


def test_rigid_motion_needs_no_force(simulator):
    """Turned and moved as a whole, with no pressure, the wall is as free of stress as at rest."""
    simulator.set(THETA, 0.0)
    turn = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
    w = np.zeros(simulator.size)
    nodes = simulator.displacement_nodes
    w[simulator.displacement_dofs] = nodes @ (turn - np.eye(3)).T + [3.0, -2.0, 5.0]
    at_rest = np.zeros(simulator.size)
    at_rest[simulator.displacement_dofs] = 1e-3 * nodes
    stretched = np.abs(simulator.residual(at_rest)).max()
    assert np.abs(simulator.residual(w)).max() < 1e-9 * stretched


@pytest.mark.parametrize("seed", range(4))
def test_sensitivities_match_resolved_differences(simulator, solver, solved, seed):
    """At a random theta, of all parameters at once, each by as much as chance says, against two
    more solutions beside it."""
    rng = np.random.default_rng(seed)
    theta = np.exp(rng.uniform(np.log(0.3), np.log(3.0), 10))
    direction = rng.choice([-1, 1], 10) * rng.uniform(0.2, 1.0, 10)
    state = solver.newton(_known(solver, solved).field(theta), theta, PRESSURE, Effort())
    tangents = simulator.tangents(state)
    exact = direction @ simulator.observables(state.w, tangents)[1]
    h, values = 1e-3, []
    for sign in (1, -1):
        beside = theta * np.exp(sign * h * direction)
        start = state.w + sign * h * direction @ tangents
        values.append(observed(simulator, solver.newton(start, beside, PRESSURE, Effort())))
    numeric = (values[0] - values[1]) / (2 * h)
    strains, volume = slice(1, None), 0
    assert exact[volume] == pytest.approx(numeric[volume], rel=1e-4)
    scale = np.abs(numeric[strains]).max()
    np.testing.assert_allclose(exact[strains], numeric[strains], rtol=1e-4, atol=1e-4 * scale)


def test_pressure_and_stiffness_scale_together(solver, solved):
    """All stresses are proportional to the a-type parameters: doubling both changes nothing."""
    doubled = THETA.copy()
    doubled[solver.simulator.parameters.scales_stress] *= 2
    state = solver.newton(solved.w, doubled, 2 * PRESSURE, Effort())
    dofs = solver.simulator.displacement_dofs
    assert np.abs(state.w[dofs] - solved.w[dofs]).max() < 1e-7


def test_volumes_balance(simulator, solved):
    """Cavity at rest as the mesh has it; the wall keeps its volume on average."""
    rest = simulator.observables(np.zeros(simulator.size))[0]
    assert rest[0] == pytest.approx(106.3, rel=0.02)
    np.testing.assert_allclose(rest[1:], 0.0, atol=1e-12)
    assert simulator.observer.wall.volume.sum() / 1000 == pytest.approx(122.2, rel=0.02)
    assert simulator.dilation(solved.w) < 0.02


def test_wall_volume_is_between_the_surfaces(simulator, solved, small_mesh):
    """What the deformed epicardium encloses is the cavity and the wall, which keeps its volume.

    Constant pressures are among the discrete ones and the quadrature is exact for det F, so that
    the balance holds to the solver's accuracy however coarse the mesh.
    """
    mesh = read_mesh(small_mesh)
    mesh.points = mesh.points + simulator.displacement(solved.w)
    places, weights = gauss(2, 4)
    outer = mesh.surface == EPICARDIUM
    x = np.einsum("qn,knx->kqx", lagrange(places, QUAD_NODES)[0], mesh.points[mesh.facets[outer]])
    enclosed = np.einsum("kqx,kqx,q->", x, facet_normals(mesh, places)[outer], weights) / 3e3
    cavity, wall = observed(simulator, solved)[0], simulator.observer.wall.volume.sum() / 1e3
    assert enclosed == pytest.approx(cavity + wall, rel=1e-7)


def test_segment_volumes_are_those_of_the_geometry(simulator, small_mesh):
    """Each cell belongs to one segment, here as in the table that the geometry writes."""
    segments = pd.read_csv(small_mesh.with_name("segments.csv"))
    wall = simulator.observer.wall
    volumes = np.bincount(np.repeat(wall.segment, wall.points_per_cell), wall.volume)
    np.testing.assert_allclose(volumes / 1e3, segments["volume_ml"], rtol=1e-4)
    summary = json.loads(small_mesh.with_name("summary.json").read_text())
    assert volumes.sum() / 1e3 == pytest.approx(summary["wall_volume_ml"], rel=1e-4)


def test_strains_have_the_signs_of_filling(simulator, solved):
    """Looking back from end diastole the wall was thicker and its circumference shorter."""
    strains = observed(simulator, solved)[1:].reshape(3, 17)
    assert (strains[0] < 0).all()
    assert (strains[1] > 0).all()
    assert (strains[2] < 0.02).all()


def test_solution_does_not_depend_on_the_way(solver, solved):
    """A warm start from elsewhere ends where cold load stepping ends."""
    simulator = solver.simulator
    start = solver.inflate(np.full(10, 0.7), PRESSURE, Effort())
    warm = solver.newton(_known(solver, start).field(THETA), THETA, PRESSURE, Effort())
    np.testing.assert_allclose(
        observed(simulator, warm), observed(simulator, solved), rtol=1e-8, atol=1e-9
    )


def test_kept_factorisations_lead_to_the_same_solution_with_fewer(solver, solved):
    simulator = solver.simulator
    guess = _known(solver, solved).field(1.7 * THETA)
    found = {}
    for kept in (True, False):
        effort = Effort()
        way = Solver(simulator, solver.settings, kept=kept)
        state = way.newton(guess, 1.7 * THETA, PRESSURE, effort, tangent=False)
        found[kept] = observed(simulator, state), effort.newton_steps
    np.testing.assert_allclose(found[True][0], found[False][0], rtol=1e-7, atol=1e-8)
    assert found[True][1] < found[False][1]


def test_a_field_that_is_not_finite_is_refused_and_leaves_no_trace(simulator, solved):
    """As after a step that went astray; the factorisation after it is a good one."""
    simulator.set(THETA, PRESSURE)
    load = np.random.default_rng(0).normal(size=simulator.size)
    astray = solved.w.copy()
    astray[simulator.displacement_dofs[0, 2]] = np.nan
    found = []
    for _ in range(2):
        simulator.factorise(solved.w)
        found.append(simulator.solve(load))
        with pytest.raises(LinearSolveError, match="the tangent is not finite"):
            simulator.factorise(astray)
    np.testing.assert_array_equal(*found)


def test_mixed_steps_solve_what_the_old_tangent_cannot():
    """Four stiffnesses grew sixfold since the factorisation: plain steps run away from zero."""
    now, was = np.full(50, 2.0), np.full(50, 2.0)
    now[:4] *= 6 + np.arange(4)
    load = np.random.default_rng(0).normal(size=50)
    sizes = {}
    for mixing in (Mixing(np.arange(50)), None):
        w = np.zeros(50)
        for _ in range(8):
            step = (load - now * w) / was
            w = w + (mixing.mixed(w, step) if mixing else step)
        sizes[mixing is None] = np.abs(w - load / now).max()
    assert sizes[False] < 1e-9
    assert sizes[True] > 1.0


@pytest.fixture(scope="module")
def loaded(small_mesh, physics):
    """A simulator that observes all quantities at three loads."""
    observables = physics["observables"] | {
        "quantities": [*Channels.of().quantities, "torsion", "shortening"]
    }
    loading = physics["loading"] | {"frames": [0.25, 0.5]}
    return make_simulator(small_mesh, physics | {"observables": observables, "loading": loading})


def test_lower_loads_are_solutions_with_exact_sensitivities(loaded, physics, solved):
    """At every load and for every quantity, against solutions from nothing and differences."""
    solver = Solver(loaded, physics["solver"])
    guesses = {1.0: _known(solver, solved)}  # the lower loads are guessed from the full one
    result = Runner(solver, guesses).run(THETA)
    assert result.observables.shape == (len(loaded.channels),) == (3 * 54,)
    assert result.sensitivity.shape == (3 * 54, 10)
    for fraction in (0.25, 0.5):
        at = loaded.channels.at(fraction)
        direct = solver.inflate(THETA, fraction * PRESSURE, Effort())
        np.testing.assert_allclose(
            result.observables[at],
            loaded.observables(direct.w, fraction=fraction)[0],
            rtol=1e-7,
            atol=1e-8,
        )
    parameter, h = 4, 1e-3
    beside = [THETA * np.exp(sign * h * (np.arange(10) == parameter)) for sign in (1, -1)]
    forth, back = (Runner(solver, guesses).run(theta).observables for theta in beside)
    numeric = (forth - back) / (2 * h) / THETA[parameter]
    scale = np.where(loaded.channels.of_quantity("volume"), 1.0, np.abs(numeric[1:52]).max())
    np.testing.assert_allclose(
        result.sensitivity[:, parameter] / scale, numeric / scale, rtol=1e-4, atol=1e-4
    )


def test_torsion_and_shortening_of_known_motions(loaded):
    """A twist linear along the axis and a uniform stretch: numbers that can be written down."""
    points = loaded.observer.wall.mesh.points
    twist, stretch = np.deg2rad(0.2), 1.1  # per mm of height in the loaded state, along the axis
    z = stretch * points[:, 2]
    angle = -twist * z  # filling turns the lower wall counter-clockwise seen from the base
    x = np.cos(angle) * points[:, 0] - np.sin(angle) * points[:, 1]
    y = np.sin(angle) * points[:, 0] + np.cos(angle) * points[:, 1]
    moved = np.stack([x, y, z], axis=1) - points
    channels = [c for c in loaded.channels if c.quantity in ("torsion", "shortening")][:2]
    torsion, shortening = loaded.observer.values(channels, moved)
    # Quadratic elements bend the helix a little; the levels' mean heights define the distance.
    assert torsion == pytest.approx(0.2, rel=5e-3)
    assert shortening == pytest.approx(1 - 1 / stretch, rel=1e-12)


def test_failure_is_a_result(simulator, physics):
    """Too bold a step that may not be halved: the run ends as a row, not as an exception."""
    bold = {"first_load_fraction": 1.0, "min_load_fraction": 0.5}
    solver = Solver(simulator, physics["solver"] | bold)
    nothing = Known(simulator.size, simulator.coordinates)
    nothing.add(np.ones(10), np.zeros(simulator.size), np.zeros((10, simulator.size)))
    result = Runner(solver, {1.0: nothing}).run(np.full(10, 0.1))
    assert result.status == "failed"
    assert "mmHg" in result.reason
    assert 0 <= result.last_pressure < PRESSURE
    assert result.newton_steps > 0
    assert np.isnan(result.observables).all()
    assert result.sensitivity is None


def test_derivatives_that_are_not_finite_are_a_result(simulator, solver, solved, monkeypatch):
    """At a load that was reached."""

    def not_finite(*given):
        raise LinearSolveError("the Newton step is not finite")

    monkeypatch.setattr(simulator, "differentiated", not_finite)
    known = Known(simulator.size, simulator.coordinates)
    known.add(solved.theta, solved.w, np.zeros((10, simulator.size)))
    result = Runner(solver, {1.0: known}).run(THETA)
    assert (result.status, result.reason) == ("failed", "the Newton step is not finite")
    assert result.last_pressure == PRESSURE and np.isnan(result.observables).all()


@pytest.mark.parametrize("name", BASES)
def test_base_supports(small_mesh, physics, name):
    """Each support holds the components that it names, and leaves the others to move."""
    physics = with_base(physics, **BASES[name])
    base = physics["supports"]["base"]
    simulator = make_simulator(small_mesh, physics)
    state = Solver(simulator, physics["solver"]).inflate(np.ones(10), 2.0, Effort())
    x = simulator.displacement_nodes
    on_base = np.abs(x[:, 2]) < 1e-6
    u = state.w[simulator.displacement_dofs[on_base]]
    before, after = x[on_base, :2], (x[on_base] + u)[:, :2]
    radius, moved = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
    u_r = np.abs(moved - radius).max()
    u_theta = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]) / radius
    u_theta = u_theta.max()
    assert np.abs(u[:, 2]).max() < 1e-12
    assert (u_r < 1e-12) == (base["radial"] == "held")
    assert (u_theta < 1e-12) == (base["circumferential"] == "held")


@pytest.mark.parametrize("component", ["radial", "circumferential", "axial"])
def test_a_stiff_spring_holds_and_a_soft_one_lets_go(small_mesh, physics, component):
    """Each component from held over a stiff to a soft spring: strains at the base follow."""
    found = {}
    for support in ("held", 0.001, 3.0):
        changed = with_base(physics, **{"circumferential": "held", component: support})
        simulator = make_simulator(small_mesh, changed)
        state = Solver(simulator, changed["solver"]).inflate(THETA, 4.0, Effort())
        found[support] = observed(simulator, state)[1:]
    near, far = (np.abs(found[s] - found["held"]).max() for s in (0.001, 3.0))
    assert near < 0.03 * far
    assert far > 1e-3


def test_the_valves_carry_the_cavitys_pressure(small_mesh, physics):
    """With springs along the axis, the pressure on wall and valves cancels if the ring keeps its
    area: the base warps, and its springs bear nothing together. Without the load on the valves they
    would bear the pressure times the valves' area."""
    physics = with_base(physics, axial=1.0, circumferential="held")
    simulator = make_simulator(small_mesh, physics)
    state = Solver(simulator, physics["solver"]).inflate(np.ones(10), 4.0, Effort())
    mesh, moved = read_mesh(small_mesh), simulator.displacement(state.w)
    places, weights = gauss(2, 4)
    area = np.linalg.norm(facet_normals(mesh, places)[mesh.surface == BASE], axis=-1) * weights
    axial = lagrange(places, QUAD_NODES)[0] @ moved[mesh.facets[mesh.surface == BASE], 2].T
    assert np.abs(axial).max() > 0.1
    assert abs((area * axial.T).sum()) < 1e-5 * (area * np.abs(axial.T)).sum()


def test_bad_supports_are_refused(physics):
    section = physics["supports"]
    with pytest.raises(InputError, match=r"supports.base.radial: 'fixed'.*`held`, `free`"):
        supports_from_config(section | {"base": section["base"] | {"radial": "fixed"}})
    with pytest.raises(InputError, match="nothing holds the ventricle along its axis"):
        supports_from_config(section | {"base": section["base"] | {"axial": "free"}})
    with pytest.raises(InputError, match="nothing holds the ventricle across its axis"):
        supports_from_config(section | {"base": section["base"] | {"radial": "free"}})
    with pytest.raises(InputError, match=r"epicardium_kpa_per_mm: -1.0 is no stiffness"):
        supports_from_config(section | {"epicardium_kpa_per_mm": -1.0})


def test_a_solution_as_the_guess_gives_the_same_sensitivities(solver, solved):
    """No step is left to make then, and the tangents must still be this theta's."""
    runner = Runner(solver, {1.0: _known(solver, solved)})
    first = runner.run(THETA)
    runner.run(np.full(10, 2.0))
    again = runner.run(THETA)
    np.testing.assert_allclose(again.sensitivity, first.sensitivity, rtol=1e-6, atol=1e-7)


def _known(solver, state):
    """Guesses from one solution, whose tangent is made here."""
    again = solver.newton(state.w, state.theta, state.pressure, Effort())
    known = Known(solver.simulator.size, solver.simulator.coordinates)
    known.add(again.theta, again.w, solver.simulator.tangents(again))
    return known


def test_fibres_in_the_simulator_are_those_in_the_mesh_file(simulator, small_mesh, physics):
    """The same angles are written twice, in NumPy for the eye and in UFL for the physics."""
    fields = meshio.read(small_mesh).point_data
    mesh = read_mesh(small_mesh)
    scalar = api.fem.Function(api.space(simulator.domain, "Lagrange", 2))
    nodes = scalar.function_space.tabulate_dof_coordinates()
    scalar.x.array[:] = mesh.transmural[cKDTree(mesh.points).query(nodes)[1]]
    fibre, _ = fibre_directions(scalar, physics["fibres"])
    written = api.fem.Function(api.space(simulator.domain, "Lagrange", 2, components=3))
    nodes = written.function_space.tabulate_dof_coordinates()
    written.x.array[:] = fields["fibre"][cKDTree(mesh.points).query(nodes)[1]].ravel()
    cosine = ufl.dot(fibre, written) / ufl.sqrt(ufl.dot(written, written))
    alignment = api.compile_form(cosine**2 * ufl.dx(degree=4))
    # Not 1, because the file has the vectors at nodes only; a helix of the other hand gives 0.3.
    assert api.fem.assemble_scalar(alignment) / simulator.observer.wall.volume.sum() > 0.97


@pytest.mark.parametrize("name", BASES)
def test_equal_sectors_have_equal_strains(tmp_path, smoke_config, physics, name):
    """A table of equal sectors, by half a turn brought onto itself as the mesh is, theta 1.

    Where one node holds the base against rotation, this shows that it bears no load.
    """
    geometry = smoke_config["geometry"]
    table = read_segments(geometry["segments"]).drop(columns="line")
    for level, thickness, radius in (("basal", 11, 23), ("mid", 10, 22), ("apical", 9, 18)):
        mine = table["aha_segment"].isin(aha.LEVELS[level])
        table.loc[mine, ["wall_thickness_mm", "endo_radius_mm"]] = [thickness, radius]
    # Apical borders onto multiples of 30 degrees, where 24 mesh lines have all borders.
    apical = table["aha_segment"].isin(aha.LEVELS["apical"])
    table.loc[apical, ["angle_from_deg", "angle_to_deg"]] += 45
    table.to_csv(tmp_path / "table.csv", index=False)
    make_mesh(
        tmp_path / "table.csv",
        geometry["endo_apex_z_mm"],
        geometry["epi_apex_z_mm"],
        smoke_config["mesh"] | {"circumferential": 24},
        smoke_config["fibres"],
        tmp_path / "mesh.msh",
        tmp_path / "mesh.vtu",
        tmp_path / "segments.csv",
        tmp_path / "summary.json",
    )
    simulator = make_simulator(tmp_path / "mesh.vtu", with_base(physics, **BASES[name]))
    state = Solver(simulator, physics["solver"]).inflate(np.ones(10), PRESSURE, Effort())
    strains = observed(simulator, state)[1:].reshape(3, 17)
    for level, sectors in (("basal", 6), ("mid", 6), ("apical", 4)):
        mine = strains[:, np.array(aha.LEVELS[level]) - 1]
        # Node places are rounded to 1e-6 mm, a strain of 1e-6 in elements of a few mm.
        np.testing.assert_allclose(mine, np.roll(mine, sectors // 2, axis=1), rtol=0, atol=1e-6)
        # Neither the patch at the apex nor the smoothest surfaces have more than this symmetry.
        assert np.ptp(mine, axis=1).max() < 5e-3


def test_entries_of_the_tangent_are_those_of_dolfinx(simulator, solved):
    """To the last bit; and a product needs no matrix."""
    simulator.set(THETA, PRESSURE)
    simulator._place(solved.w)
    form = simulator._tangent
    matrix, expected = api.Matrix(form), api.fem.assemble_matrix(form)
    for _ in range(2):
        matrix.assemble(form)
        np.testing.assert_array_equal(matrix.data, np.asarray(expected.data))
    columns = np.random.default_rng(0).normal(size=(simulator.size, 3))
    entries = csr_matrix((matrix.data, matrix.indices, matrix.indptr))
    np.testing.assert_allclose(
        api.product(columns, form), entries @ columns, atol=1e-10 * np.abs(matrix.data).max()
    )
