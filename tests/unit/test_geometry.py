"""The parametric left ventricle: what the table says is what the mesh has."""

import json

import meshio
import numpy as np
import pandas as pd
import pytest
import vtk
from scipy.spatial import cKDTree

from regional_lv import aha, data
from regional_lv import config as study_config
from regional_lv.aha import LEVELS
from regional_lv.errors import InputError
from regional_lv.geometry import meshing
from regional_lv.geometry.directions import fibre_directions, local_directions
from regional_lv.geometry.elements import (
    NODES,
    QUAD_NODES,
    facet_normals,
    gauss,
    jacobians,
    lagrange,
)
from regional_lv.geometry.make import make_mesh
from regional_lv.geometry.mesh import BASE, ENDOCARDIUM, EPICARDIUM, SURFACES, read_mesh
from regional_lv.geometry.shape import LEVEL_KEYS, NodePlaces, heights
from regional_lv.geometry.summary import _apex, scaled_jacobians
from regional_lv.geometry.surfaces import QUARTER, Surfaces
from regional_lv.geometry.table import read_segments, with_joined_borders
from regional_lv.inputs.model import model_of
from regional_lv.inputs.stiffness import StiffnessInputs

TABLE = data.path("volunteer_segments.csv")
PARAMETERS = StiffnessInputs()
APICES = {"endo_apex_z_mm": -74.4, "epi_apex_z_mm": -81.2}
ROWS = {"basal": 1, "basal_grading": 1.0, "mid": 2, "apical": 1, "apex": 1, "transmural": 1}
FIBRES = {
    "helix_endo_deg": 60,
    "helix_epi_deg": -60,
    "sheet_endo_deg": 45,
    "sheet_epi_deg": -45,
}


def make(folder, table=TABLE, circumferential=16, apices=APICES, **rows):
    paths = {
        "msh": folder / "mesh.msh",
        "vtu": folder / "mesh.vtu",
        "segments": folder / "segments.csv",
        "summary": folder / "summary.json",
    }
    mesh_cfg = {"circumferential": circumferential, **ROWS, **rows}
    make_mesh(table, **apices, mesh=mesh_cfg, fibres=FIBRES, **paths, zones=PARAMETERS.zones)
    return read_mesh(paths["vtu"]), folder


@pytest.fixture(scope="module", params=[16, 24])
def made(request, tmp_path_factory):
    return make(tmp_path_factory.mktemp(f"n{request.param}"), circumferential=request.param)


@pytest.fixture
def rows():
    return pd.read_csv(TABLE)


def save(rows, folder):
    path = folder / "table.csv"
    rows.to_csv(path, index=False)
    return path


def surface_volume(mesh, surface):
    """Volume (mL) under a surface by the divergence theorem, as summarise does not compute it."""
    points, weights = gauss(2, 4)
    facets = mesh.surface == surface
    x = np.einsum("qn,knx->kqx", lagrange(points, QUAD_NODES)[0], mesh.points[mesh.facets])
    flux = np.einsum("kqx,kqx->kq", x, facet_normals(mesh, points))
    return (flux[facets] @ weights).sum() / 3e3


def test_volumes_are_those_of_the_published_heart(made):
    summary = json.loads((made[1] / "summary.json").read_text())
    assert summary["cavity_volume_ml"] == pytest.approx(106.3, rel=0.02)
    assert summary["wall_volume_ml"] == pytest.approx(122.2, rel=0.02)


def test_quadrature_of_the_wall_equals_the_flux_through_its_skin(made):
    # Fails if the node order of cells or of facets is wrong, or a facet points into the wall.
    mesh, folder = made
    wall = sum(surface_volume(mesh, surface) for surface in (1, 2, 3))
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["wall_volume_ml"] == pytest.approx(wall, rel=1e-9)
    assert summary["cavity_volume_ml"] == pytest.approx(-surface_volume(mesh, 1), rel=1e-12)
    assert surface_volume(mesh, 2) > 0


