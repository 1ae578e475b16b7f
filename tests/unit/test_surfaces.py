"""A ventricle from two triangulated surfaces: volumes and frame of analytic (synthetic) shapes in a
turned and shifted frame, and everything that is refused."""

import json
import logging
import re
import runpy
import shutil

import numpy as np
import pandas as pd
import pytest
import pyvista
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from regional_lv import config as study_config
from regional_lv.cli.check import check
from regional_lv.errors import InputError
from regional_lv.geometry.from_surfaces import LEVEL_ENDS, mesh_surfaces
from regional_lv.geometry.mesh import BASE, ENDOCARDIUM, EPICARDIUM, read_mesh
from regional_lv.geometry.triangulated import read_ventricle
from regional_lv.measured.curves import read_curve_subject

# Half axes (mm) of ellipsoids of revolution, across and along, and how far the epicardium lies
# towards anterior: the anterior wall is the thickest, septum and lateral wall are alike.
ENDO, EPI = (24.0, 70.0), (35.0, 80.0)
SHIFT_MM = 3.0
# The files' frame: x of the shapes is the septum's side, y is anterior, z leads from apex to base.
TURN = Rotation.from_euler("xyz", [40, -110, 75], degrees=True).as_matrix()
ORIGIN = np.array([120.0, -45.0, 310.0])
SEPTUM, NORMAL = TURN[:, 0], TURN[:, 2]
ROWS = {
    "circumferential": 24,
    "basal": 1,
    "basal_grading": 1.0,
    "mid": 1,
    "apical": 1,
    "apex": 1,
    "transmural": 1,
}


def ellipsoid(across, along, top=0.0, around=72, rows=48):
    """Points (n, 3) and triangles (m, 3) below z = top; the whole of it if top exceeds `along`."""
    closed = top >= along
    latitude = np.linspace(-np.pi / 2, np.arcsin(min(top / along, 1)), rows + 1)[1:]
    latitude = latitude[:-1] if closed else latitude
    u, phi = np.meshgrid(latitude, 2 * np.pi * np.arange(around) / around, indexing="ij")
    r = across * np.cos(u)
    rings = np.stack([r * np.cos(phi), r * np.sin(phi), along * np.sin(u)], axis=-1)
    poles = [[0, 0, -along], [0, 0, along]]
    points = np.concatenate([poles[:1], rings.reshape(-1, 3), *([poles[1:]] if closed else [])])
    at = np.arange(around)
    following = (at + 1) % around
    faces = [np.stack([0 * at, 1 + following, 1 + at], axis=1)]
    for k in range(len(latitude) - 1):
        a, b = 1 + k * around + at, 1 + k * around + following
        faces += [np.stack([a, b, b + around], 1), np.stack([a, b + around, a + around], 1)]
    if closed:
        last = 1 + (len(latitude) - 1) * around
        faces.append(np.stack([last + at, last + following, 0 * at + len(points) - 1], axis=1))
    return points, np.concatenate(faces)


def volume_below(across, along, top):
    """Volume (mL) of an ellipsoid below z = top."""
    inside = top + along - (top**3 + along**3) / (3 * along**2)
    return np.pi * across**2 * inside / 1e3


def save(path, points, faces, turn=TURN, unit=1.0):
    pyvista.PolyData.from_regular_faces((points @ turn.T + ORIGIN) / unit, faces).save(path)
    return path


@pytest.fixture
def pair(tmp_path):
    """Writes endocardium and epicardium, changed or not, and returns the two paths."""

    def write(endo=None, epi=None, top=0.0, suffix="stl", turn=TURN, unit=1.0):
        shapes = {"endo": ellipsoid(*ENDO, top), "epi": ellipsoid(*EPI, top)}
        shapes["epi"][0][:, 1] += SHIFT_MM
        for name, change in (("endo", endo), ("epi", epi)):
            shapes[name] = shapes[name] if change is None else change(*shapes[name])
        return [
            save(tmp_path / f"{name}.{suffix}", *shape, turn, unit)
            for name, shape in shapes.items()
        ]

    return write


def in_files(*point):
    return (TURN @ point + ORIGIN).tolist()


def mesh_of(paths, surfaces, folder, fibres):
    given = {"unit": "mm", "base": None, "septum": None, "insertions": None} | surfaces
    names = ("mesh.msh", "mesh.vtu", "segments.csv", "summary.json")
    mesh_surfaces(*paths, given, ROWS, fibres, *(folder / name for name in names))
    summary = json.loads((folder / "summary.json").read_text())
    table = pd.read_csv(folder / "segments.csv").set_index("aha_segment")
    return read_mesh(folder / "mesh.vtu"), table, summary


