"""Ranking, tests and scores against values known from elsewhere."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy import integrate, stats

from regional_lv.channels import Channels
from regional_lv.paper.estimates import ranking, transforms
from regional_lv.paper.plots import per_sample_mse, sample_efficiency
from regional_lv.paper.tables import emulators as tables

CHANNELS = Channels.of()
CASES = 30


def estimates(mse: dict[str, np.ndarray]) -> pd.DataFrame:
    """A table of point estimates with these per-sample errors by estimator."""
    parts = [
        pd.DataFrame(
            {
                "sample": [str(i) for i in range(CASES)],
                "estimator": estimator,
                "mse": values,
                "outside": np.arange(CASES) < 3,
                "seconds": 0.5,
            }
        )
        for estimator, values in mse.items()
    ]
    return pd.concat(parts, ignore_index=True)


def made(table, source, folder: Path) -> pd.DataFrame:
    """What a table of `tables.emulators` writes."""
    table(source, csv=folder / "t.csv", tex=folder / "t.tex")
    read = pd.read_csv(folder / "t.csv")
    assert (folder / "t.tex").read_text().count(r"\\") == len(read) + 1
    return read


def draw(seed: int, scale: float) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    return estimates({e: scale * rng.chisquare(3, CASES) for e in ranking.ESTIMATORS})


def test_holm_by_hand(monkeypatch):
    """Ordered 0.01, 0.02, 0.03 times 3, 2, 1, never falling, never above 1."""
    names = [name for pair in ranking.PAIRS for name in pair]
    tables = {name: draw(seed, 1.0) for seed, name in enumerate(names)}

    def holm(p_values: list[float]) -> pd.DataFrame:
        results = iter(2 * p_values)  # the same for both estimators
        monkeypatch.setattr(
            ranking.stats,
            "wilcoxon",
            lambda a, b: SimpleNamespace(statistic=1.0, pvalue=next(results)),
        )
        table = ranking.compare_pairs(tables)
        return table[table["estimator"] == "weighted"]

    found = holm([0.03, 0.01, 0.02])
    np.testing.assert_allclose(found["p_holm"], [0.04, 0.03, 0.04])
    assert found["rejected"].all()
    found = holm([0.9, 0.01, 0.03])
    np.testing.assert_allclose(found["p_holm"], [0.9, 0.03, 0.06])
    assert found["rejected"].tolist() == [False, True, False]
    np.testing.assert_allclose(holm([0.9, 0.5, 0.4])["p_holm"], 1.0)


def test_no_pair_is_an_empty_table():
    table = ranking.compare_pairs({"vgp": draw(1, 1.0), "dnn": draw(2, 1.0)})
    assert table.empty and {"p_holm", "rejected"} <= set(table)


def test_crps_is_the_integral_that_defines_it():
    """Of errors in training sd: the output's is 2."""
    for error, sd in ((0.3, 0.5), (-2.0, 0.7)):

        def squared(x, error=error, sd=sd):
            return (stats.norm.cdf(x / sd) - (x >= error)) ** 2

        value = integrate.quad(squared, -8, 8, points=[error], limit=200)[0]
        predictions = pd.DataFrame({"output": ["radial_01"], "mean": 3.0, "sd": 2 * sd})
        predictions["truth"] = 3.0 + 2 * error
        scores = ranking.predictive_scores(predictions, pd.Series({"radial_01": 2.0}))
        assert np.isclose(scores["predictive_crps"], value, atol=1e-6)


def test_pairs_are_scipys_wilcoxon_with_holm():
    mse = {"vgp": draw(1, 2.0), "mvgp": draw(2, 0.2), "local_gp": draw(3, 1.0), "dnn": draw(5, 1)}
    table = ranking.compare_pairs(mse)
    # local_mgp is missing: its pair is left out.
    assert table[["single", "multi"]].values.tolist() == [["vgp", "mvgp"]] * 2
    mse["local_mgp"] = draw(4, 1.0)
    table = ranking.compare_pairs(mse)
    part = table[table["estimator"] == "weighted"].set_index("multi")
    a, b = (t.loc[t["estimator"] == "weighted", "mse"] for t in (mse["vgp"], mse["mvgp"]))
    p = stats.wilcoxon(a.to_numpy(), b.to_numpy()).pvalue
    assert np.isclose(part.loc["mvgp", "p_value"], p)
    assert np.isclose(part.loc["mvgp", "p_holm"], 2 * p) and part.loc["mvgp", "rejected"]
    assert part.loc["mvgp", "better"] == "mvgp" and not part.loc["local_mgp", "rejected"]


def test_cases_are_paired_by_name_not_by_place():
    a, b = draw(1, 1.0), draw(2, 1.0)
    expected = ranking.compare_pairs({"vgp": a, "mvgp": b})
    shuffled = b.sample(frac=1, random_state=1)
    pd.testing.assert_frame_equal(ranking.compare_pairs({"vgp": a, "mvgp": shuffled}), expected)


