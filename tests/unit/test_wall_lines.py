"""Lines through the wall never meet, so that ventricles of all shapes are meshed; what cannot be
meshed is said. All shapes are drawn here (synthetic)."""

import json

import numpy as np
import pytest

from regional_lv.aha import LEVELS
from regional_lv.geometry.fitted import LevelBorder, _latitude, aha_segment_at
from regional_lv.geometry.from_surfaces import mesh_surfaces
from regional_lv.geometry.mesh import BASE, read_mesh
from regional_lv.geometry.triangles import enclosed_volume
from regional_lv.geometry.triangulated import read_ventricle
from regional_lv.geometry.wall_lines import FAN, LEVEL_ENDS, QUARTER, WallLines
from regional_lv.verification.shapes import KINDS, SIDES, shapes

ROWS = {
    "circumferential": 16,
    "basal": 1,
    "basal_grading": 1.0,
    "mid": 1,
    "apical": 1,
    "apex": 1,
    "transmural": 1,
}


def drawn_lines(seed):
    rng = np.random.default_rng(seed)
    tilt, around = np.tan(np.radians(rng.uniform(0, 25))), rng.uniform(0, 2 * np.pi)
    slope = tilt * np.array([np.cos(around), np.sin(around)])
    length = rng.uniform(40, 120)
    return WallLines(length, length / rng.uniform(1.2, 4), slope), rng


@pytest.mark.parametrize("seed", range(8))
def test_lines_never_meet(seed):
    """At every distance from the axis they follow each other from the base down."""
    lines, rng = drawn_lines(seed)
    u = np.linspace(0, QUARTER, 400, endpoint=False)
    for phi, r in zip(
        rng.uniform(-4, 4, 20), rng.uniform(0.1, 0.95 * lines.length, 20), strict=True
    ):
        across = np.hypot(*lines.directions(phi + 0 * u, u)[:, :2].T)
        z = lines.points(phi + 0 * u, u, r / across)[:, 2]
        assert (np.diff(z) < 0).all()


@pytest.mark.parametrize("seed", range(8))
def test_coordinates_are_those_of_the_points(seed):
    lines, rng = drawn_lines(seed)
    phi, u = rng.uniform(-3, 3, 200), rng.uniform(0.001, QUARTER - 0.001, 200)
    distance = rng.uniform(0.2, 2.5, 200)
    found = lines.coordinates(lines.points(phi, u, distance))
    np.testing.assert_allclose(found, [phi, u, distance], atol=1e-6)


def test_where_the_lines_lie():
    lines = WallLines(80.0, 25.0, (0.2, -0.1))
    phi, none = np.linspace(-3, 3, 20), np.zeros(20)
    base = lines.points(phi, none, none + 1.7)
    np.testing.assert_allclose(base[:, 2], 0.2 * base[:, 0] - 0.1 * base[:, 1], atol=1e-9)
    pole = lines.points(phi, none + QUARTER, none + 1)
    np.testing.assert_allclose(pole, np.tile([0, 0, -80], (20, 1)), atol=1e-9)
    level = WallLines(80.0, 25.0)
    upper = level.points(phi, none + np.arcsin(FAN), none + 1.7)
    np.testing.assert_allclose(upper[:, 2], -80 * FAN)