# --- what is meshed --------------------------------------------------------------------------


def test_base_cut_surfaces_in_a_frame_of_their_own(pair, tmp_path, smoke_config):
    paths = pair()
    mesh, table, summary = mesh_of(
        paths, {"septum": SEPTUM.tolist()}, tmp_path, smoke_config["fibres"]
    )
    cavity, outside = (volume_below(*axes, 0.0) for axes in (ENDO, EPI))
    assert summary["cavity_volume_ml"] == pytest.approx(cavity, rel=0.01)
    assert summary["wall_volume_ml"] == pytest.approx(outside - cavity, rel=0.01)
    assert max(summary["fit_mm"].values()) < 0.2
    # The frame: the rims' plane, its middle, and the septum's middle between segments 2 and 3.
    rotation, origin = (np.array(summary["frame"][key]) for key in ("rotation", "origin_mm"))
    assert np.linalg.det(rotation) == pytest.approx(1)
    np.testing.assert_allclose(origin, ORIGIN, atol=1e-3)
    np.testing.assert_allclose(rotation @ NORMAL, [0, 0, 1], atol=1e-5)
    angle = np.radians(150)
    np.testing.assert_allclose(rotation @ SEPTUM, [np.cos(angle), np.sin(angle), 0], atol=1e-5)
    assert table["angle_from_deg"][2] == table["angle_to_deg"][3] == 150
    assert table["angle_from_deg"][8] == table["angle_to_deg"][9] == 150
    assert table["angle_from_deg"][14] == 105 and table["angle_to_deg"][14] == 195
    # Anterior is where the wall is thick, inferior where it is thin; they are not exchanged.
    thickness = table["thickness_mm"]
    assert thickness[1] > thickness[[2, 6]].max() > thickness[[3, 5]].max() > thickness[4]
    assert thickness[2] == pytest.approx(thickness[6], rel=1e-3)
    centre = mesh.points[mesh.cells[mesh.segment == 1]].reshape(-1, 3).mean(axis=0)
    in_file = rotation.T @ centre
    assert in_file @ TURN[:, 1] > 20 and abs(in_file @ SEPTUM) < 0.5
    # Thirds of the cavity's length.
    inner = np.unique(mesh.facets[mesh.surface == ENDOCARDIUM])
    for segment, share in zip((1, 7, 13), LEVEL_ENDS, strict=True):
        own = np.intersect1d(mesh.cells[mesh.segment == segment], inner)
        assert mesh.points[own, 2].min() == pytest.approx(-share * ENDO[1], abs=0.3)
    base = mesh.points[np.unique(mesh.facets[mesh.surface == BASE])]
    assert np.abs(base[:, 2]).max() < 1e-5
    apex = mesh.points[np.unique(mesh.facets[mesh.surface == EPICARDIUM])][:, 2].min()
    assert apex == pytest.approx(-EPI[1], rel=0.005)


def test_closed_surfaces_in_centimetres(pair, tmp_path, smoke_config):
    """Cut below their widest place; the insertions show the septum."""
    paths = pair(top=np.inf, suffix="ply", unit=10.0)
    top = -8.0
    corner = 35 * np.array([np.cos(np.radians(60)), np.sin(np.radians(60))])
    points = {
        "anterior": in_files(*corner, top - 10),
        "inferior": in_files(corner[0], -corner[1], top - 10),
    }
    given = {
        "unit": "cm",
        "base": {
            "point": (np.array(in_files(3, 4, top)) / 10).tolist(),
            "normal": list(2 * NORMAL),
        },
        "insertions": {name: (np.array(p) / 10).tolist() for name, p in points.items()},
    }
    _, _, summary = mesh_of(paths, given, tmp_path, smoke_config["fibres"])
    cavity, outside = (volume_below(*axes, top) for axes in (ENDO, EPI))
    assert summary["cavity_volume_ml"] == pytest.approx(cavity, rel=0.01)
    assert summary["wall_volume_ml"] == pytest.approx(outside - cavity, rel=0.01)
    turned = np.array(summary["frame"]["rotation"]) @ SEPTUM
    assert np.degrees(np.arctan2(turned[1], turned[0])) == pytest.approx(150, abs=0.1)