def test_segments_have_the_thickness_and_radius_of_the_table(made):
    segments = pd.read_csv(made[1] / "segments.csv")
    given = pd.read_csv(TABLE)
    np.testing.assert_array_equal(segments["thickness_table_mm"], given["wall_thickness_mm"])
    np.testing.assert_array_equal(segments["endo_radius_table_mm"], given["endo_radius_mm"])
    np.testing.assert_allclose(segments["thickness_mm"], given["wall_thickness_mm"], atol=0.06)
    np.testing.assert_allclose(segments["endo_radius_mm"], given["endo_radius_mm"], atol=0.08)


def test_averages_of_the_surfaces_are_exact(rows):
    surfaces = Surfaces(read_segments(TABLE), *APICES.values())
    points, weights = gauss(2, 30)
    top, bottom = np.arcsin(np.array([13.6, 44.0]) / 74.4)
    phi = np.radians(-120 + 30 * points[:, 0])
    u = (top + bottom + (bottom - top) * points[:, 1]) / 2
    mean = [f(phi, u) @ weights / 4 for f in (surfaces.thickness, surfaces.radius)]
    given = rows.loc[6, ["wall_thickness_mm", "endo_radius_mm"]].tolist()
    np.testing.assert_allclose(mean, given, atol=1e-4)


def test_elements_are_well_shaped(made):
    quality = scaled_jacobians(made[0])
    assert quality.min() > 0.5
    assert np.median(quality) > 0.9
    fine = jacobians(made[0], gauss(3, 6)[0])
    assert np.linalg.det(fine).min() > 0


@pytest.mark.parametrize(
    "circumferential",
    [32, pytest.param(40, marks=pytest.mark.test_all("as 32; its mesh is the largest of all"))],
)
def test_finer_meshes(circumferential, tmp_path):
    mesh, _ = make(tmp_path, circumferential=circumferential)
    assert scaled_jacobians(mesh).min() > 0.4
    assert (mesh.surface == BASE).sum() == circumferential


def test_rows_and_layers(tmp_path):
    mesh, _ = make(tmp_path, basal=2, mid=3, apical=2, apex=2, transmural=2)
    counts = np.bincount(mesh.segment)[1:]
    assert counts[:6].sum() == 2 * 16 * 2
    assert counts[6:12].sum() == 3 * 16 * 2
    assert counts[12:16].sum() == 2 * 16 * 2
    assert counts[16] == (2 * 16 + 4 * 4) * 2
    assert np.unique(np.round(mesh.transmural, 9)).tolist() == [0, 0.25, 0.5, 0.75, 1]
    assert scaled_jacobians(mesh).min() > 0.3


def test_segments_partition_the_wall(made):
    mesh, _ = made
    assert set(mesh.segment) == set(range(1, 18))
    assert len(np.unique(np.sort(mesh.cells, axis=1), axis=0)) == len(mesh.cells)
    assert set(np.unique(mesh.cells)) == set(range(len(mesh.points)))


def test_no_element_straddles_a_segment_border(made, rows):
    mesh, _ = made
    points = mesh.points[mesh.cells]
    for row in rows.itertuples():
        mine = points[mesh.segment == row.aha_segment]
        z = mine[..., 2]
        assert z.max() <= row.z_top_mm + 1e-5
        if row.aha_segment == 17:
            continue
        assert z.min() >= row.z_bottom_mm - 1e-5
        angle = np.degrees(np.arctan2(mine[..., 1], mine[..., 0]))
        inside = (angle - row.angle_from_deg + 1e-4) % 360
        assert inside.max() <= row.angle_to_deg - row.angle_from_deg + 2e-4


def test_skin(made):
    mesh, _ = made
    t, rho = mesh.transmural[mesh.facets], mesh.longitudinal[mesh.facets]
    assert (t[mesh.surface == ENDOCARDIUM] == 0).all()
    assert (t[mesh.surface == EPICARDIUM] == 1).all()
    np.testing.assert_allclose(rho[mesh.surface == BASE], 1)
    assert (mesh.points[mesh.facets[mesh.surface == BASE], 2] == 0).all()
    np.testing.assert_allclose([_apex(mesh, s) for s in (1, 2)], [-74.4, -81.2])


def test_surfaces_are_perpendicular_to_the_axis_at_the_pole():
    surfaces = Surfaces(read_segments(TABLE), *APICES.values())
    phi = np.radians(np.arange(0, 360, 30.0))
    for surface in (surfaces.endocardium, surfaces.epicardium):
        slopes = []
        for step in (1e-2, 1e-3):
            r, z = surface(phi, np.full(12, QUARTER - step))
            apex = surface(phi, np.full(12, QUARTER))[1]
            slopes.append(np.abs((z - apex) / r).max())
        assert slopes[1] < 1e-2
        assert slopes[1] < slopes[0] / 8


