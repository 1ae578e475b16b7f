"""Files of posteriors: of sets in batches, of scenarios with noise, of subjects."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from regional_lv import emulators
from regional_lv.errors import InputError
from regional_lv.inference.posteriors import load, write
from regional_lv.paper.posteriors import sets
from regional_lv.paper.posteriors.files import TABLES
from regional_lv.paper.posteriors.summaries import summarise_posteriors
from regional_lv.paper.sampler import sampling
from regional_lv.study.faults import explain
from tests.paper.conftest import PARAMETERS

NUTS = {
    "chains": 2,
    "warmup": 50,
    "draws": 150,
    "target_accept": 0.8,
    "max_tree_depth": 8,
    "rhat_max": 1.05,
    "ess_min": 50,
    "cases_per_batch": 2,
}
POINT = {"starts": 2, "iterations": 60}


def sample(study, path, batch, batches, cases=4, noise=None, sampler="importance", nuts=NUTS):
    sets.sample_set_batch(
        study / "emulator.pt",
        study / "test.parquet",
        "test",
        batch,
        batches,
        cases,
        noise,
        sampler,
        nuts,
        POINT,
        1,
        path,
    )


def test_test_set(study):
    batches = [study / f"batch-{i}.nc" for i in range(2)]
    for i, path in enumerate(batches):
        sample(study, path, i, 2, cases=2)
    data = load(batches[1])
    assert data.posterior["theta"].dims == ("chain", "draw", "case", "parameter")
    assert data.posterior["theta"].shape == (2, 150, 1, 10)
    assert data.posterior["case"].to_numpy().tolist() == ["5"]
    assert data.posterior["parameter"].to_numpy().tolist() == list(PARAMETERS.names)
    names = {"theta_map", "theta_true", "y_obs", "seconds", "sampler"}
    names |= {"pareto_k", "weighted_ess"}
    assert set(data.constant_data) == names
    summarise_posteriors(batches, [study / f"{name}.csv" for name in TABLES])
    tables = {name: pd.read_csv(study / f"{name}.csv") for name in TABLES}
    assert len(tables["diagnostics"]) == len(tables["recovery"]) == 20
    assert (tables["diagnostics"]["sampler"] == "importance").all()
    known = pd.read_parquet(study / "test.parquet").set_index("sample")[list(PARAMETERS.names)]
    truth = tables["recovery"].pivot(index="case", columns="parameter", values="truth")
    pd.testing.assert_frame_equal(truth, known.loc[[3, 5], truth.columns], check_names=False)
    assert tables["coverage"]["parameter"].tolist() == [*PARAMETERS.names, "all"]
    assert tables["map_mse"]["case"].tolist() == [3, 5]
    assert tables["recovery"]["variance_ratio"].max() < 1
    assert len(tables["correlations"]) == 100 and len(tables["zone_correlations"]) == 25
    with pytest.raises(InputError, match="too few for 9 batches"):
        sample(study, batches[0], 0, 9)


FEW = NUTS | {"warmup": 40, "draws": 20, "ess_min": 0, "rhat_max": 10.0}


def test_a_case_does_not_depend_on_its_batch(study):
    paths = study / "alone.nc", study / "both.nc"
    sample(study, paths[0], 1, 2, cases=2, nuts=FEW)
    sample(study, paths[1], 0, 1, cases=2, nuts=FEW)
    alone, both = (load(p).posterior["theta"].sel(case="5").to_numpy() for p in paths)
    # Maxima of another batch differ by round-off.
    np.testing.assert_allclose(alone.mean((0, 1)), both.mean((0, 1)), rtol=1e-3)


def test_noisy_scenario(study):
    """Noise is added to what is measured, the rest is left out, and zones are handed on."""
    noise = {"volume": 2.0, "circumferential": 0.02, "radial": 0.05, "longitudinal": None}
    test = pd.read_parquet(study / "test.parquet")
    test.assign(zone="septal").to_parquet(study / "scenario.parquet")
    sets.sample_set_batch(
        study / "emulator.pt",
        study / "scenario.parquet",
        "some-noisy",
        0,
        1,
        2,
        noise,
        "importance",
        FEW,
        POINT,
        1,
        study / "noisy.nc",
    )
    data = load(study / "noisy.nc")
    assert data.constant_data["zone"].to_numpy().tolist() == ["septal"] * 2
    outputs = data.observed_data["output"].to_numpy().tolist()
    assert len(outputs) == 35 and not [name for name in outputs if "longitudinal" in name]
    change = data.observed_data["y"].to_numpy() - test[outputs].to_numpy()[:2]
    assert 1e-3 < np.abs(change[:, 1:18]).mean() < 0.04 and np.abs(change[:, 0]).max() < 8
    spread = data.posterior["theta"].std(("chain", "draw"))
    sample(study, study / "exact.nc", 0, 1, cases=2, nuts=FEW)
    exact = load(study / "exact.nc").posterior["theta"].std(("chain", "draw"))
    assert (spread / exact).mean() > 1.2  # the toy's are wide already: the box bounds both


@pytest.mark.parametrize(
    "sampler",
    [
        "importance",
        pytest.param("nuts", marks=pytest.mark.test_all("long chains; the workflow has some")),
    ],
)
@pytest.mark.parametrize("measured", ["subject.csv", "with_sd.csv"])
def test_subject(study, measured, sampler):
    files = study / f"{measured}.nc", study / f"{measured}.diagnostics.csv"
    sampling.sample_subject(
        study / "emulator.pt", study / measured, "someone", sampler, NUTS, POINT, 1.0, 1, *files
    )
    data, table = load(files[0]), pd.read_csv(files[1])
    inferred = measured == "subject.csv"
    assert ("sigma" in data.posterior) == inferred
    if inferred:
        assert data.posterior["direction"].to_numpy().tolist() == ["circumferential", "radial"]
        assert data.posterior["sigma"].shape == (2, 150, 1, 2)
    assert len(table) == (12 if inferred else 10)
    assert (table["sampler"] == sampler).all()
    predicted = data.posterior_predictive["y"]
    assert predicted.shape == (2, 150, 1, 33)
    low, high = predicted.quantile([0.01, 0.99], ("chain", "draw"))
    observed = data.observed_data["y"]
    assert int(((observed < low) | (observed > high)).sum()) <= 3
    with pytest.raises(InputError, match=r"csv\.nc: no `theta_true`; summarise posteriors of sim"):
        summarise_posteriors([files[0]], [])


@pytest.fixture
def posterior():
    """Two groups with what posteriors have: numbers, truth values, words."""
    draws = np.random.default_rng(0).normal(size=(2, 5000, 3)).round(1)
    coords = {"case": ["a", "b", "c"]}
    dims = ("chain", "draw", "case")
    theta = xr.Dataset({"theta": (dims, draws), "diverging": (dims, draws > 0)}, coords)
    constant = xr.Dataset({"sampler": ("case", ["nuts", "importance", "nuts"])}, coords)
    groups = {"/": xr.Dataset(attrs={"by": "test"}), "posterior": theta, "constant_data": constant}
    return xr.DataTree.from_dict(groups)


def test_a_file_has_what_was_written(posterior, tmp_path):
    path = tmp_path / "new" / "posterior.nc"
    write(posterior, path)
    xr.testing.assert_identical(load(path), posterior)
    assert path.stat().st_size < posterior.posterior.nbytes / 2


def test_a_full_disk_is_an_error_that_can_be_explained(posterior):
    with pytest.raises(OSError) as error:
        write(posterior, "/dev/full")
    assert "no space left" in explain(error.value, [], ["results/mine/posterior.nc"])


def test_outputs_that_the_emulator_lacks(study):
    emulator = emulators.load(study / "emulator.pt").select(["volume_ml", "radial_01"])
    with pytest.raises(InputError, match="radial_02"):
        emulator.select(["radial_02"])