def test_a_lid_on_the_base_changes_nothing(pair):
    def lid(points, faces):
        rim = np.flatnonzero(points[:, 2] > -1e-9)
        centre = len(points)
        cover = np.stack([rim, np.roll(rim, -1), np.full(len(rim), centre)], axis=1)
        return np.concatenate([points, [[0, 0, 0]]]), np.concatenate([faces, cover])

    base = {"point": in_files(0, 0, 0), "normal": NORMAL.round(4).tolist()}
    open_, closed = (
        read_ventricle(*pair(endo=e, epi=e), base=base, septum=SEPTUM) for e in (None, lid)
    )
    assert closed.cavity_volume_ml == pytest.approx(open_.cavity_volume_ml, rel=1e-4)
    assert closed.wall_volume_ml == pytest.approx(open_.wall_volume_ml, rel=1e-4)


def test_an_uneven_rim_is_cut_off_and_said(pair, caplog):
    def ragged(points, faces):
        points = points.copy()
        rim = points[:, 2] > -1e-9
        points[rim, 2] += 2 * np.cos(3 * np.arctan2(points[rim, 1], points[rim, 0]))
        return points, faces

    with caplog.at_level(logging.WARNING):
        heart = read_ventricle(*pair(endo=ragged, suffix="vtp"), septum=SEPTUM)
    assert "2.0 mm below the base plane" in caplog.text
    assert heart.cavity_volume_ml == pytest.approx(volume_below(*ENDO, -2.0), rel=0.02)


# --- what is refused -------------------------------------------------------------------------


def shifted(*by):
    return lambda points, faces: (points + by, faces)


def scaled(factor):
    return lambda points, faces: (points * factor, faces)


def dented(points, faces):
    """Pushed out through the epicardium, 30 mm below the base, on the septum's side."""
    near = np.exp(-np.square((points - [21, 0, -30]) / 8).sum(axis=1))
    return points + 16 * near[:, None] * [1, 0, 0], faces


def pierced(points, faces):
    away = np.linalg.norm(points[faces].mean(axis=1) - [0, 21, -30], axis=1)
    return points, faces[away > 5]


def doubled(points, faces):
    inner = points * [0.9, 0.9, 0.95]
    return np.concatenate([points, inner]), np.concatenate([faces, faces + len(points)])


def crumbled(points, faces):
    crumb = np.array([[0, 0, -30], [3, 0, -30], [0, 3, -30], [0, 0, -33]], dtype=float)
    tetra = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])
    return np.concatenate([points, crumb]), np.concatenate([faces, tetra + len(points)])


def walled(points, faces):
    """A triangle inside, on an edge of the surface."""
    a, b = faces[40][:2]
    return np.concatenate([points, [[0, 0, -40]]]), np.concatenate([faces, [[a, b, len(points)]]])


def wrinkled(points, faces):
    """Rolled over itself 30 mm below the base, all around."""
    points = points.copy()
    points[:, 2] += 14 * np.exp(-np.square((points[:, 2] + 30) / 5))
    return points, faces


def bulging(by):
    """On the septum's side, from the base to the apical level."""

    def change(points, faces):
        away = np.arctan2(points[:, 1], points[:, 0]) / 0.8
        scale = 1 + by / EPI[0] * np.exp(-np.square(away) - np.square(points[:, 2] / 50))
        return points * np.column_stack([scale, scale, np.ones_like(scale)]), faces

    return change


def thin(points, faces):
    """Pushed out to the epicardium but for 0.3 mm, on the septum's side."""
    near = np.exp(-np.square((points - [21, 0, -30]) / 14).sum(axis=1))
    return points + 10.5 * near[:, None] * [1, 0, 0], faces


def with_a_point_at(x):
    def lose(points, faces):
        points = points.copy()
        points[7, 0] = x
        return points, faces

    return lose


GIVEN_BASE = {"point": in_files(0, 0, 0), "normal": NORMAL.tolist()}