def test_paraview_file(made):
    raw = meshio.read(made[1] / "mesh.vtu")
    assert {block.type for block in raw.cells} == {"hexahedron27", "quad9"}
    mesh = made[0]
    np.testing.assert_array_equal(
        raw.cell_data["zone"][0], PARAMETERS.segment_zone[mesh.segment - 1] + 1
    )
    assert not raw.cell_data["segment"][1].any()
    assert not raw.cell_data["zone"][1].any()
    assert not raw.cell_data["surface"][0].any()
    # Where they exist, directions are right-handed, and fibres and sheets have their angles.
    wall = np.hypot(*mesh.points[:, :2].T) > 1e-6
    axes = ("radial", "circumferential", "longitudinal_direction")
    frame = np.stack([raw.point_data[name][wall] for name in axes], axis=1)
    identity = np.broadcast_to(np.eye(3), frame.shape)
    np.testing.assert_allclose(frame @ frame.swapaxes(1, 2), identity, atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(frame), 1)
    x, y = mesh.points[wall, :2].T / np.hypot(*mesh.points[wall, :2].T)
    assert (frame[:, 0, 0] * x + frame[:, 0, 1] * y)[mesh.points[wall, 2] > -40].min() > 0.8
    assert (frame[:, 1, 1] * x - frame[:, 1, 0] * y).min() > 0.6
    h, b = (np.radians(a * (1 - 2 * mesh.transmural[wall])) for a in (60, 45))
    fibre, sheet = ((frame @ raw.point_data[n][wall, :, None])[..., 0] for n in ("fibre", "sheet"))
    np.testing.assert_allclose(fibre.T, [0 * h, np.cos(h), np.sin(h)], atol=1e-9)
    expected = [np.cos(b), -np.sin(b) * np.sin(h), np.sin(b) * np.cos(h)]
    np.testing.assert_allclose(sheet.T, expected, atol=1e-9)


def test_mesh_laid_out_without_gmsh_is_the_same(tmp_path, monkeypatch):
    rows = {"basal": 2, "basal_grading": 0.8, "apex": 2, "transmural": 2}
    by_gmsh, _ = make(tmp_path / "gmsh", circumferential=32, **rows)
    monkeypatch.setattr(meshing, "load_gmsh", lambda: None)
    other, _ = make(tmp_path / "other", circumferential=32, **rows)
    assert len(by_gmsh.points) == len(other.points) == 5925
    distance, same = cKDTree(other.points).query(by_gmsh.points)
    assert distance.max() < 2e-6 and len(set(same)) == len(same)
    for values in ("transmural", "longitudinal"):
        np.testing.assert_allclose(
            getattr(other, values)[same], getattr(by_gmsh, values), atol=1e-9
        )
    for entities, tags in (("cells", "segment"), ("facets", "surface")):
        nodes = {
            name: {
                (*sorted(number[row]), tag)
                for row, tag in zip(getattr(mesh, entities), getattr(mesh, tags), strict=True)
            }
            for name, mesh, number in (
                ("gmsh", by_gmsh, same),
                ("other", other, np.arange(len(same))),
            )
        }
        assert nodes["gmsh"] == nodes["other"]


def test_gmsh_file_names_its_parts(made):
    """Under the names of the AHA and of the surfaces lie the elements that the mesh has there."""
    mesh, raw = made[0], meshio.read(made[1] / "mesh.msh")
    parts = [(3, s.name, (mesh.segment == s.number).sum()) for s in aha.SEGMENTS]
    parts += [(2, name, (mesh.surface == tag).sum()) for tag, name in SURFACES.items()]
    found = {
        name: (dim, sum((tags == tag).sum() for tags in raw.cell_data["gmsh:physical"]))
        for name, (tag, dim) in raw.field_data.items()
    }
    assert found == {name: (dim, count) for dim, name, count in parts}


