"""What every observed quantity does."""

import numpy as np
import pytest

from regional_lv import config
from regional_lv.channels import Channel
from regional_lv.geometry.from_config import make_heart
from regional_lv.geometry.mesh import read_mesh
from regional_lv.geometry.meshing import write_plain
from regional_lv.mechanics.observables.observer import Observer
from regional_lv.quantities import QUANTITIES
from regional_lv.study.layout import HeartFiles
from regional_lv.testing.contract import Contract

COARSE = {"circumferential": 16, "basal": 1, "mid": 1, "apical": 1, "apex": 1, "transmural": 1}


def filled(places: np.ndarray) -> np.ndarray:
    """Displacement (n, 3) of places (n, 3) in mm: wider by 8 %, longer by 3 %, and twisted by
    0.05 degrees per mm."""
    x, y, z = places.T
    angle = np.radians(0.05) * z
    turned = np.stack(
        [x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)]
    )
    return np.column_stack([*(1.08 * turned), 1.03 * z]) - places


class QuantityContract(Contract):
    """Of a `quantities.base.Quantity`."""

    registry = QUANTITIES

    @pytest.fixture(scope="class")
    @classmethod
    def channels(cls, kind):
        """All that it can be observed as."""
        return [Channel(kind.name, place) for place in kind.places]

    @pytest.fixture(scope="class")
    @classmethod
    def mesh(cls, tmp_path_factory):
        """A heart in few elements."""
        study = config.load({"study": "contract", "mesh": COARSE})
        files = HeartFiles(f"{tmp_path_factory.mktemp('heart')}/")
        return read_mesh(make_heart(study, files, write_plain))

    @pytest.fixture(scope="class")
    @classmethod
    def observer(cls, mesh):
        return Observer(mesh, config.load({"study": "contract"})["observables"])

    def test_says_what_it_is(self, kind):
        assert kind.units[kind.unit] == 1.0 and kind.noise
        assert kind.limits[0] < kind.limits[1] and kind.sign in (-1, 0, 1)
        assert len({kind.column_of(place) for place in kind.places}) == len(kind.places) > 0
        assert set(kind.default_places or ()) <= set(kind.places)

    def test_values_of_a_filled_heart_are_plausible(self, kind, channels, observer, mesh):
        values = observer.values(channels, filled(mesh.points), 1.0)
        low, high = kind.limits
        assert ((low <= values) & (values <= high)).all() and (kind.sign * values >= 0).all()
        assert not kind.is_positive or (values > 0).all()

    def test_some_places_alone(self, channels, observer, mesh):
        whole = observer.values(channels, filled(mesh.points), 1.0)
        part = observer.values(channels[::-2], filled(mesh.points), 1.0)
        np.testing.assert_allclose(part, whole[::-2], rtol=1e-12)

    def test_moving_the_whole_heart_changes_nothing(self, channels, observer, mesh):
        """Along its axis and around it."""
        displacement = filled(mesh.points)
        cos, sin = np.cos(0.3), np.sin(0.3)
        turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        moved = (mesh.points + displacement) @ turn.T + [0, 0, 5.0] - mesh.points
        one, other = (observer.values(channels, each, 1.0) for each in (displacement, moved))
        np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-9)

    def test_derivatives_are_those_of_differences(self, channels, observer, mesh):
        """They follow if `values` and `densities` compute with torch alone."""
        displacement = filled(mesh.points)
        move = np.random.default_rng(0).normal(size=mesh.points.shape)
        _, slopes = observer.observe(channels, displacement, 1.0, move[None])
        h = 1e-5
        forth, back = (observer.values(channels, displacement + s * h * move, 1.0) for s in (1, -1))
        exact = (forth - back) / (2 * h)
        np.testing.assert_allclose(slopes[0], exact, rtol=1e-5, atol=1e-6 * np.abs(exact).max())
