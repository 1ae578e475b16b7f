"""Hearts of any size and pressure by one: what is looked up is what would be simulated."""

import numpy as np
import pytest
import torch

from regional_lv.channels import Channels
from regional_lv.data import VOLUNTEER
from regional_lv.geometry.from_config import make_heart
from regional_lv.geometry.table import read_segments
from regional_lv.hearts.emulator import HeartEmulator
from regional_lv.inputs.space import Inputs, sections_of
from regional_lv.simulation.ventricles import Ventricles

SHAPE = {
    "segment_thickness": "inferred",
    "endo_radius": "inferred",
    "apex": "inferred",
    "wall_thickness": "fixed",
}
CAUSES = {
    "septal_load": "suspected",
    "basal_motion": "suspected",
    "basal_twist": "suspected",
    "epicardial_support": "suspected",
    "helix_endo": "suspected",
}
SCALE, PRESSURE = 1.25, 13.0
LENGTH_MM, APEX_MM = 74.4, 6.8


@pytest.fixture(scope="module")
def known(smoke_config):
    return Inputs.from_config(sections_of(smoke_config | {"inputs": SHAPE | CAUSES})).simulated


@pytest.fixture(scope="module")
def heart(smoke_config, tmp_path_factory):
    """A larger heart at a higher pressure, some segments thicker, and its length uncertain."""
    table = read_segments(VOLUNTEER).drop(columns="line")
    columns = ["wall_thickness_mm", "endo_radius_mm", "z_top_mm", "z_bottom_mm"]
    table[columns] *= SCALE
    table.loc[6, "wall_thickness_mm"] *= 1.1
    path = tmp_path_factory.mktemp("heart") / "segments.csv"
    table.to_csv(path, index=False)
    geometry = smoke_config["geometry"] | {
        "segments": str(path),
        "endo_apex_z_mm": -SCALE * LENGTH_MM,
        "epi_apex_z_mm": -SCALE * (LENGTH_MM + APEX_MM),
    }
    roles = CAUSES | {"length": {"role": "measured", "sd_mm": 2.0}}
    roles |= {"wall_thickness": "suspected", "endo_radius_8": {"role": "measured", "sd_mm": 1.0}}
    loading = smoke_config["loading"] | {"pressure_mmhg": PRESSURE}
    return smoke_config | {"geometry": geometry, "inputs": roles, "loading": loading}


class Simulated:
    """The simulator in place of an emulator of any heart."""

    def __init__(self, mesh, inputs):
        self._ventricles = Ventricles(mesh, inputs)
        self.channels = Channels.from_config(inputs.base)

    def at_fixed(self, values, mask):
        assert torch.isfinite(values[mask]).all()
        return self

    def predict_mean(self, x):
        return torch.as_tensor(np.stack([self._ventricles.outputs(row) for row in x.numpy()]))


def test_a_heart_is_known_from_another_size_and_pressure(small_mesh, known, heart, tmp_path):
    inputs = Inputs.from_config(sections_of(heart)).simulated
    x = inputs.nominal
    values = {"septal_load": 3.0, "basal_motion": 5.0, "basal_twist": 0.4, "helix_endo": 12.0}
    values |= {"epicardial_support": 0.02, "length": 90.0}
    values |= {"C_a_anterior": 1.8, "C_b_septal": 0.7}
    for name, value in values.items():
        x[inputs.names.index(name)] = value
    by_another = HeartEmulator(Simulated(small_mesh, known), known, inputs)
    found = by_another.predict_mean(torch.as_tensor(x)[None])[0].numpy()
    direct = Ventricles(make_heart(heart, tmp_path), inputs).outputs(x)
    channels = Channels.from_config(heart)
    volume = channels.of_quantity("volume")
    np.testing.assert_allclose(found[volume], direct[volume], rtol=1e-6)
    np.testing.assert_allclose(found[~volume], direct[~volume], atol=1e-6)
