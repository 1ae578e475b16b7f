"""Pictures of the heart: the nearer hides the farther, lines lie on the faces they run along."""

import numpy as np
import pytest
import pyvista

from regional_lv.plots import heart

RED, BLUE = (255, 0, 0), (0, 0, 255)
ANGLE = np.radians(heart.VIEW_ANGLE_DEG)
TOWARDS = np.array([np.cos(ANGLE), np.sin(ANGLE), 0.0])


def cubes(size: float, *centres: np.ndarray) -> pyvista.UnstructuredGrid:
    """Cubes of eight elements in two segments each, axes along the picture's, with the number of
    the cube as cell data."""
    across = np.array([-TOWARDS[1], TOWARDS[0], 0.0])
    blocks = []
    for number, centre in enumerate(centres):
        cube = pyvista.ImageData(dimensions=(3, 3, 3), origin=3 * (-0.5,), spacing=3 * (0.5,))
        block = cube.cast_to_unstructured_grid()
        turned = block.points @ np.array([across, TOWARDS, [0, 0, 1]]) * size + centre
        block.points = turned
        block.cell_data["segment"] = 1 + np.arange(8) % 2 + 2 * number
        block.cell_data["cube"] = np.full(8, number)
        blocks.append(block)
    return pyvista.merge(blocks) if len(blocks) > 1 else blocks[0]


def colours_of(grid: pyvista.UnstructuredGrid) -> np.ndarray:
    return np.array([RED, BLUE])[grid.cell_data["cube"]]


def reddish(picture: np.ndarray) -> np.ndarray:
    return (picture[..., 0] > 100) & (picture[..., 2] < 50)


def bluish(picture: np.ndarray) -> np.ndarray:
    return (picture[..., 2] > 100) & (picture[..., 0] < 50)


@pytest.mark.parametrize("first", ["near", "far"])
def test_the_nearer_hides_the_farther(first):
    near, far = 40 * TOWARDS, -40 * TOWARDS
    # Along the line of sight, so that they are drawn in the same place.
    rise = np.array([0, 0, 40 * np.tan(np.radians(heart.TILT_DEG))])
    near, far = near + rise, far - rise
    grid = cubes(20, near, far) if first == "near" else cubes(20, far, near)
    rgb = colours_of(grid) if first == "near" else colours_of(grid)[:, ::-1]
    picture = heart.render(grid, rgb, borders={})
    assert picture.shape == (heart.PIXELS[1], heart.PIXELS[0], 3)
    assert reddish(picture).mean() > 0.3
    # Cubes of one size in one place: nothing is left of the farther one but rounded edges.
    assert bluish(picture).mean() < 0.001


def test_a_picture_is_centred_and_fits():
    picture = heart.render(cubes(20, np.array([300.0, -200.0, 50.0])), np.array(8 * [RED]), {})
    rows, columns = np.nonzero((picture < 250).any(axis=2))
    height, width = picture.shape[:2]
    assert rows.min() + rows.max() == pytest.approx(height, abs=3)
    assert columns.min() + columns.max() == pytest.approx(width, abs=3)
    assert max(np.ptp(rows) / height, np.ptp(columns) / width) == pytest.approx(0.96, abs=0.01)


def test_borders_lie_where_segments_meet_and_only_there():
    grid = cubes(20, np.zeros(3))
    without = heart.render(grid, np.array(8 * [RED]), {})
    picture = heart.render(grid, np.array(8 * [RED]), {"segment": 0.3})
    changed = (picture != without).any(axis=2)
    rows, columns = np.nonzero(changed)
    # Segments differ along `across`: one vertical line on the front, its continuation on top.
    assert np.ptp(columns) < 0.04 * picture.shape[1]
    inside = reddish(without)
    assert np.ptp(rows) == pytest.approx(np.ptp(np.nonzero(inside.any(axis=1))[0]), rel=0.05)
    assert picture[changed].min(axis=1).max() > 200


def test_lines_are_drawn_in_their_colours():
    grid = cubes(20, np.zeros(3))
    ends = 10 * TOWARDS + np.array([[0, 0, -5.0], [0, 0, 5.0]])
    line = pyvista.PolyData(ends, lines=[2, 0, 1])
    line.point_data["rgb"] = np.array([BLUE, BLUE], dtype=np.uint8)
    picture = heart.render(grid, np.array(8 * [RED]), {}, lines=line)
    rows, _ = np.nonzero(bluish(picture))
    cube_rows = np.nonzero(reddish(picture).any(axis=1))[0]
    share = np.ptp(rows) / np.ptp(cube_rows)
    # Half of the front's height, of which a tilted view shows the front and the top.
    tilt = np.radians(heart.TILT_DEG)
    assert share == pytest.approx(0.5 / (1 + np.tan(tilt)), abs=0.05)
