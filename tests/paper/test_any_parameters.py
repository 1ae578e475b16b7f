"""From emulator to posterior with other zones, factors, bounds and channels than the paper's."""

import numpy as np
import pandas as pd
import pytest
import torch

from regional_lv import emulators
from regional_lv.channels import Channels
from regional_lv.emulators.training import train_emulator
from regional_lv.errors import InputError
from regional_lv.inference.noise import Noise
from regional_lv.inference.posteriors import load
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.estimates.least_squares import find_least_squares
from regional_lv.paper.posteriors import sets
from regional_lv.paper.posteriors.classification import classify_zones, score_classification
from regional_lv.paper.posteriors.files import TABLES
from regional_lv.paper.posteriors.rank_calibration import calibrate_chain
from regional_lv.paper.posteriors.summaries import summarise_posteriors
from regional_lv.paper.sampler import sampling
from regional_lv.paper.sampler.files import cases_of
from regional_lv.paper.sampler.likelihood import Likelihood
from regional_lv.paper.sampler.point import find_map

ONE = StiffnessInputs({"whole": range(1, 18)}, bounds={"C_a": (0.1, 5.0), "C_b": (0.5, 2.0)})
SEGMENTS = StiffnessInputs(
    {f"segment_{s:02d}": (s,) for s in range(1, 18)}, factors=("C_a",), bounds=(0.4, 2.5)
)
SINGLE = StiffnessInputs({"whole": range(1, 18)}, factors=("C_b",), bounds=(0.3, 3.0))
CASES = {"one zone": ONE, "17 zones": SEGMENTS, "one parameter": SINGLE}
CHANNELS = Channels.of(
    ("volume", "circumferential", "torsion"), {"circumferential": range(1, 14)}, (0.5,)
)
NUTS = {"chains": 2, "warmup": 100, "draws": 150, "rhat_max": 1.2, "ess_min": 20}
NUTS["cases_per_batch"] = 2
POINT = {"starts": 3, "iterations": 60}


def simulate(theta: np.ndarray, parameters: StiffnessInputs) -> np.ndarray:
    """All channels, with the signs and sizes of a ventricle's."""
    x = np.log(theta)
    weights = np.random.default_rng(1).normal(size=(len(parameters), len(CHANNELS)))
    sizes = {"volume": 40.0, "circumferential": -0.05, "torsion": 0.1}
    size = np.array([sizes[channel.quantity] for channel in CHANNELS])
    return size * (np.tanh(0.3 * x @ weights) + 0.05 * x @ weights + 3.0)


def table(parameters: StiffnessInputs, rows: int, seed: int) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    low, high = np.log(parameters.lower), np.log(parameters.upper)
    inset = 0.0 if rows > 10 else 0.2 * (high - low)
    theta = np.exp(rng.uniform(low + inset, high - inset, (rows, len(parameters))))
    frame = pd.DataFrame(theta, columns=list(parameters.names))
    frame.insert(0, "sample", np.arange(rows))
    outputs = pd.DataFrame(simulate(theta, parameters), columns=list(CHANNELS.names))
    return pd.concat([frame, outputs], axis=1)


@pytest.fixture(scope="module", params=CASES)
def study(request, tmp_path_factory):
    """Parameters, and a folder with emulator and tables."""
    parameters, folder = CASES[request.param], tmp_path_factory.mktemp("any")
    table(parameters, 250, 2).to_parquet(folder / "train.parquet")
    zones = list(parameters.zones)
    scenario = table(parameters, 2, 3).assign(zone=[zones[0], zones[-1]])
    scenario.to_parquet(folder / "scenario.parquet")
    files = folder / "e.pt", folder / "fit.json"
    settings = {"iterations": 40}
    train_emulator("exact_gp", settings, folder / "train.parquet", parameters, CHANNELS, 1, *files)
    return parameters, folder


def test_maximum_and_least_squares(study):
    parameters, folder = study
    emulator = emulators.load(folder / "e.pt")
    truth = table(parameters, 5, 4)[list(parameters.names)].to_numpy()
    y = torch.as_tensor(simulate(truth, parameters))
    found = find_map(Likelihood(emulator, y, Noise.none(emulator)), **POINT, seed=1)
    squares, _ = find_least_squares(emulator, y, **POINT, adam_steps=5, hops=1, seed=1)
    for theta in (found.theta, squares):
        assert ((theta >= emulator.lower) & (theta <= emulator.upper)).all()
        # Of the spread that the box has.
        error = np.log(theta.numpy() / truth) / np.log(parameters.upper / parameters.lower)
        assert np.median(abs(error)) < 0.05


def test_every_parameter_stays_within_its_own_bounds(study):
    """Data from beyond the box end on the bounds of each parameter."""
    parameters, folder = study
    emulator = emulators.load(folder / "e.pt")
    for end, beyond in ((emulator.lower, 0.5), (emulator.upper, 2.0)):
        y = torch.as_tensor(simulate(beyond * end[None].numpy(), parameters))
        found = find_map(Likelihood(emulator, y, Noise.none(emulator)), **POINT, seed=1)
        assert ((found.theta >= emulator.lower) & (found.theta <= emulator.upper)).all()
        assert (found.theta[0] == end).any()