def test_predictive_scores_of_a_calibrated_prediction():
    rng = np.random.default_rng(6)
    n = 20_000
    sd = pd.Series({"volume_ml": 10.0, "radial_01": 0.1})
    output = np.tile(sd.index, n // 2)
    spread = 0.2 * sd.loc[output].to_numpy()
    predictions = pd.DataFrame({"output": output, "mean": 1.0, "sd": spread})
    predictions["truth"] = 1.0 + spread * rng.normal(size=n)
    scores = ranking.predictive_scores(predictions, sd)
    assert np.isclose(scores["predictive_mse"], 0.04, rtol=0.05)
    assert np.isclose(scores["predictive_crps"], 0.2 / np.sqrt(np.pi), rtol=0.03)
    assert np.isclose(scores["predictive_coverage95"], 0.95, atol=0.01)
    assert np.isclose(scores["predictive_coverage50"], 0.50, atol=0.02)


def test_output_errors_leave_out_what_did_not_converge():
    truth = pd.DataFrame(np.zeros((3, 52)), columns=list(CHANNELS.names), index=["0", "1", "2"])
    values = np.zeros((3, 52))
    values[0] = np.r_[5.0, np.full(51, 0.1)]
    values[2] = np.nan
    checked = pd.DataFrame(values, columns=list(CHANNELS.names))
    checked = checked.assign(sample=["0", "1", "2"], estimator="weighted", checked_by="simulator")
    other = checked.assign(estimator="least_squares", volume_ml=1e6)
    sd = pd.Series(np.r_[10.0, np.full(51, 0.2)], index=list(CHANNELS.names))
    scores = ranking.output_errors(pd.concat([checked, other]), truth, sd, "weighted")
    assert np.isclose(scores["output_mse"], 0.01 / 2)
    assert np.isclose(scores["output_mse_standardised"], 0.25 / 2)
    assert scores["checked_failed"] == 1 and scores["checked_cases"] == 2


@pytest.fixture
def study(tmp_path):
    """Everything that the ranking reads, of three emulators with known errors."""
    rng = np.random.default_rng(7)
    y = pd.DataFrame(rng.normal(size=(CASES, 52)), columns=list(CHANNELS.names))
    y.insert(0, "sample", np.arange(CASES))
    y.to_parquet(tmp_path / "train.parquet")
    y.to_parquet(tmp_path / "test.parquet")
    for name, scale in (("vgp", 0.5), ("mvgp", 0.1), ("dnn", 0.02)):
        own = tmp_path / "estimates" / name
        fits = tmp_path / "emulators" / name
        own.mkdir(parents=True)
        fits.mkdir(parents=True)
        draw(len(name), scale).to_parquet(own / "test.parquet")
        checked = y.assign(estimator="weighted", checked_by="simulator")
        checked.assign(sample=checked["sample"].astype(str)).to_parquet(own / "checked.parquet")
        (own / "cost.json").write_text(json.dumps({"ms_prediction": 1.0, "ms_gradient": 2.0}))
        fit = {"emulator": name, "settings": {"input_transform": "log"}, "seconds": 3.0}
        (fits / "fit.json").write_text(json.dumps(fit | {"peak_memory_mb": 300.0, "rows": 40}))
        long = y.melt("sample", var_name="output", value_name="truth").assign(mean=0.0, sd=1.0)
        long.to_parquet(fits / "test_predictions.parquet")
    return tmp_path


def rank(study, size: int, estimator: str = "weighted", named=None, also=()):
    names = ["vgp", "mvgp", "dnn"]
    own, fits = ([study / folder / name for name in names] for folder in ("estimates", "emulators"))
    ranking.rank_emulators(
        names,
        *(
            [path / file for path in own]
            for file in ("test.parquet", "checked.parquet", "cost.json")
        ),
        *([path / file for path in fits] for file in ("fit.json", "test_predictions.parquet")),
        CHANNELS,
        study / "train.parquet",
        study / "test.parquet",
        size,
        estimator,
        named,
        also,
        study / "ranking.csv",
        study / "pairs.csv",
        study / "shortlist.json",
    )
    return pd.read_csv(study / "ranking.csv"), json.loads((study / "shortlist.json").read_text())


def test_ranking_orders_chooses_and_says_why(study):
    table, chosen = rank(study, 2)
    assert table["emulator"].tolist() == ["dnn", "mvgp", "vgp"]
    assert table["rank"].tolist() == [1, 2, 3]
    assert chosen["shortlist"] == ["dnn", "mvgp"]
    assert "the 2 of 3 emulators" in chosen["rule"] and "weighted" in chosen["rule"]
    assert (table["output_mse"] == 0).all() and (table["checked_by"] == "simulator").all()
    mvgp = table.set_index("emulator").loc["mvgp"]
    assert mvgp["outside_weighted"] == 3
    assert rank(study, 9)[1]["shortlist"] == ["dnn", "mvgp", "vgp"]


def test_shortlist_holds_what_is_asked_for_beside_the_best(study):
    """`also` ends with `emulators.final`, which may be `auto`; what is not ranked stays out."""
    chosen = rank(study, 1, also=["local_gp", "dnn", "vgp", "auto"])[1]
    assert (chosen["shortlist"], chosen["best_of_ranking"]) == (["dnn", "vgp"], ["dnn"])
    chosen = rank(study, 1, named=["mvgp"], also=["vgp"])[1]
    assert (chosen["shortlist"], chosen["best_of_ranking"]) == (["mvgp"], ["dnn"])


def test_tables_and_box_plots(study):
    rank(study, 1, also=["vgp"])
    s1 = made(tables.ranking, study / "ranking.csv", study)
    assert s1["emulator"].tolist() == ["DNN", "MVGP", "VGP"] and s1["output_mse"].notna().all()
    pairs = made(tables.pairs, study / "pairs.csv", study)
    assert pairs[["single", "multi"]].drop_duplicates().values.tolist() == [["VGP", "MVGP"]]
    names = ["vgp", "mvgp", "dnn"]
    one = made(tables.architectures, [study / "emulators" / n / "fit.json" for n in names], study)
    assert one["emulator"].tolist() == ["VGP", "MVGP", "DNN"]
    assert one["output_structure"].tolist() == ["single-output", *["multi-output"] * 2]
    per_sample_mse.draw(
        names,
        [study / "estimates" / n / "test.parquet" for n in names],
        study / "shortlist.json",
        study / "box.png",
        study / "box.csv",
    )
    data = pd.read_csv(study / "box.csv")
    assert len(data) == 3 * 2 * CASES
    assert data.loc[data["shortlisted"], "emulator"].unique().tolist() == ["vgp", "dnn"]


def test_errors_on_a_second_test_set_stand_beside(study):
    """In the order of the ranking on the first, whatever the second says."""
    first, _ = rank(study, 1)
    second = first[::-1].assign(param_mse_weighted=[9.0, 8.0, 7.0])
    second.to_csv(study / "holdout.csv", index=False)
    files = [study / name for name in ("ranking.csv", "holdout.csv", "t.csv", "t.tex")]
    tables.ranking(*files[:2], csv=files[2], tex=files[3])
    table = pd.read_csv(files[2])
    assert table["emulator"].tolist() == ["DNN", "MVGP", "VGP"]
    assert table["param_mse_weighted_holdout"].tolist() == [7.0, 8.0, 9.0]
    np.testing.assert_allclose(table["output_mse_holdout"], table["output_mse"])


def test_transforms_compare_an_emulator_with_itself(study):
    """Whichever of the two it is configured with."""
    for name, other in (("mvgp", "identity"), ("dnn", "log")):
        own, fits = (study / f / f"{name}-{other}" for f in ("estimates", "emulators"))
        own.mkdir()
        fits.mkdir()
        estimates = pd.read_parquet(study / "estimates" / name / "test.parquet")
        estimates.assign(mse=4 * estimates["mse"]).to_parquet(own / "test.parquet")
        predictions = pd.read_parquet(study / "emulators" / name / "test_predictions.parquet")
        predictions["truth"] *= 3  # the mean is 0
        predictions.to_parquet(fits / "test_predictions.parquet")
    files = ["mvgp", "mvgp-identity", "dnn", "dnn-log"]
    transforms.compare_transforms(
        {
            "mvgp": {"identity": "mvgp-identity", "log": "mvgp"},
            "dnn": {"identity": "dnn", "log": "dnn-log"},
        },
        files,
        [study / "estimates" / name / "test.parquet" for name in files],
        [study / "emulators" / name / "test_predictions.parquet" for name in files],
        CHANNELS,
        study / "train.parquet",
        study / "transforms.csv",
    )
    table = pd.read_csv(study / "transforms.csv").set_index("emulator")
    for quantity in ("param_mse_least_squares", "param_mse_weighted"):
        np.testing.assert_allclose(table[f"{quantity}_gain"], [4, 1 / 4])
    np.testing.assert_allclose(table["predictive_mse_gain"], [9, 1 / 9])
    labels = made(tables.transforms, study / "transforms.csv", study)["emulator"]
    assert labels.tolist() == ["MVGP", "DNN"]


def test_efficiency_figure_shows_all_curves(tmp_path):
    for name, transform, factor in (("exact_gp", "log", 1.0), ("gradient_gp", "identity", 0.2)):
        pd.DataFrame(
            {
                "emulator": name,
                "input_transform": transform,
                "simulations": [60, 150, 300],
                "predictive_mse": factor * np.array([0.1, 0.03, 0.01]),
                "predictive_coverage95": 0.95,
                "param_mse": factor * np.array([0.3, 0.1, 0.02]),
                "training_seconds": 1.5,
            }
        ).to_csv(tmp_path / f"{name}.csv", index=False)
    paths = [tmp_path / "exact_gp.csv", tmp_path / "gradient_gp.csv"]
    sample_efficiency.draw(paths, tmp_path / "e.png", tmp_path / "e.csv")
    shown = pd.read_csv(tmp_path / "e.csv")
    assert len(shown) == 6
    pd.testing.assert_frame_equal(shown, made(tables.sample_efficiency, paths, tmp_path))
