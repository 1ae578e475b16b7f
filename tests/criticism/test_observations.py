"""What was observed, of channels of any quantity and at any load."""

import numpy as np
import pytest
import torch

from regional_lv.channels import Channels
from regional_lv.criticism.model import Layout
from regional_lv.criticism.observations import REACHED, contrasts, noise_units, observe
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
    found = contrasts(observe({"a": table}, OtherToyEmulator(), 1.0))
    assert set(found["direction"]) == {"radial"}
    assert found["direction"]["radial"].sum() == 34
    assert found["level"]["basal radial"].sum() == 12
    assert found["wall"]["septal radial"].sum() == 10


def test_noise_that_is_inferred_has_a_scale_for_each_quantity(table):
    o = observe({"a": table.assign(sd=np.nan)}, OtherToyEmulator(), 1.0)
    assert tuple(o.noise.groups) == ("radial", "torsion")
    assert o.noise.units.shape == (2, len(CHANNELS))


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
    assert one.names == parameters.names and one.moves.shape == (1, p, p)
    np.testing.assert_allclose(one.low.exp(), parameters.lower)
    np.testing.assert_allclose(one.high.exp(), parameters.upper)
    theta = torch.as_tensor(np.tile(parameters.middle, (3, 1)))
    common = Layout.known(theta, parameters)
    assert common.names == ("log factor C_a", "log factor C_b")
    assert common.moves.shape == (3, p, 2) and common.moves.sum(-1).eq(1).all()
    np.testing.assert_allclose(common.high.exp(), np.sqrt([50.0, 4.0]))
    single = Layout.known(theta[:, :1], Parameterisation(ZONES["whole"], factors=["C_a"]))
    assert single.names == ("log factor C_a",)