@pytest.mark.parametrize(
    ("files", "given", "messages"),
    [
        ({"endo": scaled(0.001), "epi": scaled(0.001)}, {}, ["in metres, set", "unit to m"]),
        ({}, {"unit": "cm"}, ["mm long", "in millimetres, set", "unit to mm"]),
        ({"epi": scaled(0.1)}, {}, ["epi.stl", "epi.stl like centimetres: save both in one unit"]),
        ({"endo": scaled(4), "epi": scaled(4)}, {}, ["between 30 and 200 are possible"]),
        ({"endo": with_a_point_at(1e30)}, {}, ["endo.stl: the ventricle is 1e+30 mm long"]),
        (
            {"endo": with_a_point_at(np.nan), "suffix": "ply"},
            {},
            ["endo.ply: holds points that are no numbers (NaN); export it again"],
        ),
        ({"epi": shifted(0, 90, 0)}, {}, ["epi.stl: lies around", "save both in one frame"]),
        ({"endo": dented}, {}, ["endo.stl: crosses", "mm below the base; correct the surfaces"]),
        ({"endo": pierced}, {}, ["endo.stl: the endocardium has a hole at", "close it"]),
        ({"endo": pierced, "top": np.inf}, {"base": GIVEN_BASE}, ["has a hole at", "close it"]),
        ({"endo": crumbled}, {}, ["endo.stl: below the base", "2 pieces, the largest with"]),
        ({"endo": walled}, {}, ["endo.stl: 1 edges belong to more than two triangles"]),
        ({"epi": doubled}, {}, ["epi.stl: below the base the epicardium falls into 2 pieces"]),
        ({"endo": wrinkled}, {}, ["endo.stl", "is hidden from the long axis by", "smooth"]),
        (
            {"epi": bulging(35)},
            {},
            ["epi.stl: seems to hold the right ventricle too", "septal)", "ventricle alone"],
        ),
        ({"endo": thin}, {}, ["endo.stl: lies 0.", "septal)", "at least 0.5 mm thick"]),
        ({"top": np.inf}, {}, ["endo.stl: is a closed surface", "geometry.surfaces.base.point"]),
        (
            {},
            {"base": GIVEN_BASE | {"point": in_files(0, 0, 12)}},
            ["endo.stl: the endocardium ends at", "12 mm below the base plane"],
        ),
        (
            {"top": np.inf},
            {"base": GIVEN_BASE | {"point": in_files(0, 0, 85)}},
            ["endo.stl: lies 15 to 155 mm below the base plane, which must cut it"],
        ),
        (
            {},
            {"base": GIVEN_BASE | {"normal": (-NORMAL).tolist()}},
            ["the base plane, which must cut it"],
        ),
        (
            {"top": 20.0},
            {"base": GIVEN_BASE | {"normal": (-NORMAL).tolist()}},
            ["endo.stl: nearly all of it lies above", "normal: [", "correct geometry"],
        ),
        (
            {"top": 20.0},
            {"base": {"point": in_files(0, 0, -15), "normal": (NORMAL + SEPTUM).tolist()}},
            ["geometry.surfaces.base: the apex", "degrees off the normal"],
        ),
        ({}, {"septum": None}, ["geometry.surfaces.septum: give the direction"]),
        ({}, {"septum": [0, 0, 0]}, ["geometry.surfaces.septum", "parallel to the long axis"]),
        ({}, {"septum": (NORMAL + 0.1 * SEPTUM).tolist()}, ["parallel to the long axis"]),
        (
            {},
            {"insertions": {"anterior": [1, 2, 3], "inferior": None}},
            ["geometry.surfaces.septum: give", "and not both"],
        ),
    ],
)
def test_refused(files, given, messages, pair):
    paths = pair(**files)
    with pytest.raises(InputError) as error:
        read_ventricle(*paths, **({"septum": SEPTUM.tolist()} | given))
    for message in messages:
        assert message in str(error.value)


def test_a_hypertrophied_septum_is_no_right_ventricle(pair):
    assert read_ventricle(*pair(epi=bulging(13)), septum=SEPTUM).wall_volume_ml > 130


def test_exchanged_files(pair):
    with pytest.raises(InputError, match=r"mL; exchange geometry.surfaces.endocardium and"):
        read_ventricle(*pair()[::-1], septum=SEPTUM)


def test_the_place_of_a_crossing_is_in_the_files_frame(pair):
    with pytest.raises(InputError, match="crosses") as error:
        read_ventricle(*pair(endo=dented), septum=SEPTUM)
    depth = float(re.search(r"crosses .*epi.stl by up to ([\d.]+) mm", str(error.value))[1])
    assert depth == pytest.approx(4.5, abs=1.5)
    assert "(segment 8, mid anteroseptal)" in str(error.value) or "segment 9" in str(error.value)
    place = str(error.value).split(" at (")[1].split(")")[0]
    local = TURN.T @ (np.array([float(x) for x in place.split(",")]) - ORIGIN)
    assert np.linalg.norm(local - [33, 0, -30]) < 15


