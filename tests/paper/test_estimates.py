"""Point estimates against closed forms, of global and local emulators; what is written of them."""

import json

import numpy as np
import pandas as pd
import pytest
import torch

from regional_lv import emulators
from regional_lv.emulators.training import train_emulator
from regional_lv.paper.estimates import least_squares, reference
from regional_lv.paper.estimates.check import first_cases
from regional_lv.paper.estimates.efficiency import measure_efficiency
from regional_lv.paper.estimates.estimate import (
    estimate_parameters,
    localised,
    measure_cost,
    true_column,
)
from regional_lv.paper.estimates.least_squares import find_least_squares
from tests.paper.conftest import CHANNELS, PARAMETERS
from tests.paper.test_likelihood import THETA, linear

POINT = {"starts": 3, "iterations": 60}


def simulate(theta: np.ndarray) -> np.ndarray:
    """52 smooth outputs from which all ten parameters can be told."""
    return _simulate(torch.as_tensor(theta)).numpy()


def _simulate(theta: torch.Tensor) -> torch.Tensor:
    x = theta.log()
    mixture = torch.as_tensor(np.random.default_rng(0).normal(0, 0.1, (10, 42)))
    return torch.cat([x + 0.1 * x**2, torch.tanh(x @ mixture)], dim=-1)