def test_node_order_is_that_of_vtk():
    for cell, nodes in (
        (vtk.vtkTriQuadraticHexahedron(), NODES),
        (vtk.vtkBiQuadraticQuad(), QUAD_NODES),
    ):
        places = np.array([cell.GetParametricCoords()[i] for i in range(3 * len(nodes))])
        places = places.reshape(-1, 3)[:, : nodes.shape[1]]
        np.testing.assert_allclose(2 * places - 1, nodes)


def test_same_input_same_bytes(tmp_path):
    folders = [tmp_path / name for name in ("first", "second")]
    for folder in folders:
        make(folder)
    for name in ("mesh.msh", "mesh.vtu", "segments.csv", "summary.json"):
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes()


def test_axisymmetric_table_gives_an_axisymmetric_heart(rows, tmp_path):
    for level, thickness, radius in (("basal", 10, 24), ("mid", 9, 22), ("apical", 8, 17)):
        mine = rows["aha_segment"].isin(LEVELS[level])
        rows.loc[mine, ["wall_thickness_mm", "endo_radius_mm"]] = [thickness, radius]
    _, folder = make(tmp_path, save(rows, tmp_path), circumferential=24)
    segments = pd.read_csv(folder / "segments.csv")
    for level in ("basal", "mid", "apical"):
        mine = segments[segments["aha_segment"].isin(LEVELS[level])]
        for quantity in ("volume_ml", "thickness_mm", "endo_radius_mm"):
            np.testing.assert_allclose(mine[quantity], mine[quantity].mean(), rtol=2e-3)


@pytest.mark.parametrize(
    "change",
    [
        {8: (2.2, 0.8), 2: (1.6, 0.9)},
        {7: (0.5, 1.1)},
        {k: (0.75, 1.4) for k in range(1, 17)},
        {k: (1.6, 0.7) for k in range(1, 17)},
    ],
    ids=["septal hypertrophy", "thin scar", "dilated", "concentric hypertrophy"],
)
def test_diseased_hearts_work(change, rows, tmp_path):
    for segment, (thickness, radius) in change.items():
        rows.loc[segment - 1, "wall_thickness_mm"] *= thickness
        rows.loc[segment - 1, "endo_radius_mm"] *= radius
    _, folder = make(tmp_path, save(rows, tmp_path))
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["scaled_jacobian_min"] > 0.3
    assert summary["largest_thickness_deviation_mm"] < 0.2
    assert summary["largest_endo_radius_deviation_mm"] < 0.2


def test_other_sector_borders_are_followed(rows, tmp_path):
    # 16 different borders, as many as there can be, on the coarsest mesh.
    for level, turn in (("mid", 20), ("apical", 7)):
        mine = rows["aha_segment"].isin(LEVELS[level])
        rows.loc[mine, ["angle_from_deg", "angle_to_deg"]] += turn
    mesh, _ = make(tmp_path, save(rows, tmp_path))
    test_no_element_straddles_a_segment_border((mesh, None), rows)
    test_segments_partition_the_wall((mesh, None))
    assert np.linalg.norm(mesh.points[:, :2], axis=1).min() == 0


MOSTLY = {
    *[("angle_from_deg", -5e-7), ("angle_from_deg", 6e-14)],
    *[("angle_to_deg", -6e-14), ("angle_to_deg", 5e-7)],
}
DEEP = pytest.mark.test_all("the same with other slacks; two seconds each")


@pytest.mark.parametrize("turn", [0.01, 0.5])
def test_levels_that_are_turned_a_little_share_mesh_lines(rows, turn, tmp_path):
    """24 columns of 15 degrees, as of the table with one direction for all levels."""
    rows[["angle_from_deg", "angle_to_deg"]] += 400.0
    given = read_segments(save(rows, tmp_path))
    assert with_joined_borders(given) is given
    of_mid = rows["aha_segment"].between(7, 12)
    rows.loc[of_mid, ["angle_from_deg", "angle_to_deg"]] += turn
    turned = with_joined_borders(read_segments(save(rows, tmp_path)))
    columns = np.diff(meshing._grid_angles(turned, 24))
    assert columns.min() > 15 - turn and columns.max() < 15 + turn
    away = (turned["angle_from_deg"] - given["angle_from_deg"])[:16]
    np.testing.assert_allclose(away[:12], turn / 2)  # halfway between basal and mid level
    assert not away[12:].any()
    widths = turned["angle_to_deg"] - turned["angle_from_deg"]
    np.testing.assert_allclose(widths, [60] * 12 + [90] * 4 + [360])


