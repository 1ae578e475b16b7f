"""What was observed, of channels of any quantity and at any load."""

import numpy as np
import pytest
import torch

from regional_lv import aha
from regional_lv.channels import Channels
from regional_lv.criticism.model import Layout
from regional_lv.criticism.observations import contrasts, observe
from regional_lv.inference.departure import REACHED, noise_units
from regional_lv.measured import synthetic_subject
from regional_lv.parameters import ZONES, Parameterisation
from tests.criticism.toy import ToyEmulator

CHANNELS = Channels.of(("volume", "radial", "torsion"), load_fractions=(0.5,))
NOISE = {"strain": 0.01, "volume": 1.0, "torsion": 0.02}


class OtherToyEmulator(ToyEmulator):
    """Has other channels; its predictions do not matter here."""

    def __init__(self):
        super().__init__()
        self.outputs, d = CHANNELS.names, len(CHANNELS)
        self.w, self.w2 = (torch.zeros(d, 10).double() for _ in range(2))
        self.centre = self.output_mean = torch.zeros(d).double()
        self.output_sd = torch.ones(d).double()
        self.output_covariance = torch.eye(d).double()


@pytest.fixture(scope="module")
def table():
    return synthetic_subject(np.zeros(len(CHANNELS)), CHANNELS, NOISE, np.zeros(len(CHANNELS)))


def test_groups_that_are_left_out_together(table):
    """A segment with all its loads; a quantity without segments at one load."""
    o = observe({"a": table}, OtherToyEmulator(), 1.0)
    assert list(o.group_names.values())[:4] == ["volume", "torsion", "volume@0.5", "torsion@0.5"]
    assert [o.group_names[n] for n in range(1, 18)] == [str(n) for n in range(1, 18)]
    named = {o.group_names[n]: mask for n, mask in o.groups.items()}
    assert np.array(o.outputs)[named["7"].numpy()].tolist() == ["radial_07", "radial_07@0.5"]
    assert np.array(o.outputs)[named["torsion@0.5"].numpy()].tolist() == [
        "torsion_basal-apical@0.5"
    ]
    assert torch.stack([*o.groups.values()]).sum(0).eq(1).all()
    few = table[table["output"].isin(["volume_ml", "radial_03", "radial_04@0.5"])]
    assert list(observe({"a": few}, OtherToyEmulator(), 1.0).group_names) == [0, 3, 4]


def test_contrasts_are_of_segments_at_all_loads(table):
    """Walls and levels hold the segments that are called after them."""
    o = observe({"a": table}, OtherToyEmulator(), 1.0)
    found = contrasts(o)
    assert list(found["direction"]) == ["radial"] and len(found["wall"]) == 4
    radial = [float(name.startswith("radial")) for name in o.outputs]
    assert found["direction"]["radial"].tolist() == radial
    for name, pattern in (found["level"] | found["wall"]).items():
        place = name.removesuffix(" radial")
        mine = [
            s.number for s in aha.SEGMENTS if s.name.startswith(place) or s.name.endswith(place)
        ]
        assert pattern.tolist() == [float(c.segment in mine) for c in o.channels], name


def test_noise_that_is_inferred_has_a_scale_for_each_quantity(table):
    o = observe({"a": table.assign(sd=np.nan)}, OtherToyEmulator(), 1.0)
    assert tuple(o.noise.groups) == ("radial", "torsion")
    own = [CHANNELS.of_quantity(quantity) for quantity in o.noise.groups]
    np.testing.assert_array_equal(o.noise.units, own)  # of an emulator whose sds are 1


def test_units_of_quantities_that_nobody_has_measured_yet(monkeypatch):
    spread = np.full(len(CHANNELS), 3.0)
    units = noise_units(CHANNELS, spread)
    assert units[CHANNELS.is_strain].tolist() == [0.01] * 34
    assert units[CHANNELS.of_quantity("volume")].tolist() == [1.0, 1.0]
    monkeypatch.delitem(REACHED, "torsion")
    torsion = CHANNELS.of_quantity("torsion")
    np.testing.assert_allclose(noise_units(CHANNELS, spread)[torsion], 0.3)


@pytest.mark.parametrize("zones", ["segments", "whole"])
def test_layouts_of_any_zones_and_bounds(zones):
    parameters = Parameterisation(ZONES[zones], bounds={"C_a": (0.1, 5.0), "C_b": (0.5, 2.0)})
    p = len(parameters)
    one = Layout.inferred(("a",), parameters)
    assert one.names == parameters.names and torch.equal(one.moves[0], torch.eye(p).double())
    np.testing.assert_allclose(one.low.exp(), parameters.lower)
    np.testing.assert_allclose(one.high.exp(), parameters.upper)
    # The softest and the stiffest heart say how far all of them can go.
    theta = torch.as_tensor(np.outer([1.0, 0.9, 1.2], parameters.middle))
    common = Layout.known(theta, parameters)
    assert common.names == ("log factor C_a", "log factor C_b")
    moved = [[float(name.startswith(factor)) for factor in ("C_a", "C_b")] for name in one.names]
    assert common.moves.tolist() == 3 * [moved]
    np.testing.assert_allclose(common.high.exp(), np.sqrt([50.0, 4.0]) / 1.2)
    np.testing.assert_allclose(common.low.exp(), 1 / np.sqrt([50.0, 4.0]) / 0.9)
    single = Layout.known(theta[:, :1], Parameterisation(ZONES["whole"], factors=["C_a"]))
    assert single.names == ("log factor C_a",)
