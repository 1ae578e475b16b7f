"""A wall between two surfaces described by a segment table."""

from contextlib import nullcontext

import numpy as np
import pytest

from regional_lv.data import VOLUNTEER
from regional_lv.errors import InputError
from regional_lv.geometry import described
from regional_lv.geometry.described import (
    VOLUME_COLUMNS,
    describe_surfaces,
    log_volumes,
    part_volumes_ml,
)
from regional_lv.geometry.surfaces import Surfaces
from regional_lv.geometry.table import SD_COLUMNS, check_apices, read_segments

APICES = -74.4, -81.2


@pytest.fixture
def table():
    return read_segments(VOLUNTEER)


@pytest.fixture
def sides(table):
    """Points of the smooth surfaces through the volunteer's table."""
    surfaces = Surfaces(table, *APICES)

    def points(side, phi, u):
        r, z = side(phi, u)
        return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)

    return [
        lambda phi, u, side=side: points(side, phi, u)
        for side in (surfaces.endocardium, surfaces.epicardium)
    ]


def test_figures_are_those_of_the_surfaces(table, sides, tmp_path):
    borders = ["aha_segment", "angle_from_deg", "angle_to_deg", "z_top_mm", "z_bottom_mm"]
    found = describe_surfaces(*sides, table[borders])
    apices = found.endo_apex_z_mm, found.epi_apex_z_mm
    assert apices == pytest.approx(APICES)
    for column in SD_COLUMNS:
        np.testing.assert_allclose(found.table[column], table[column], rtol=5e-3)
    found.table.to_csv(tmp_path / "segments.csv", index=False)
    again = read_segments(tmp_path / "segments.csv")
    check_apices(tmp_path / "segments.csv", again, *apices)


@pytest.mark.parametrize(("radius", "says"), [(1.5, ""), (0.5, "is 0.5; a .* between 1 and 80")])
def test_a_small_cavity_ends_in_a_tip(radius, says, table, tmp_path, monkeypatch):
    """What is wrong is said of the surfaces, not of a table that the user has not written."""
    told = table.drop(columns="line")
    told.loc[16, "endo_radius_mm"] = radius
    found = described.TableOfHeart(told, *APICES)
    monkeypatch.setattr(described, "of_surfaces", lambda surfaces: found)
    described._cached.cache_clear()
    files = {"endocardium": "inner.stl", "epicardium": "outer.stl"}
    expected = pytest.raises(InputError, match=f"^inner.stl, outer.stl, segment 17: .*{says}")
    with expected if says else nullcontext():
        described.section_by_table(
            {"source": "surfaces", "surfaces": files}, tmp_path / "segments.csv"
        )
    described._cached.cache_clear()


def test_a_wall_that_is_thicker_all_over(table, sides):
    """By as much along its own lines, which leave the endocardium at an angle to these."""
    inner, outer = sides

    def farther(phi, u):
        points = outer(phi, u)
        return points * (1 + 2 / np.linalg.norm(points, axis=1))[:, None]

    borders = table.drop(columns=list(SD_COLUMNS))
    before, after = (describe_surfaces(inner, each, borders).table for each in (outer, farther))
    grown = after["wall_thickness_mm"] - before["wall_thickness_mm"]
    assert grown.between(1.4, 2.1).all()
    np.testing.assert_allclose(after["endo_radius_mm"], before["endo_radius_mm"])


def test_volumes_of_quarters(table):
    surfaces = Surfaces(table, *APICES)
    volumes = part_volumes_ml(surfaces, table)
    cavity, wall = surfaces.volumes()
    assert volumes[:, :4].sum() == pytest.approx(wall, rel=0.01)
    assert volumes[:, 4:].sum() == pytest.approx(cavity, rel=0.01)
    np.testing.assert_array_equal(log_volumes(table, *APICES), 0)
    # The wall has a tenth more, and the second part of the cavity alone, too.
    more = volumes * np.repeat([1.1, 1.0], 4) * np.tile([1.0, 1.1], 4) ** np.repeat([0, 1], 4)
    # As a file has them.
    told = table.assign(**dict(zip(VOLUME_COLUMNS, more.astype(str).T, strict=True)))
    found = log_volumes(told, *APICES)
    np.testing.assert_allclose(found[:, :2], np.log(1.1))
    share = volumes[:, 5::2] / (volumes[:, 4::2] + volumes[:, 5::2])
    np.testing.assert_allclose(found[:, 2:4], np.log(1 + 0.1 * share))
    np.testing.assert_allclose(found[:, 4:6], 0, atol=1e-9)
    np.testing.assert_allclose(found[:, 6:], np.log(1.1))