def test_a_narrow_sector_keeps_its_elements(rows, tmp_path):
    rows.loc[0, "angle_to_deg"] = rows.loc[0, "angle_from_deg"] + 0.5
    rows.loc[5, "angle_from_deg"] = rows.loc[0, "angle_to_deg"]
    given = read_segments(save(rows, tmp_path))
    assert with_joined_borders(given) is given


@pytest.mark.parametrize(
    ("column", "slack"),
    [
        pytest.param(column, slack, marks=[] if (column, slack) in MOSTLY else DEEP)
        for column in ("angle_from_deg", "angle_to_deg")
        for slack in (-5e-7, -1e-10, -6e-14, 6e-14, 1e-10, 5e-7)
    ],
)
def test_round_off_between_sectors_changes_nothing(rows, column, slack, tmp_path):
    """Each border in turn, one of which is the seam at 180 degrees, off as far as is accepted."""
    rows.loc[:15, ["angle_from_deg", "angle_to_deg"]] += 30
    exact = read_segments(save(rows, tmp_path))
    assert {180, -180} & set(rows["angle_to_deg"]) and meshing._grid_angles(exact, 16).size == 16
    for row in range(17):
        changed = rows.copy()
        changed[column] = changed[column].astype(float)
        changed.loc[row, column] += slack
        table = read_segments(save(changed, tmp_path))
        np.testing.assert_allclose(
            meshing._grid_angles(table, 16), meshing._grid_angles(exact, 16), atol=1e-5
        )
        for numbers in LEVELS.values():
            level = table[table["aha_segment"].isin(numbers)]
            gap = level["angle_from_deg"].to_numpy() - np.roll(level["angle_to_deg"], -1)
            assert (gap % 360 == 0).all()
    changed.loc[0, "angle_to_deg"] += slack
    _, folder = make(tmp_path, save(changed, tmp_path))
    assert (folder / "mesh.vtu").exists()


# --- directions ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("segment", "length", "apex", "levels"),
    [
        ({"wall_thickness_mm": 1.15, "endo_radius_mm": 0.95}, 1.0, 1.0, None),
        ({}, 1.06, 1.0, None),
        ({}, 1.0, 1.3, None),
        ({}, 1.0, 1.0, (0.28, 0.62, 0.84)),
    ],
    ids=["segment 9", "length", "apex", "levels"],
)
def test_nodes_move_to_where_a_mesh_of_that_shape_has_them(
    rows, tmp_path, segment, length, apex, levels
):
    """Figures of the table times these, those of one segment, of the cavity and of its apex; or
    other ends of the levels."""
    shape = model_of(study_config.load({"study": "mine"}))["geometry"]
    figures = {"length_mm": length * shape["length_mm"], "apex_mm": apex * shape["apex_mm"]}
    for column, times in segment.items():
        rows.loc[8, column] *= times
        figures[column] = rows[column].to_numpy()
    if levels:
        figures |= dict(zip(LEVEL_KEYS, levels, strict=True))
        for column, values in heights(shape | figures).items():
            rows[column] = values
    rows[["z_top_mm", "z_bottom_mm"]] *= length
    inner = length * APICES["endo_apex_z_mm"]
    outer = inner - figures["apex_mm"]
    rows.loc[16, "z_bottom_mm"] = outer
    for name in ("own", "other"):
        (tmp_path / name).mkdir()
    own, _ = make(tmp_path / "own")
    apices = {"endo_apex_z_mm": inner, "epi_apex_z_mm": outer}
    other, _ = make(tmp_path / "other", save(rows, tmp_path), apices=apices)
    moved = NodePlaces(own, shape)(shape | figures)
    assert np.abs(other.points - own.points).max() > 0.5
    np.testing.assert_allclose(moved, other.points, atol=1e-3)


