"""Hearts of any size and pressure by one: what is looked up is what would be simulated."""

import numpy as np
import pytest
import torch

from regional_lv.aha import LEVELS
from regional_lv.channels import Channels
from regional_lv.data import VOLUNTEER, VOLUNTEER_AHA
from regional_lv.emulators.base import Prediction
from regional_lv.geometry.described import log_volumes
from regional_lv.geometry.from_config import make_heart
from regional_lv.geometry.table import read_segments
from regional_lv.hearts.by_surfaces import BySurfaces
from regional_lv.hearts.emulator import HeartEmulator
from regional_lv.hearts.reach import by_table
from regional_lv.inputs.space import Inputs, sections_of
from regional_lv.simulation.ventricles import Ventricles
from regional_lv.study.layout import HeartFiles
from regional_lv.verification.shapes import shapes

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

    def predict(self, x):
        mean = self.predict_mean(x)
        return Prediction(mean, mean.new_zeros(*mean.shape, mean.shape[1]))

    def predict_mean(self, x):
        return torch.as_tensor(np.stack([self._ventricles.outputs(row) for row in x.numpy()]))


def at_values(inputs, **values):
    x = inputs.nominal
    for name, value in values.items():
        x[inputs.names.index(name)] = value
    return x


def test_a_heart_is_known_from_another_size_and_pressure(small_mesh, known, heart, tmp_path):
    inputs = Inputs.from_config(sections_of(heart)).simulated
    values = {"septal_load": 3.0, "basal_motion": 5.0, "basal_twist": 0.4, "helix_endo": 12.0}
    values |= {"epicardial_support": 0.02, "length": 90.0}
    values |= {"C_a_anterior": 1.8, "C_b_septal": 0.7}
    x = at_values(inputs, **values)
    by_another = HeartEmulator(Simulated(small_mesh, known), known, inputs)
    found = by_another.predict_mean(torch.as_tensor(x)[None])[0].numpy()
    direct = Ventricles(make_heart(heart, HeartFiles(f"{tmp_path}/")), inputs).outputs(x)
    channels = Channels.from_config(heart)
    volume = channels.of_quantity("volume")
    np.testing.assert_allclose(found[volume], direct[volume], rtol=1e-6)
    np.testing.assert_allclose(found[~volume], direct[~volume], atol=1e-6)


def test_a_heart_is_known_by_its_figures_over_other_segments(smoke_config, tmp_path):
    """The volunteer's own levels and apical sectors, by a simulator of the AHA's."""
    mesh = {"circumferential": 24, "basal": 2, "mid": 2, "apical": 2, "apex": 1, "transmural": 1}
    roles = {"inputs": SHAPE | {"level_end": "inferred", "septal_load": "suspected"}}
    own = smoke_config | {
        "mesh": smoke_config["mesh"] | mesh,
        "inputs": {"septal_load": "suspected"},
    }
    aha = {"geometry": own["geometry"] | {"segments": VOLUNTEER_AHA}}
    known = Inputs.from_config(sections_of(own | aha | roles)).simulated
    inputs = Inputs.from_config(sections_of(own)).simulated
    simulated = Simulated(make_heart(own | aha, HeartFiles(f"{tmp_path}/aha/")), known)
    x = at_values(inputs, septal_load=3.0, C_a_anterior=1.8, C_b_septal=0.7, C_a_apical=0.6)
    found = HeartEmulator(simulated, known, inputs).predict(torch.as_tensor(x)[None])
    direct = Ventricles(make_heart(own, HeartFiles(f"{tmp_path}/")), inputs).outputs(x)
    error = found.mean[0].numpy() - direct
    channels = Channels.from_config(own)
    largest = {"volume": 0.4, "circumferential": 0.01, "longitudinal": 0.008, "radial": 0.02}
    for quantity, most in largest.items():
        assert np.abs(error[channels.of_quantity(quantity)]).max() < most
    stated = found.sd[0].numpy()
    assert 0.5 < np.sqrt(np.mean((error / stated) ** 2)) < 1.5
    # More than that is not known of apical segments, which are turned by 30 degrees.
    apical = np.array([channel.segment in LEVELS["apical"] for channel in channels])
    circumferential = channels.of_quantity("circumferential")
    assert stated[apical & circumferential].min() > 1.1 * stated[~apical & circumferential].max()


def test_what_a_table_leaves_out_of_surfaces(smoke_config, tmp_path):
    """A ventricle that is drawn here (synthetic) is another one by its table; what that changes is
    known without having seen it."""
    drawn = next(shape for shape in shapes(1, seed=77) if shape.kind == "uneven")
    surfaces = {"source": "surfaces", "surfaces": drawn.write(tmp_path)}
    own = smoke_config | {"geometry": smoke_config["geometry"] | surfaces, "inputs": {}}
    described = by_table(own, tmp_path / "segments.csv")
    found = []
    for name, config in (("own", own), ("table", described)):
        inputs = Inputs.from_config(sections_of(config)).simulated
        ventricle = Ventricles(make_heart(config, HeartFiles(f"{tmp_path}/{name}/")), inputs)
        found.append(torch.as_tensor(ventricle.outputs(inputs.nominal))[None])
    by_own, by_segments = found
    geometry, channels = described["geometry"], ventricle.channels
    apices = geometry["endo_apex_z_mm"], geometry["epi_apex_z_mm"]
    volumes = log_volumes(read_segments(geometry["segments"]), *apices)
    change = BySurfaces.of(channels, inputs, volumes)
    corrected = change(by_segments, torch.as_tensor(inputs.nominal)[None])
    for quantity, least in (("circumferential", 2.0), ("radial", 1.3)):
        at = [channel.quantity == quantity for channel in channels]
        errors = ((each - by_own)[:, at] for each in (by_segments, corrected))
        before, after = (each.square().mean().sqrt() for each in errors)
        assert before > least * after