def test_posteriors_and_their_tables(study):
    parameters, folder = study
    path = folder / "p.nc"
    sets.sample_set_batch(
        folder / "e.pt",
        folder / "scenario.parquet",
        "local",
        "0000",
        1,
        2,
        None,
        "importance",
        NUTS,
        POINT,
        1,
        path,
    )
    data = load(path)
    assert [one.parameters for one in cases_of(data)] == 2 * [parameters]
    theta = data.posterior["theta"].to_numpy()
    assert theta.shape == (2, 150, 2, len(parameters))
    assert ((theta >= parameters.lower) & (theta <= parameters.upper)).all()
    truth = data.constant_data["theta_true"].to_numpy()
    z = (theta.mean((0, 1)) - truth) / theta.std((0, 1))
    assert np.abs(z).max() < 4.5
    files = [folder / f"{name}.csv" for name in TABLES]
    summarise_posteriors([path], files)
    tables = {name: pd.read_csv(file) for name, file in zip(TABLES, files, strict=True)}
    assert tables["coverage"]["parameter"].iloc[: len(parameters)].tolist() == [*parameters.names]
    ratio = tables["recovery"].set_index(["case", "parameter"])["variance_ratio"]
    expected = theta[..., 0, -1].var(ddof=1) * 12 / (parameters.upper - parameters.lower)[-1] ** 2
    assert ratio.loc[0, parameters.names[-1]] == pytest.approx(expected)
    assert len(tables["zone_correlations"]) == len(parameters.zones) ** 2
    zones = list(parameters.zones)
    told = folder / "told.csv"
    classify_zones([path], {"mean": 1.0, "sd": 0.1}, told)
    rows = pd.read_csv(told)
    stiff = rows.loc[rows["stiffened"], "zone"].drop_duplicates().tolist()
    assert stiff == [*dict.fromkeys([zones[0], zones[-1]])]
    assert len(rows) == 2 * len(zones) * (len(parameters.factors) + 1)
    assert set(rows["quantity"]) == {*parameters.factors, "both"}
    score_classification(told, [], folder / "roc.csv", folder / "auc.csv", 1)
    areas = pd.read_csv(folder / "auc.csv")
    assert areas["zone"].drop_duplicates().tolist() == ["all", *zones]


def test_ranks_of_the_chain(study, monkeypatch):
    """No draw lies below a truth in the lower corner of the box, none above one in the upper."""
    parameters, folder = study
    corners, rand = torch.tensor([[0.0], [1.0]]).double().expand(2, len(parameters)), torch.rand

    def cornered(*size, **options):
        return corners if size == corners.shape else rand(*size, **options)

    monkeypatch.setattr(torch, "rand", cornered)
    files = [folder / f"sbc_{name}.csv" for name in ("ranks", "histogram", "tests")]
    of_study = folder / "e.pt", folder / "train.parquet", 2, "importance", NUTS, POINT, 1
    calibrate_chain(*of_study, *files)
    ranks, _, tests = (pd.read_csv(file) for file in files)
    assert ranks["rank"].tolist() == [0] * len(parameters) + [99] * len(parameters)
    assert ranks["parameter"].tolist() == 2 * [*parameters.names]
    assert tests["parameter"].tolist() == [*parameters.names, "all"]


def test_noisy_sets_leave_out_what_has_no_noise():
    y, names = np.ones((3, len(CHANNELS))), list(CHANNELS.names)
    noise = {"volume": 2.0, "circumferential": 0.02, "radial": 0.05, "longitudinal": None}
    noisy, sd = sets.add_noise(y, CHANNELS, ["0", "1", "2"], noise, 1, "some")
    torsion = [name.startswith("torsion") for name in names]
    assert np.isnan(sd[torsion]).all() and (noisy[:, torsion] == 1).all()
    assert (sd[CHANNELS.of_quantity("volume")] == 2.0).all()
    assert (noisy[:, np.invert(torsion)] != 1).all()


@pytest.mark.parametrize(
    "sampler",
    [
        "importance",
        pytest.param("nuts", marks=pytest.mark.test_all("long chains; the workflow has some")),
    ],
)
def test_subject_with_torsion_and_two_loads(study, sampler, tmp_path):
    """Strains and torsion without sd: a noise scale for each, at both loads the same."""
    parameters, folder = study
    truth = table(parameters, 1, 5)[list(CHANNELS.names)].iloc[0]
    rng = np.random.default_rng(6)
    lines = ["quantity,segment,value,unit,load_fraction"]
    for channel in CHANNELS:
        value = truth[channel.name]
        if channel.quantity != "volume":
            value += rng.normal(0, 0.005)
        lines.append(
            f"{channel.quantity},{channel.place},{value},{channel.unit},{channel.load_fraction}"
        )
    (tmp_path / "subject.csv").write_text("\n".join(lines) + "\n")
    likelihood = sampling.subject_likelihood(folder / "e.pt", tmp_path / "subject.csv", 0.5)
    assert list(likelihood.noise.groups) == ["circumferential", "torsion"]
    # Chains that short say nothing of the posterior: what counts is that both samplers run.
    few = NUTS | {"warmup": 30, "draws": 20, "rhat_max": 10.0, "ess_min": 0, "max_tree_depth": 4}
    how = sampling.Sampling(few, POINT, 1, "subjects")
    sampled = sampling.sample_cases([likelihood], ["someone"], how, sampler)
    data = sampling.to_datatree(sampled, few)
    assert data.posterior["sigma"].shape[-1] == 2
    theta = data.posterior["theta"].to_numpy()
    assert np.isfinite(theta).all()
    assert ((theta >= parameters.lower) & (theta <= parameters.upper)).all()
    (tmp_path / "more.csv").write_text("\n".join([lines[0], "radial,7,0.3,1,1.0"]) + "\n")
    with pytest.raises(InputError, match=r"radial_07 is no channel that the study observes"):
        sampling.subject_likelihood(folder / "e.pt", tmp_path / "more.csv", 0.5)