def at_gauss_points(mesh):
    """(t, c, r, l, position) at the Gauss points of all cells."""
    points, _ = gauss(3)
    shape, gradient = lagrange(points)
    t = np.einsum("en,qn->eq", mesh.transmural[mesh.cells], shape)
    local = np.einsum("en,qnd->eqd", mesh.transmural[mesh.cells], gradient)
    jacobian = jacobians(mesh, points)
    grad = np.linalg.solve(np.swapaxes(jacobian, -1, -2), local[..., None])[..., 0]
    x = np.einsum("enx,qn->eqx", mesh.points[mesh.cells], shape)
    return t, *local_directions(grad), x


def test_local_directions(made):
    _, c, r, longitudinal, x = at_gauss_points(made[0])
    frame = np.stack([r, c, longitudinal], axis=-1)
    identity = np.broadcast_to(np.eye(3), frame.shape)
    np.testing.assert_allclose(np.swapaxes(frame, -1, -2) @ frame, identity, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frame), 1)
    # Counter-clockwise seen from the base, up to the element next to the pole.
    turning = np.stack([-x[..., 1], x[..., 0], 0 * x[..., 0]], axis=-1)
    turning /= np.linalg.norm(turning, axis=-1)[..., None]
    assert (np.einsum("eqx,eqx->eq", c, turning) > 0.6).all()
    assert (longitudinal[..., 2] >= 0).all()


@pytest.mark.parametrize(("t", "helix", "sheet"), [(0, 60, 45), (0.5, 0, 0), (1, -60, -45)])
def test_fibre_angles(t, helix, sheet):
    c, r, longitudinal = local_directions(np.array([0.3, -0.2, -0.4]))
    f, s = fibre_directions(np.float64(t), c, r, longitudinal, FIBRES)
    assert np.degrees(np.arctan2(f @ longitudinal, f @ c)) == pytest.approx(helix)
    assert f @ r == pytest.approx(0)
    normal = np.cross(r, f)
    assert np.degrees(np.arctan2(s @ normal, s @ r)) == pytest.approx(sheet)


def test_endocardial_helix_is_right_handed():
    c, r, longitudinal = local_directions(np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose([c, longitudinal], [[0, 1, 0], [0, 0, 1]])
    f, _ = fibre_directions(np.float64(0), c, r, longitudinal, FIBRES)
    # Turning counter-clockwise seen from +z, it climbs towards +z.
    assert f[1] > 0
    assert f[2] > 0


def test_fibres_are_unit_and_orthogonal_everywhere(made):
    t, c, r, longitudinal, _ = at_gauss_points(made[0])
    f, s = fibre_directions(t, c, r, longitudinal, FIBRES)
    np.testing.assert_allclose(np.linalg.norm(f, axis=-1), 1)
    np.testing.assert_allclose(np.linalg.norm(s, axis=-1), 1)
    np.testing.assert_allclose(np.einsum("eqx,eqx->eq", f, s), 0, atol=1e-12)


# --- bad input -------------------------------------------------------------------------------


def drop_row(rows):
    return rows.drop(index=4)


def repeat_row(rows):
    return pd.concat([rows, rows.iloc[[2]]])


def setter(row, column, value):
    def change(rows):
        rows[column] = rows[column].astype(object)
        rows.loc[row, column] = value
        return rows

    return change


def scaled(columns, factor):
    def change(rows):
        rows[columns] *= factor
        return rows

    return change


def mirrored(rows):
    low, high = -rows["angle_to_deg"], -rows["angle_from_deg"]
    return rows.assign(angle_from_deg=low, angle_to_deg=high)


def turned(level, degrees):
    def change(rows):
        mine = rows["aha_segment"].isin(LEVELS[level])
        rows.loc[mine, ["angle_from_deg", "angle_to_deg"]] += degrees
        return rows

    return change


MM = ["wall_thickness_mm", "endo_radius_mm"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (drop_row, "segment 5 is missing"),
        (repeat_row, "line 19: segment 3 was given before"),
        (setter(3, "aha_segment", 18), "line 5: aha_segment 18 does not exist"),
        (setter(3, "aha_segment", 4.5), "line 5: aha_segment 4.5 does not exist"),
        (setter(0, "wall_thickness_mm", np.nan), "line 2: wall_thickness_mm is empty"),
        (setter(0, "endo_radius_mm", np.inf), "line 2: endo_radius_mm is inf"),
        (setter(0, "z_top_mm", "top"), "line 2: z_top_mm is top"),
        (setter(6, "wall_thickness_mm", -9.2), "line 8: wall_thickness_mm is -9.2"),
        (setter(6, "endo_radius_mm", 0), "line 8: endo_radius_mm is 0"),
        (setter(6, "wall_thickness_mm", 91.6), "between 2 and 30 mm"),
        (scaled(MM, 0.1), "looks like cm; multiply by 10"),
        (scaled(MM, 0.001), "looks like m; multiply by 1000"),
        (scaled(["z_top_mm", "z_bottom_mm"], 0.1), "looks like cm"),
        (setter(0, "name", "apex"), "name of segment 1 is 'apex'; it must be 'basal anterior'"),
        (setter(0, "name", "apex"), "name of segment 1 is 'apex'"),
        (lambda rows: rows.drop(columns="endo_radius_mm"), "no column `endo_radius_mm`"),
        (setter(1, "angle_to_deg", -155), "tile 360 degrees"),
        (setter(13, "angle_to_deg", 75), "0 degrees wide"),
        (setter(12, "angle_from_deg", -555), "sector is 450 degrees wide"),
        (mirrored, "numbered clockwise seen from the base"),
        (turned("mid", 60), "mid level the middle of the septum (segments 8 and 9) is 60 degrees"),
        (turned("apical", -90), "at the apical level the middle of the septum (segment 14) is "),
        (turned("mid", 180), "is 180 degrees away from that of the basal level"),
        (setter(8, "z_bottom_mm", -43), "differs from segment 7's"),
        (setter(16, "z_top_mm", -56), "begins at z = -56 mm"),
        (setter(16, "z_bottom_mm", -50), "-50 is not below"),
        (setter(16, "z_bottom_mm", -90), "geometry.epi_apex_z_mm"),
    ],
)
def test_bad_table(change, message, rows, tmp_path):
    path = save(change(rows), tmp_path)
    with pytest.raises(InputError) as error:
        make(tmp_path, path)
    assert str(path) in str(error.value)
    assert message in str(error.value)


