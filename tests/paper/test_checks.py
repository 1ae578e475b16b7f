"""From posteriors in files to what they are worth: scenarios, samplers, calibration, simulator."""

import numpy as np
import pandas as pd
import pytest
import torch
from scipy import stats

from regional_lv import emulators
from regional_lv.inference.posteriors import load, write
from regional_lv.paper.posteriors import sets
from regional_lv.paper.posteriors.agreement import COLUMNS, compare_samplers
from regional_lv.paper.posteriors.classification import classify_zones, score_classification
from regional_lv.paper.posteriors.noise_prior import compare_noise_priors
from regional_lv.paper.posteriors.rank_calibration import calibrate_chain
from regional_lv.paper.posteriors.resimulation import compare_resimulated, pick_draws
from regional_lv.paper.sampler import sampling
from tests.paper.conftest import CHANNELS, PARAMETERS

FEW = {"chains": 2, "warmup": 50, "draws": 100, "rhat_max": 1.2, "ess_min": 0}
FEW["cases_per_batch"] = 3
POINT = {"starts": 2, "iterations": 60}


@pytest.fixture(scope="module")
def posteriors(study):
    """Of a scenario of four ventricles, two of them with a stiff septum."""
    table = pd.read_parquet(study / "test.parquet")
    table["zone"] = ["septal", "septal", "apical", "lateral"]
    table.to_parquet(study / "scenario.parquet")
    path = study / "checks.nc"
    sets.sample_set_batch(
        study / "emulator.pt",
        study / "scenario.parquet",
        "test",
        0,
        1,
        4,
        None,
        "importance",
        FEW,
        POINT,
        1,
        path,
    )
    return path


def test_zones_are_told_apart(study, posteriors):
    told = study / "told.csv"
    classify_zones([posteriors], {"mean": 1.0, "sd": 0.05}, told)
    table = pd.read_csv(told)
    assert len(table) == 4 * 5 * 3
    septal = table[table["zone"] == "septal"].groupby("case")["stiffened"].first()
    assert septal.tolist() == [True, True, False, False]
    # The probability is the share of draws above the edge.
    data = load(posteriors)
    draws = data.posterior["theta"].sel(parameter="C_b_septal")
    expected = (draws > 1.098).mean(("chain", "draw")).to_numpy()
    of_septal = table[(table["zone"] == "septal") & (table["quantity"] == "C_b")]
    np.testing.assert_allclose(of_septal["probability"], expected)
    score_classification(told, [], study / "roc.csv", study / "auc.csv", 1)
    auc = pd.read_csv(study / "auc.csv")
    assert auc.loc[auc["zone"] == "all", "positives"].tolist() == [4] * 3


def test_samplers_are_compared(study, posteriors):
    files = study / "emulator.pt", [posteriors]
    compare_samplers(*files, "test", 1, None, FEW, POINT, 1, study / "agreement.csv")
    table = pd.read_csv(study / "agreement.csv")
    assert tuple(table.columns) == COLUMNS and len(table) == 10
    assert (table["mean_difference_in_sd"].abs() < 6 * table["monte_carlo_error"]).all()


def test_no_case_of_the_fast_sampler_is_no_error(study, posteriors):
    data = load(posteriors)
    data.constant_data["sampler"][:] = "nuts"
    write(data, study / "by_nuts.nc")
    files = study / "emulator.pt", [study / "by_nuts.nc"]
    compare_samplers(*files, "test", 1, None, FEW, POINT, 1, study / "agreement.csv")
    assert pd.read_csv(study / "agreement.csv").empty


def test_chain_is_calibrated(study):
    names = [study / f"sbc_{name}.csv" for name in ("ranks", "histogram", "tests")]
    files = study / "emulator.pt", study / "test.parquet"
    calibrate_chain(*files, 6, "importance", FEW, POINT, 1, *names)
    ranks, histogram, tests = (pd.read_csv(name) for name in names)
    assert len(ranks) == 60 and ranks["rank"].between(0, 99).all()
    # Six cases prove little, but that no rank of sixty is stuck at an end they do.
    assert (ranks["rank"] == 0).mean() < 0.1 and (ranks["rank"] == 99).mean() < 0.1
    assert 25 < ranks["rank"].mean() < 75
    assert histogram.groupby("parameter")["count"].sum()["all"] == 60
    assert tests["parameter"].tolist()[-1] == "all"


def test_posterior_draws_go_through_the_simulator(study, posteriors):
    """A simulator that is the emulator's mean plus one sd everywhere."""
    pick_draws([posteriors], 2, 3, 1, study / "draws.parquet")
    design = pd.read_parquet(study / "draws.parquet")
    assert len(design) == 6 and design["case"].nunique() == 2
    assert design["sample"].tolist() == list(range(6)) and (design["scale"] == "posterior").all()
    emulator = emulators.load(study / "emulator.pt")
    prediction = emulator.predict(torch.as_tensor(design[list(PARAMETERS.names)].to_numpy()))
    values = (prediction.mean + prediction.sd).detach().numpy()
    simulated = pd.concat([design, pd.DataFrame(values, columns=list(CHANNELS.names))], axis=1)
    simulated.to_parquet(study / "resimulated.parquet")
    files = study / "resimulated.parquet", study / "test.parquet"
    results = study / "resimulated.csv", study / "resimulated_summary.csv"
    compare_resimulated(study / "emulator.pt", *files, *results)
    table, summary = (pd.read_csv(path) for path in results)
    assert len(table) == 6 * 52
    np.testing.assert_allclose(table["z"], 1.0, rtol=1e-6)
    assert summary.set_index("output").loc["all", "z_sd"] == pytest.approx(1.0)
    assert summary.set_index("output").loc["all", "draws"] == 6


def test_noise_priors_are_compared(study):
    files = study / "prior.nc", study / "prior.csv"
    sampling.sample_subject(
        study / "emulator.pt",
        study / "subject.csv",
        "someone",
        "importance",
        FEW,
        POINT,
        0.2,
        1,
        *files,
    )
    # The same with draws of known distributions: exponential ones, of the mean 1, 2, ...
    data = load(files[0])
    grid = stats.expon.ppf((np.arange(200) + 0.5) / 200).reshape(2, 100, 1, 1)
    data.posterior["sigma"][:] = grid * [1, 2]
    data.posterior["theta"][:] = grid * np.arange(3, 13)
    write(data, study / "known.nc")
    files = files[0], study / "known.nc"
    compare_noise_priors(files, [0.1, 0.2], study / "priors.csv")
    table = pd.read_csv(study / "priors.csv")
    assert table["prior_scale"].tolist() == [0.1] * 12 + [0.2] * 12
    assert table["parameter"].tolist()[:3] == [
        "sigma_circumferential",
        "sigma_radial",
        "C_a_anterior",
    ]
    assert (table["outputs"] == 33).all() and table["outside"].max() <= 6
    known = table[12:]
    for name, value in (("lower95", 0.0), ("median", np.log(2)), ("upper95", np.log(20))):
        assert (known[name] / np.arange(1, 13)).tolist() == pytest.approx([value] * 12, abs=0.07)
