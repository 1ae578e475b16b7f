"""A small emulator of any heart, of a made-up simulator, and a heart within its reach."""

import numpy as np
import pandas as pd
import pytest
import torch
import yaml

from regional_lv import config as study_config
from regional_lv.channels import Channels
from regional_lv.data import VOLUNTEER
from regional_lv.emulators import create
from regional_lv.geometry.table import read_segments
from regional_lv.hearts.card import ship
from regional_lv.hearts.design import draw_hearts
from regional_lv.hearts.file import read
from regional_lv.inputs.space import Inputs, sections_of

ROLES = {
    "segment_thickness": {"role": "inferred", "range": [2.6, 32]},
    "endo_radius": {"role": "inferred", "range": [2.5, 47]},
    "apex": {"role": "inferred", "range": [2.6, 32]},
    "basal_end": {"role": "inferred", "range": [0.15, 0.38]},
    "mid_end": {"role": "inferred", "range": [0.54, 0.72]},
    "apical_end": {"role": "inferred", "range": [0.66, 0.93]},
    "septal_load": "suspected",
    "basal_motion": "suspected",
    "helix_endo": "suspected",
    "strain_measure": "suspected",
}
SEPTUM = [2, 3, 8, 9, 14]
ZONES = {"septal": SEPTUM, "free": [s for s in range(1, 18) if s not in SEPTUM]}
SIMULATIONS = 120
SIGNS = {"volume": 1.0, "circumferential": -0.3, "longitudinal": -0.3, "radial": 0.6}


def outputs_of(inputs, channels):
    """A function from values (M, E) of the inputs to outputs (M, D): logarithms are linear in the
    scaled inputs, but for a product."""
    rng = np.random.default_rng(3)
    low, high = (inputs.coordinates.scaled(ends) for ends in (inputs.lower, inputs.upper))
    middle = inputs.coordinates.scaled(inputs.reference)
    weight = rng.normal(size=(len(channels), len(inputs))) / len(inputs) ** 0.5
    weight, width, middle = (torch.as_tensor(each) for each in (weight, high - low, middle))
    signs = torch.tensor([SIGNS[channel.quantity] for channel in channels]).double()
    volume = torch.as_tensor(channels.of_quantity("volume"))

    def outputs(x):
        z = (inputs.coordinates.scaled(x) - middle) / width
        stretch = 0.1 * signs * (4 + 0.6 * z @ weight.T + 0.3 * z[..., :1] * z[..., 1:2])
        place = inputs.names.index("strain_measure")
        n = x[..., place : place + 1] + 1e-9
        return torch.where(volume, 110 * stretch.exp(), torch.expm1(n * stretch) / n)

    return outputs


@pytest.fixture(scope="session")
def of_population(smoke_config):
    """Sections of the study that makes the emulator: two zones, some causes."""
    parameters = smoke_config["parameters"] | {"zones": ZONES, "bounds": {"C_a": [0.08, 10.0]}}
    return sections_of(smoke_config | {"inputs": ROLES, "parameters": parameters})


@pytest.fixture(scope="session")
def made(of_population, tmp_path_factory):
    """Files of training: `emulator.pt`, `test.parquet`, `summary.csv`."""
    folder = tmp_path_factory.mktemp("any_heart")
    inputs = Inputs.from_config(of_population).simulated
    channels = Channels.from_config(of_population)
    outputs, sets = outputs_of(inputs, channels), {}
    for name, n, seed in (("train", SIMULATIONS, 1), ("test", 20, 2)):
        table = draw_hearts(inputs, n, seed)
        theta = torch.as_tensor(table[list(inputs.names)].to_numpy(float))
        slopes = torch.func.vmap(torch.func.jacfwd(outputs))(theta)
        y = pd.DataFrame(outputs(theta).numpy(), columns=list(channels.names))
        sets[name] = table.join(y).assign(sample=range(n), scale="log")
        sets[name]["sensitivity"] = [row.ravel().tolist() for row in slopes]
        if name == "train":
            given = theta.numpy(), y.to_numpy(), slopes.numpy()
    settings = {"max_observations": 900, "hyperparameter_rows": 20, "iterations": 8}
    known = {"parameters": inputs.coordinates, "outputs": channels.names, "seed": 4}
    create("joint_gp", settings).fit(*given, **known).save(folder / "emulator.pt")
    sets["test"].to_parquet(folder / "test.parquet")
    summary = pd.DataFrame([{"simulations": SIMULATIONS, "cpu_s_median": 1.0}])
    summary.to_csv(folder / "summary.csv", index=False)
    return folder


@pytest.fixture(scope="session")
def file(made, of_population, smoke_config):
    """The file that would come with the package."""
    given = made / "emulator.pt", made / "test.parquet", made / "summary.csv"
    ship(*given, of_population, smoke_config["mesh"], 5, made / "shipped.pt.gz")
    return made / "shipped.pt.gz"


@pytest.fixture(scope="session")
def any_heart(file):
    return read(file)


@pytest.fixture
def heart(tmp_path, smoke_config, any_heart):
    """A function of sections of the configuration, and of a change of the segment table, that gives
    the checked configuration of a measured heart: larger than the volunteer's, at 12 mmHg."""

    def heart(change=None, **sections):
        table = read_segments(VOLUNTEER).drop(columns="line")
        table[["wall_thickness_mm", "endo_radius_mm", "z_top_mm", "z_bottom_mm"]] *= 1.2
        if change is not None:
            change(table)
        table.to_csv(tmp_path / "segments.csv", index=False)
        channels = any_heart.emulator.channels
        x = any_heart.known.reference
        y = any_heart.emulator.predict_mean(torch.as_tensor(x)[None])[0].numpy()
        size = np.where(channels.of_quantity("volume"), 1.2**3, 1.0)
        measured = pd.DataFrame(
            {
                "quantity": [channel.quantity for channel in channels],
                "segment": [channel.segment for channel in channels],
                "value": y * size,
                "unit": [channel.unit for channel in channels],
                "sd": np.where(channels.of_quantity("volume"), 2.0, 0.02),
            }
        )
        measured.to_csv(tmp_path / "measured.csv", index=False)
        content = {
            "study": "anna",
            "evaluation": False,
            "emulators": {"names": ["gradient_gp"], "final": "gradient_gp"},
            "mesh": smoke_config["mesh"],
            "parameters": {"zones": ZONES},
            "loading": {"pressure_mmhg": 12},
            "geometry": {
                "segments": "segments.csv",
                "endo_apex_z_mm": -1.2 * 74.4,
                "epi_apex_z_mm": -1.2 * 81.2,
            },
            "inputs": {
                "segment_thickness": {"role": "measured", "sd_mm": 1.0},
                "septal_load": "suspected",
                "basal_motion": "suspected",
                "radial_scale": "suspected",
                "mixed_frames": "suspected",
            },
            "criticism": {"bootstrap": 49, "level": 0.05},
            "subjects": {"anna": {"source": "file", "measured": "measured.csv"}},
        }
        (tmp_path / "config.yaml").write_text(yaml.safe_dump(content | sections))
        return study_config.load(tmp_path / "config.yaml")

    return heart