def test_no_table(tmp_path):
    with pytest.raises(InputError, match=r"none\.csv: there is no such file; check the path"):
        read_segments(tmp_path / "none.csv")


def test_empty_table(tmp_path):
    (tmp_path / "empty.csv").write_text("")
    with pytest.raises(InputError, match="holds no table"):
        read_segments(tmp_path / "empty.csv")


def test_packaged_table_goes_by_its_name():
    pd.testing.assert_frame_equal(read_segments("volunteer"), read_segments(TABLE))


def test_user_table_needs_no_published_columns_nor_order(rows, tmp_path):
    own = rows.drop(columns=["published_order", "published_wall_volume_ml"]).iloc[::-1]
    table = read_segments(save(own, tmp_path))
    assert table["aha_segment"].tolist() == list(range(1, 18))
    np.testing.assert_array_equal(table["wall_thickness_mm"], rows["wall_thickness_mm"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"circumferential": 20}, "mesh.circumferential is 20"),
        ({"circumferential": 8}, "mesh.circumferential is 8"),
        ({"apex": 0}, "mesh.apex is 0"),
        ({"transmural": 0}, "mesh.transmural is 0"),
    ],
)
def test_bad_mesh_config(change, message, tmp_path):
    with pytest.raises(InputError, match=message):
        make(tmp_path, **change)


def test_foreign_mesh_is_refused(tmp_path):
    path = tmp_path / "tetra.vtu"
    meshio.Mesh(np.eye(4, 3), [("tetra", [[0, 1, 2, 3]])]).write(path)
    with pytest.raises(InputError, match="expected one block of hexahedron27"):
        read_mesh(path)


def test_graded_rows_shrink_towards_the_base(tmp_path):
    mesh, _ = make(tmp_path, basal=3, basal_grading=0.5)
    on_rim = np.unique(mesh.facets[mesh.surface == ENDOCARDIUM])
    depths = np.unique(np.round(mesh.points[on_rim, 2], 3))[::-1]
    # Every other node along a mesh line is a corner; the first three rows are the basal ones.
    heights = -np.diff(depths[:7:2])
    assert heights[1] / heights[0] == pytest.approx(2, rel=0.15)
    assert heights[2] / heights[1] == pytest.approx(2, rel=0.15)
