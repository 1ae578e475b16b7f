"""From roles to one emulator: a design over all inputs, simulated, screened and learnt."""

import json

import numpy as np
import pandas as pd
import pytest
import torch

from regional_lv.channels import Channels
from regional_lv.emulators import load
from regional_lv.emulators.errors_by_causes import judge
from regional_lv.emulators.training import read_sensitivities, read_simulations, train_emulator
from regional_lv.inputs.space import Inputs, sections_of
from regional_lv.mechanics.predictor import fit_predictor
from regional_lv.simulation.batches import simulate_batch, solve_anchors, solve_baseline
from regional_lv.simulation.design import write_inputs_design
from regional_lv.simulation.screening import screen_simulations

SIZES = {"train": 32, "test": 8}
ROLES = {
    "septal_load": "suspected",
    "basal_motion": "suspected",
    "strain_measure": "suspected",
    "wall_thickness": {"role": "measured", "sd": 0.05},
}


@pytest.fixture(scope="module")
def study(smoke_config):
    """One zone, at two loads."""
    sections = {"design": smoke_config["design"] | {"lower": 0.4, "upper": 2.5}}
    sections |= {"parameters": smoke_config["parameters"] | {"zones": "whole"}, "inputs": ROLES}
    frames = {"frames": [0.5]}
    return smoke_config | sections | {"loading": smoke_config["loading"] | frames}


@pytest.fixture(scope="module")
def inputs(study):
    return Inputs.from_config(sections_of(study)).simulated


@pytest.fixture(scope="module")
def made(small_mesh, study, inputs, tmp_path_factory):
    """Folder with everything that the workflow's rules make of the roles."""
    folder, physics = tmp_path_factory.mktemp("inputs"), sections_of(study)
    files = {name: folder / f"{name}.npz" for name in ("start", "fields", "predictor")}
    designs = {name: folder / f"design_{name}.parquet" for name in SIZES}
    channels = Channels.from_config(study)
    for name, size in SIZES.items():
        write_inputs_design(physics, name, size, 7, designs[name])
    solve_baseline(small_mesh, physics, files["start"], folder / "baseline.json")
    given = (small_mesh, files["start"], designs["train"], physics, 10, 1, "0000")
    solve_anchors(*given, files["fields"], folder / "anchors.parquet")
    fit_predictor([files["fields"]], physics, files["predictor"])
    for name, size in SIZES.items():
        anchors = [folder / "anchors.parquet"] if name == "train" else []
        batch = folder / f"batch_{name}.parquet"
        given = (small_mesh, files["predictor"], designs[name], physics, size, "0", name)
        simulate_batch(*given, batch, anchors)
        tables = (folder / f"{name}.parquet", folder / f"{name}.csv", folder / f"{name}_sums.csv")
        screen_simulations([batch], inputs.coordinates, channels, *tables)
    settings = {"hyperparameter_rows": 32}
    given = (folder / "train.parquet", inputs.coordinates, channels, 7)
    train_emulator("joint_gp", settings, *given, folder / "emulator.pt", folder / "fit.json")
    return folder


def test_every_simulation_converges_from_the_anchors(made):
    for name, size in SIZES.items():
        table = pd.read_parquet(made / f"{name}.parquet")
        assert len(table) == size
    anchors, table = (pd.read_parquet(made / f"{n}.parquet") for n in ("anchors", "train"))
    again = table[table["sample"].isin(anchors["sample"])]
    assert again["cpu_s"].tolist() == anchors.sort_values("sample")["cpu_s"].tolist()
    rest = table[~table["sample"].isin(anchors["sample"])]
    assert rest["newton_steps"].median() <= 6


def test_the_model_as_it_is_starts_it_all(made):
    """At the reference material, which the paper's table says of, too."""
    found = json.loads((made / "baseline.json").read_text())["observables_theta_1"]
    assert 110 < found["volume_ml"] < 200 and found["volume_ml@0.5"] < found["volume_ml"]


def test_one_emulator_has_values_and_derivatives_of_all(made, inputs):
    emulator = load(made / "emulator.pt")
    given = made / "test.parquet", inputs.coordinates, emulator.outputs
    theta, y, _ = read_simulations(*given)
    exact = torch.as_tensor(read_sensitivities(*given))
    mean, slopes = emulator.linearise(torch.as_tensor(theta))
    error = (mean - torch.as_tensor(y)).square().mean(0).sqrt()
    assert (error < 0.15 * emulator.output_sd).all()
    # In what an input does over its range, of what outputs vary by.
    size = torch.as_tensor(inputs.upper - inputs.lower) / emulator.output_sd[:, None]
    off = ((slopes - exact) * size).square().mean((0, 1)).sqrt()
    known = (exact * size).square().mean((0, 1)).sqrt()
    assert (off < 0.35 * known).all(), dict(zip(inputs.names, (off / known).tolist(), strict=True))


def test_errors_by_how_many_causes_are_on(made, inputs):
    suspected = inputs.subset(inputs.of_role("suspected"))
    nominal = dict(zip(suspected.names, suspected.nominal.tolist(), strict=True))
    judge(made / "emulator.pt", made / "test.parquet", nominal, made / "errors.csv")
    table = pd.read_csv(made / "errors.csv")
    assert set(table["quantity"]) == {"volume", "circumferential", "radial", "longitudinal"}
    rows = table[table["quantity"] == "volume"].set_index("on")
    theta, *_ = read_simulations(made / "test.parquet", inputs.coordinates, ["volume_ml"])
    on = (theta[:, 2:] != inputs.nominal[2:])[:, inputs.of_role("suspected")[2:]].sum(axis=1)
    for label, row in rows.iterrows():
        wanted = len(on) if label == "all" else (np.minimum(on, 4) == int(label[0])).sum()
        assert row["simulations"] == wanted
    assert (table["rms_error"] >= table["median_error"]).all()
    assert table["coverage95"].between(0, 1).all()
    assert table.loc[table["on"] == "all", "coverage95"].mean() > 0.7
