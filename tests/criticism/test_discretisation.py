"""What a finer mesh changes, learnt from simulations on both whose difference is known."""

import json

import numpy as np
import pandas as pd
import pytest
import torch

from regional_lv.criticism.confirmation import Correction
from regional_lv.criticism.discretisation import FinerMesh, OnFinerMesh, train_discretisation
from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.criticism.extension import Extension
from regional_lv.errors import InputError
from regional_lv.physics import physics_of
from tests.criticism.toy import CHANNELS, OUTPUTS, PARAMETERS, ToyEmulator

STUDY = ToyEmulator()
TILT = torch.as_tensor(np.random.default_rng(3).normal(0, 0.03, (52, 10)))


def on_finer_mesh(theta):
    """Stretches are larger by half a percent to one, depending on theta; the volume by as much."""
    base = STUDY.predict_mean(theta)
    d = 0.007 * torch.exp(theta.log() @ TILT.T)
    strain = ((1 + 2 * base[..., 1:]) * torch.exp(2 * d[..., 1:]) - 1) / 2
    return torch.cat([base[..., :1] * torch.exp(d[..., :1]), strain], -1)


def table(thetas, outputs_of, failed=()):
    rows = []
    for sample, theta in enumerate(thetas):
        row = {"sample": sample, "status": "converged", "reason": "", "cpu_s": 1.0}
        row |= dict(zip(PARAMETERS.names, theta.tolist(), strict=True))
        row |= dict(zip(OUTPUTS, outputs_of(theta).tolist(), strict=True))
        slope = torch.autograd.functional.jacobian(outputs_of, theta)
        row["sensitivity"] = slope.ravel().tolist()
        if sample in failed:
            row |= dict.fromkeys(OUTPUTS, np.nan) | {"status": "failed", "sensitivity": []}
        rows.append(row)
    return pd.DataFrame(rows)


def train(folder, config, fine):
    thetas = np.exp(np.random.default_rng(1).uniform(np.log(0.3), np.log(4.0), (36, 10)))
    coarse = table(torch.as_tensor(thetas), STUDY.predict_mean)
    # A simulation that the screening took out, and one that failed on the finer mesh.
    coarse[coarse["sample"] != 5].to_parquet(folder / "train.parquet")
    fine(torch.as_tensor(thetas)).to_parquet(folder / "batch-0.parquet")
    train_discretisation(
        *(folder / "train.parquet", [folder / "batch-0.parquet"], physics_of(config)),
        *(PARAMETERS, CHANNELS, 3, folder / "discretisation.pt", folder / "discretisation.json"),
    )
    return folder


@pytest.fixture(scope="module")
def trained(tmp_path_factory, smoke_config):
    folder = tmp_path_factory.mktemp("discretisation")
    return train(folder, smoke_config, lambda t: table(t[:30], on_finer_mesh, failed=[9]))


@pytest.fixture(scope="module")
def corrected(trained):
    state = torch.load(trained / "discretisation.pt", weights_only=True)
    return OnFinerMesh(STUDY, Extension.from_state("", state, FinerMesh()))


@pytest.fixture(scope="module")
def theta():
    return torch.as_tensor(np.exp(np.random.default_rng(2).uniform(-0.7, 0.7, (8, 10))))


def test_it_predicts_what_the_finer_mesh_gives(corrected, trained, theta):
    truth, before = on_finer_mesh(theta), STUDY.predict_mean(theta)
    assert (truth - before)[:, 1:].abs().mean() > 4e-3
    torch.testing.assert_close(corrected.predict_mean(theta), truth, rtol=0, atol=2e-3)
    assert (corrected.predict_mean(theta) - truth)[:, 1:].abs().mean() < 2e-4
    predicted = corrected.predict(theta)
    torch.testing.assert_close(predicted.mean, corrected.predict_mean(theta))
    assert (predicted.sd > STUDY.predict(theta).sd).all()
    report = json.loads((trained / "discretisation.json").read_text())
    assert report["anchors"] == 28 and report["relative_error"] < 0.1


def test_derivatives_are_those_of_the_mean(corrected, theta):
    mean, by_theta = corrected.linearise(theta)
    torch.testing.assert_close(mean, corrected.predict_mean(theta))
    h = 1e-5
    for k in (0, 7):
        step = torch.zeros_like(theta)
        step[:, k] = h
        beside = [corrected.predict_mean(theta + side * step) for side in (1, -1)]
        torch.testing.assert_close(
            by_theta[..., k], (beside[0] - beside[1]) / (2 * h), rtol=1e-3, atol=1e-4
        )


def test_some_outputs_are_those_of_all(corrected, theta):
    names = ("radial_05", "volume_ml")
    chosen = corrected.select(names)
    at = [OUTPUTS.index(name) for name in names]
    assert chosen.outputs == names
    torch.testing.assert_close(chosen.predict_mean(theta), corrected.predict_mean(theta)[:, at])


def test_sets_are_simulated_on_the_finer_mesh(corrected, theta):
    """Of what an effect does there, the correction adds what the emulators lack; of the base model
    it leaves what has been corrected already."""
    model = ExtendedEmulator(corrected)
    thetas, scaled = theta[:, None], torch.zeros(len(theta), 1, 1).double()
    more = torch.zeros(52).double()
    more[20] = 0.05
    mean, slopes = corrected.linearise(thetas)
    by_log_theta = slopes * thetas[..., None, :]
    found = Correction.fit(model, thetas, scaled, mean + more, by_log_theta)
    torch.testing.assert_close(found.value[0], more, rtol=0, atol=1e-6)


def test_too_few_on_the_finer_mesh(tmp_path, smoke_config):
    with pytest.raises(InputError, match="fewer than 12 simulations converged on the finer mesh"):
        train(tmp_path, smoke_config, lambda t: table(t[:12], on_finer_mesh, failed=[0]))
