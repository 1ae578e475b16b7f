"""Other thickness, radius and length of a heart from surfaces, as of one from a segment table."""

from dataclasses import replace

import numpy as np
import pytest

from regional_lv.geometry.from_config import make_heart
from regional_lv.geometry.from_mesh import measured_segments
from regional_lv.geometry.mesh import read_mesh
from regional_lv.geometry.shape import SIZES, NodePlaces
from regional_lv.geometry.summary import cavity_volume, scaled_jacobians
from regional_lv.inputs.space import Inputs, sections_of
from regional_lv.study.layout import HeartFiles
from regional_lv.verification.shapes import shapes

COARSE = {"circumferential": 16, "basal": 2, "mid": 1, "apical": 1, "apex": 1, "transmural": 1}
SHAPE = {"segment_thickness": "inferred", "endo_radius": "inferred", "length": "inferred"}


@pytest.fixture(scope="module")
def heart(smoke_config, tmp_path_factory):
    """Mesh, inputs and moving nodes of a ventricle that is drawn (synthetic)."""
    folder = tmp_path_factory.mktemp("drawn")
    drawn = next(shape for shape in shapes(1, seed=77) if shape.kind == "uneven")
    geometry = {"source": "surfaces", "surfaces": drawn.write(folder)}
    config = smoke_config | {
        "geometry": smoke_config["geometry"] | geometry,
        "mesh": smoke_config["mesh"] | COARSE,
        "inputs": SHAPE,
    }
    mesh = read_mesh(make_heart(config, HeartFiles(f"{folder}/")))
    inputs = Inputs.from_config(sections_of(config))
    return mesh, inputs, NodePlaces(mesh, inputs.base["geometry"])


def moved(heart, share):
    """The mesh with figures times `share` of an input's name."""
    mesh, inputs, places = heart
    x = [value * share(name) for name, value in zip(inputs.names, inputs.nominal, strict=True)]
    return replace(mesh, points=places(inputs.model(x)["geometry"]))


def only(name, times):
    return lambda each: times if each == name else 1.0


def test_its_own_figures_leave_it_as_it_is(heart):
    mesh, inputs, places = heart
    np.testing.assert_allclose(places(inputs.base["geometry"]), mesh.points, atol=1e-9)
    # The table's smooth wall is another one: what is between them moves along.
    shape = inputs.base["geometry"]
    assert np.linalg.norm(places._table_wall(shape)[0] - mesh.points, axis=1).max() > 1.0


@pytest.mark.parametrize("times", [0.9, 1.1])
def test_a_thicker_segment(heart, times):
    before, after = (
        measured_segments(each)
        for each in (heart[0], moved(heart, only("wall_thickness_8", times)))
    )
    change = (after["thickness_mm"] / before["thickness_mm"] - 1).to_numpy() / (times - 1)
    assert 0.7 < change[7] < 1.1
    assert np.abs(np.delete(change, 7)).max() < 0.4
    assert cavity_volume(moved(heart, only("wall_thickness_8", times))) == pytest.approx(
        cavity_volume(heart[0]), rel=1e-9
    )


def test_a_longer_cavity(heart):
    longer = moved(heart, only("length", 1.05))
    assert cavity_volume(longer) / cavity_volume(heart[0]) == pytest.approx(1.05, abs=0.005)


@pytest.mark.parametrize("times", [0.75, 1.3])
def test_a_wall_at_the_end_of_its_range_does_not_fold(heart, times):
    whole = moved(heart, lambda name: times if name.startswith("wall_thickness") else 1.0)
    uneven = moved(
        heart, lambda name: times if name in ("wall_thickness_2", "wall_thickness_9") else 1.0
    )
    for each in (whole, uneven):
        assert scaled_jacobians(each).min() > 0.2


@pytest.mark.parametrize("scale", [1.0, 1.2])
def test_derivatives_of_the_points_are_those_of_differences(heart, scale):
    _, inputs, places = heart
    shape = {**inputs.base["geometry"], "wall_thickness_scale": scale}
    shape["wall_thickness_mm"] = 1.05 * shape["wall_thickness_mm"]
    found = places.moves(shape, ())
    for name in SIZES:
        for k in (0, 8, 16) if np.ndim(shape[name]) else [None]:
            sides = []
            for step in (1e-4, -1e-4):
                value = np.array(shape[name], dtype=float)
                value[() if k is None else k] += step
                sides.append(places({**shape, name: value if k is not None else float(value)}))
            expected = (sides[0] - sides[1]) / 2e-4
            own = found[name] if k is None else found[name][k]
            np.testing.assert_allclose(own, expected, atol=1e-4)