def table(rows: int, seed: int, low: float = 0.1, high: float = 5.0) -> pd.DataFrame:
    theta = np.exp(np.random.default_rng(seed).uniform(np.log(low), np.log(high), (rows, 10)))
    y = simulate(theta)
    columns = {"sample": np.arange(rows)} | dict(zip(PARAMETERS.names, theta.T, strict=True))
    frame = pd.DataFrame(columns | dict(zip(CHANNELS.names, y.T, strict=True)))
    slopes = torch.func.vmap(torch.func.jacrev(_simulate))(torch.as_tensor(theta))
    frame["sensitivity"] = list(slopes.reshape(rows, -1).numpy())
    return frame


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Screened tables and three small emulators trained on one of them."""
    folder = tmp_path_factory.mktemp("estimates")
    table(90, 1).to_parquet(folder / "train.parquet")
    table(4, 2, 0.4, 3.0).to_parquet(folder / "test.parquet")
    settings = {
        "exact_gp": {"iterations": 40},
        "local_mgp": {"neighbours": 60, "iterations": 5, "kernel": "rbf"},
        "dnn": {"epochs": 60, "hidden": [32]},
    }
    for name, own in settings.items():
        files = folder / f"{name}.pt", folder / f"{name}.json"
        train_emulator(name, own, folder / "train.parquet", PARAMETERS, CHANNELS, 1, *files)
    return folder


def test_least_squares_is_the_closed_form_where_that_lies_inside():
    emulator = linear(0.05)
    y = emulator.predict(THETA).mean + 0.02
    theta, objective = find_least_squares(emulator, y, 3, 100, 5, 2, seed=1)
    scaled = emulator.slopes / emulator.output_sd[:, None]
    target = (y - emulator.base) / emulator.output_sd
    expected = torch.linalg.lstsq(scaled, target.T).solution.T
    torch.testing.assert_close(theta, expected, rtol=1e-5, atol=1e-6)
    rest = target - expected @ scaled.T
    torch.testing.assert_close(objective, rest.square().sum(1), rtol=1e-4, atol=1e-9)


def test_least_squares_stays_within_the_bounds():
    emulator = linear(0.05)
    emulator.slopes, _ = torch.linalg.qr(emulator.slopes)
    emulator.output_sd = torch.ones_like(emulator.output_sd)
    beyond = torch.full((1, 10), 2.0, dtype=torch.float64)
    beyond[0, 3], beyond[0, 6] = 7.0, -1.0
    theta, _ = find_least_squares(
        emulator, emulator.base + beyond @ emulator.slopes.T, 3, 200, 5, 0, seed=1
    )
    torch.testing.assert_close(theta[0], beyond[0].clamp(0.1, 5.0), rtol=0, atol=1e-5)


class Wavy:
    """A slope and a wave in log theta: the squares of one parameter have troughs 0.63 apart."""

    lower, upper, output_sd = (torch.full((n,), v).double() for n, v in ((1, 0.1), (1, 5), (3, 1)))

    def predict_mean(self, theta):
        x = theta.log()
        return torch.cat([0.3 * x, torch.sin(10 * x), torch.cos(10 * x)], dim=-1)

    def linearise(self, theta):
        x = theta.log()
        slopes = [0.3 + 0 * x, 10 * torch.cos(10 * x), -10 * torch.sin(10 * x)]
        return self.predict_mean(theta), (torch.cat(slopes, dim=-1) / theta)[..., None]


def test_hops_lead_out_of_a_trough(monkeypatch):
    """Two screened points leave some starts in wrong troughs; those that are right stay."""
    monkeypatch.setattr(least_squares, "SCREENED_PER_START", 2)
    truth = torch.linspace(-1.6, 0.4, 5, dtype=torch.float64)[:, None].exp()
    y = Wavy().predict_mean(truth)
    plain, hopped = (find_least_squares(Wavy(), y, 1, 10, 5, hops, seed=2) for hops in (0, 30))
    right = (plain[0] - truth)[:, 0].abs() < 1e-6
    assert 0 < right.sum() < 5 and (plain[1] < 1e-9).tolist() == right.tolist()
    torch.testing.assert_close(hopped[0], truth, rtol=0, atol=1e-6)


def test_local_emulators_take_their_observations_one_by_one(folder):
    theta = torch.as_tensor(np.outer([0.3, 1.0, 3.0], np.ones(10)))
    y = torch.as_tensor(simulate(theta.numpy()))
    for name, count in (("exact_gp", 1), ("local_mgp", 3)):
        emulator = emulators.load(folder / f"{name}.pt")
        parts = list(localised(emulator, y))
        assert len(parts) == count
        assert torch.equal(torch.cat([observed for _, observed in parts]), y)
        for local, observed in parts:
            for row in observed:
                own = emulator.localise(row).predict_mean(theta)
                torch.testing.assert_close(local.predict_mean(theta), own)


@pytest.mark.parametrize("name", ["exact_gp", "local_mgp", "dnn"])
def test_table_of_estimates(folder, name, tmp_path):
    test = folder / "test.parquet"
    estimate_parameters(
        folder / f"{name}.pt",
        test,
        {"starts": 2, "iterations": 30},
        adam_steps=5,
        hops=2,
        seed=1,
        estimates=tmp_path / "e.parquet",
    )
    found = pd.read_parquet(tmp_path / "e.parquet")
    truth = pd.read_parquet(test)
    assert len(found) == 8 and set(found["estimator"]) == {"least_squares", "weighted"}
    for _, row in found.iterrows():
        true = truth.set_index("sample").loc[int(row["sample"]), list(PARAMETERS.names)]
        assert np.array_equal(true, row[[true_column(p) for p in PARAMETERS.names]].astype(float))
        estimate = row[list(PARAMETERS.names)].astype(float).to_numpy()
        assert np.isclose(row["mse"], ((estimate - true.to_numpy()) ** 2).mean())
        assert ((estimate >= 0.1) & (estimate <= 5.0)).all()
    if name != "dnn":
        # The middle of the box as an estimate has 2.5; so small a network hardly beats it.
        assert found["mse"].mean() < 0.2
    assert found["seconds"].gt(0).all() and found["outside"].dtype == bool
    measure_cost(folder / f"{name}.pt", test, tmp_path / "cost.json")
    cost = json.loads((tmp_path / "cost.json").read_text())
    assert cost["ms_gradient"] > 0 and cost["ms_prediction"] > 0
    if name == "local_mgp":
        assert cost["ms_localise"] > cost["ms_prediction"]


def test_stand_in_knows_the_test_cases(folder, tmp_path):
    """At the truth it comes closer than what was not trained on them."""
    test = pd.read_parquet(folder / "test.parquet")
    files = folder / "train.parquet", folder / "test.parquet"
    reference.fit_reference(files, PARAMETERS, CHANNELS, 1, tmp_path / "s.pt")
    estimates = test[["sample", *PARAMETERS.names]].assign(estimator="weighted")
    estimates.assign(sample=estimates["sample"].astype(str)).to_parquet(tmp_path / "e.parquet")
    files = tmp_path / "s.pt", tmp_path / "e.parquet"
    reference.predict_estimates(*files, 3, tmp_path / "c.parquet")
    checked = pd.read_parquet(tmp_path / "c.parquet")
    assert checked["sample"].tolist() == ["0", "1", "2"]
    assert checked["checked_by"].unique().tolist() == [reference.CHECKED_BY]
    error = checked[list(CHANNELS.names)].to_numpy() - test[list(CHANNELS.names)].to_numpy()[:3]
    with torch.no_grad():
        other = emulators.load(folder / "exact_gp.pt").predict_mean(
            torch.as_tensor(test[list(PARAMETERS.names)].to_numpy()[:3])
        )
    missed = other.numpy() - test[list(CHANNELS.names)].to_numpy()[:3]
    assert np.square(error).mean() < 0.5 * np.square(missed).mean()


def test_first_cases_keeps_both_estimators():
    estimates = pd.DataFrame({"sample": [*"312312"], "estimator": [*"aaabbb"]})
    assert first_cases(estimates, 2)["sample"].tolist() == [*"3131"]
    assert len(first_cases(estimates, None)) == 6


def test_error_falls_with_the_number_of_simulations(folder, tmp_path):
    files = folder / "train.parquet", folder / "test.parquet"
    for name in ("exact_gp", "gradient_gp"):
        measure_efficiency(
            name,
            "log",
            {"iterations": 20},
            PARAMETERS,
            CHANNELS,
            *files,
            [30, 20, 5000],
            30,
            POINT,
            1,
            tmp_path / f"{name}.csv",
        )
    plain, taught = (pd.read_csv(tmp_path / f"{n}.csv") for n in ("exact_gp", "gradient_gp"))
    assert plain["simulations"].tolist() == [20, 30, 90]
    assert taught["simulations"].tolist() == [20, 30]
    assert plain["predictive_mse"].iloc[-1] < plain["predictive_mse"].iloc[0]
    assert taught["predictive_mse"].iloc[1] < plain["predictive_mse"].iloc[1]