@pytest.mark.parametrize("seed", range(8))
def test_latitudes_between_borders_rise_towards_the_pole(seed):
    """Also where the lowest border comes much closer to the pole on one side than on another."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(-np.pi, np.pi, 60, endpoint=False)
    lowest = 1.1 + rng.uniform(0.2, 0.4) * np.cos(angle - rng.uniform(-3, 3))
    borders = [LevelBorder(angle, share * lowest, np.ones(60)) for share in (0.3, 0.6, 1.0)]
    radii = [1 - border.mean / QUARTER for border in borders]
    rho = np.linspace(0, 1, 300)
    for phi in angle[::5]:
        u = _latitude(borders, radii, phi + 0 * rho, rho)
        assert (np.diff(u) < 0).all()
        assert u[0] == pytest.approx(QUARTER) and u[-1] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    ("degrees", "share", "segment"),
    [
        (250, 0.1, 1),
        (150.1, 0.1, 2),
        (149.9, 0.1, 3),
        (60, 0.5, 10),
        (240, 0.8, 13),
        (150, 0.8, 14),
        (-30, 0.8, 16),
        (10, 0.95, 17),
    ],
)
def test_segment_at_a_place(degrees, share, segment):
    assert aha_segment_at(np.radians(degrees), share) == segment


# --- meshes ----------------------------------------------------------------------------------


def mesh(shape, folder, fibres, **more):
    section = shape.write(folder) | more
    files = [folder / name for name in ("mesh.msh", "mesh.vtu", "segments.csv", "summary.json")]
    mesh_surfaces(*(section[side] for side in SIDES), section, ROWS, fibres, *files)
    return read_mesh(files[1]), json.loads(files[3].read_text())


@pytest.fixture(scope="module")
def made(tmp_path_factory, smoke_config):
    """Mesh and summary of one shape of each kind."""
    return {
        shape.kind: mesh(shape, tmp_path_factory.mktemp("shape"), smoke_config["fibres"])
        for shape in shapes(1, seed=11)
    }


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_meshed(kind, made):
    found, summary = made[kind]
    assert summary["scaled_jacobian_min"] > 0.1
    assert max(summary["fit_mm"].values()) < 0.5
    for side in SIDES:
        assert summary["fit_mm"][f"{side}_rms"] < 0.2
    assert max(map(abs, summary["volume_deviation_percent"].values())) < 1.5
    # The base is plane, and the cavity's apex lies on the axis.
    base = found.points[found.nodes_on(BASE)]
    offset = base - base.mean(axis=0)
    assert np.abs(offset @ np.linalg.svd(offset)[2][2]).max() < 1e-4
    assert summary["long_axis_mm"] == pytest.approx(
        -found.points[np.hypot(*found.points[:, :2].T) < 1e-6, 2].max()
    )


@pytest.mark.parametrize("kind", KINDS)
def test_levels_end_in_planes_perpendicular_to_the_long_axis(kind, made):
    """On both sides of the wall, as those of a segment table, however the base is sloped."""
    found, summary = made[kind]
    nodes = [np.unique(found.cells[np.isin(found.segment, own), :8]) for own in LEVELS.values()]
    for above, below, share in zip(nodes[:-1], nodes[1:], LEVEL_ENDS, strict=True):
        z = found.points[np.intersect1d(above, below), 2]
        assert np.ptp(z) < 0.5
        assert z.mean() == pytest.approx(-share * summary["long_axis_mm"], abs=0.1)


def test_all_meshes_have_the_same_topology(made):
    first, *others = (found for found, _ in made.values())
    for found in others:
        for part in ("cells", "segment", "facets", "surface", "transmural"):
            np.testing.assert_array_equal(getattr(found, part), getattr(first, part))


@pytest.mark.parametrize(("long_axis", "tilt"), [("apex", (14, 26)), ("base_normal", (0, 1e-6))])
def test_long_axis(long_axis, tilt, tmp_path):
    shape = next(shape for shape in shapes(1, seed=4) if shape.kind == "oblique base")
    section = shape.write(tmp_path)
    ends = (section[side] for side in SIDES)
    heart = read_ventricle(*ends, septum=shape.septum, long_axis=long_axis)
    x, y, z = heart.base_normal
    assert tilt[0] <= np.degrees(np.arctan2(np.hypot(x, y), z)) <= tilt[1]
    away = heart.origin + heart.rotation.T @ [0, 0, -heart.lines.length]
    lowest = shape.endocardium.points[
        np.linalg.norm(shape.endocardium.points - heart.origin, axis=1).argmax()
    ]
    if long_axis == "apex":
        assert np.linalg.norm(away - lowest) < 5
    assert heart.cavity_volume_ml == pytest.approx(enclosed_volume_of(shape), rel=1e-3)


def enclosed_volume_of(shape):
    """Of a surface that is open in a plane through the middle of its rim."""
    rim = shape.endocardium.extract_feature_edges(
        feature_edges=False, manifold_edges=False, non_manifold_edges=False
    )
    moved = shape.endocardium.copy()
    moved.points = moved.points - rim.points.mean(axis=0)
    return enclosed_volume(moved)