def test_insertions_notice_a_mirrored_heart(pair):
    points = {
        side: np.array([17.5, y, -15.0]) for side, y in (("anterior", 33.0), ("inferior", -27.0))
    }
    mirror = TURN @ np.diag([1.0, -1.0, 1.0])
    right, wrong = (
        {side: (turn @ p + ORIGIN).tolist() for side, p in points.items()}
        for turn in (TURN, mirror)
    )
    heart = read_ventricle(*pair(), insertions=right)
    assert np.degrees(np.arccos((heart.rotation @ SEPTUM)[0])) == pytest.approx(150, abs=5)
    with pytest.raises(InputError, match="exchange the two, or, if they are right, the surfaces"):
        read_ventricle(*pair(turn=mirror), insertions=wrong)
    far = right | {"inferior": in_files(90, 0, 0)}
    with pytest.raises(InputError, match=r"insertions.inferior: lies 5\d.* mm from the epicardium"):
        read_ventricle(*pair(), insertions=far)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("none.stl", None, "no such file"),
        (
            "heart.off",
            "OFF",
            "the format .off is not read; save it as .stl, .ply, .obj, .vtp or .vtk",
        ),
        ("text.stl", "not a surface", "holds no triangles, or is no STL file"),
        ("text.ply", "not a surface", "text.ply: its header is not that of a PLY file"),
        ("text.vtp", "not a surface", "holds no triangles, or is no VTP file"),
        ("empty.stl", "solid heart\nendsolid heart\n", "holds no triangles"),
    ],
)
def test_unreadable_files(name, content, message, pair, tmp_path):
    path = tmp_path / name
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError) as error:
        read_ventricle(path, pair()[1], septum=SEPTUM)
    assert str(path) in str(error.value)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "geometry.surfaces.endocardium: missing"),
        ({"endocardium": "none.stl"}, "geometry.surfaces.endocardium: there is no file none.stl"),
        ({}, "geometry.surfaces.septum: the septum's side is unknown"),
        (
            {"septum": [1, 0, 0], "insertions": {"anterior": [0, 0, 1], "inferior": [0, 1, 1]}},
            "geometry.surfaces.septum: the septum's side is given twice",
        ),
        ({"insertions": {"anterior": [0, 0, 1]}}, "geometry.surfaces.insertions: one is missing"),
        ({"base": {"point": [0, 0, 1]}}, "geometry.surfaces.base: half of it is missing"),
        ({"septum": [1, 0]}, "geometry.surfaces.septum"),
        ({"unit": "inch"}, "choose one of mm, cm, m"),
        ({"long_axis": "z"}, "choose one of apex, base_normal"),
    ],
)
def test_bad_config(given, message):
    config = {"study": "mine", "geometry": {"source": "surfaces", "surfaces": given}}
    with pytest.raises(InputError) as error:
        study_config.load(config)
    assert message in str(error.value)


@pytest.mark.parametrize("lost", [10, 50, 5000])
def test_a_file_that_is_cut_off_is_refused(lost, pair):
    """Also at the end of a triangle, where VTK reads what is left."""
    path, other = pair()
    path.write_bytes(path.read_bytes()[:-lost])
    with pytest.raises(InputError, match=r"endo\.stl: announces \d+ triangles and holds \d+;"):
        read_ventricle(path, other, septum=SEPTUM)


def test_a_damaged_file_is_refused_in_own_words(pair, caplog):
    path, other = pair()
    path.write_text("solid heart\n facet normal a b c\n")
    with pytest.raises(InputError, match=r"endo\.stl: holds no triangles, or is no STL file"):
        read_ventricle(path, other, septum=SEPTUM)
    assert not caplog.records  # VTK's


def test_the_example_is_checked_from_any_folder(tmp_path, monkeypatch, root):
    """Its paths count from the folder of its configuration; its curves give back the strains that
    they were made from. (Made up here: the simulation takes a minute.)"""
    mine = tmp_path / "mine"
    shutil.copytree(root / "config/examples/surfaces", mine)
    runpy.run_path(str(mine / "make_surfaces.py"), run_name="__main__")
    strains = {"circumferential": -0.13, "radial": 0.4, "longitudinal": -0.15}
    rows = [
        {"quantity": quantity, "segment": segment, "value": value * (1 + 0.01 * segment)}
        for quantity, value in strains.items()
        for segment in range(1, 18)
    ]
    table = pd.DataFrame(rows)
    curves = runpy.run_path(str(mine / "make_curves.py"))["curves_of"](table)
    curves.to_csv(mine / "curves.csv", index=False)
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(check, ["mine/config.yaml"])
    assert done.exit_code == 0, done.output
    assert "geometry mine/endocardium.stl and mine/epicardium.stl" in done.output
    assert "cavity 86.7 mL, wall 109.2 mL" in done.output
    assert (mine / "check.png").stat().st_size > 20_000
    subject = study_config.load(mine / "config.yaml")["subjects"]["synthetic_patient"]
    found = read_curve_subject(subject).table
    found = found[found["quantity"] != "volume"].merge(table, on=["quantity", "segment"])
    assert len(found) == 51
    assert np.allclose(found["value_x"], found["value_y"], atol=5e-5)
