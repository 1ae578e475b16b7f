"""Figures and tables of whole sets: their numbers are those of the files, failures are named."""

import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from regional_lv.channels import Channels
from regional_lv.inference.posteriors import write
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper import page
from regional_lv.paper.plots import (
    bullseye_map,
    correlations,
    emulator_traces,
    hpd_widths,
    map_errors,
    noise_prior,
    resimulation,
    roc,
    sampler_agreement,
    sbc,
    uncertainty,
)
from regional_lv.paper.posteriors.sets_table import NOISE, read_sets
from regional_lv.paper.tables import posteriors
from regional_lv.plots import strain_field, style
from tests.drawn import read, table_of

PARAMETERS, CHANNELS = StiffnessInputs(), Channels.of()
FAILED = "failed: bulk ESS 40 < 400"
LOCAL = {"local, μ = 1.5": 1.5, "local, μ = 2": 2.0, "local, μ = 3": 3.0}


@pytest.fixture
def titles(monkeypatch):
    """Titles of all figures that `style.save` has seen."""
    seen = []
    save = style.save

    def remember(fig, *args):
        seen.append(" ".join(fig.get_suptitle().split()))
        save(fig, *args)

    monkeypatch.setattr(style, "save", remember)
    return seen


def recovered(path, mu, per_zone=2, noise=0.05, seed=0, failed=(), kind="local"):
    """A `recovery.csv` of a scenario in which one zone after the other has factors about `mu`."""
    rng = np.random.default_rng(seed)
    rows = []
    stiff = (
        [z for z in PARAMETERS.zone_names for _ in range(per_zone)]
        if kind == "local"
        else ["all"] * 4
    )
    for case, zone in enumerate(stiff):
        for name in PARAMETERS.names:
            centre = mu if zone in ("all", name[4:]) else 1.0
            truth = max(centre + 0.05 * rng.normal(), 0.1)
            found = truth + noise * rng.normal()
            rows.append(
                {"case": str(case), "parameter": name, "truth": truth, "map": found, "mean": found}
                | {"lower95": found - 2 * noise, "upper95": found + 2 * noise}
                | {"hpd_width95": noise * (4 + centre) * rng.uniform(0.8, 1.2), "zone": zone}
                | {"verdict": FAILED if case in failed else "passed", "crps": noise}
            )
    pd.DataFrame(rows).to_csv(path, index=False)
    return path


@pytest.fixture
def local_sets(tmp_path):
    return [
        recovered(tmp_path / f"{mu}.csv", mu, seed=at) for at, mu in enumerate(LOCAL.values())
    ], list(LOCAL)


def test_sets_know_their_stiffened_zone(tmp_path):
    local = recovered(tmp_path / "a.csv", 2.0)
    everywhere = recovered(tmp_path / "b.csv", 1.7, kind="global")
    table = read_sets([local, everywhere], ["a", "b"], PARAMETERS)
    share = table.groupby("set")["stiffened"].mean()
    assert share["a"] == pytest.approx(0.2) and share["b"] == 1.0
    stiff = table[(table["set"] == "a") & table["stiffened"]]
    assert (stiff["of"] == stiff["zone"]).all()


@pytest.mark.parametrize(("zones", "truth"), [("stiffened", LOCAL), ("baseline", 1.0)])
def test_bullseye_map(local_sets, paths, zones, truth, titles):
    bullseye_map.draw(*local_sets, zones, "Local stiffening", PARAMETERS, *paths)
    table = read(paths)
    assert len(table) == 3 * 2 * 5
    for label, part in table.groupby("set"):
        expected = truth if zones == "baseline" else truth[label]
        assert part["truth"].to_numpy() == pytest.approx(expected, abs=0.15)
    assert (table["rmse"] < 0.15).all()
    assert "FAILED" not in titles[0]


def test_rmse_is_that_of_the_map(tmp_path):
    recovered(tmp_path / "a.csv", 2.0)
    table = read_sets([tmp_path / "a.csv"], ["a"], PARAMETERS)
    table["map"] = table["truth"] + 0.3
    assert bullseye_map.summarise(table)["rmse"].to_numpy() == pytest.approx(0.3)


def test_map_errors(local_sets, tmp_path, paths, titles):
    recoveries, labels = local_sets
    noisy = [
        recovered(tmp_path / f"noisy-{mu}.csv", mu, noise=0.4, failed=(1,)) for mu in LOCAL.values()
    ]
    map_errors.draw([*recoveries, *noisy], labels, PARAMETERS, *paths)
    table = read(paths)
    by_noise = table.groupby("noise")["rmse"].mean()
    assert by_noise[NOISE[1]] > 4 * by_noise[NOISE[0]]
    assert set(table["stiffened"]) == {True, False}
    assert "3 OF 60 POSTERIORS FAILED" in titles[0]


def test_hpd_widths(local_sets, paths, titles):
    recoveries, labels = local_sets
    hpd_widths.draw(2 * recoveries, labels, PARAMETERS, *paths)
    table = read(paths).set_index(["noise", "set", "parameters"])
    raw = pd.read_csv(recoveries[2])["hpd_width95"]
    mine = table.loc[(NOISE[0], labels[2], "all parameters")]
    assert mine["median"] == pytest.approx(raw.median())
    stiff = table.xs("of the stiffened zone", level="parameters")["median"]
    other = table.xs("of the other zones", level="parameters")["median"]
    assert stiff.groupby("set").first()[labels[2]] > other.groupby("set").first()[labels[2]]


def correlation_table(path, what, names, value):
    rows = [(a, b, 1.0 if a == b else value, 0.02, 7) for a in names for b in names]
    columns = [f"{what}_1", f"{what}_2", "mean", "se", "cases"]
    pd.DataFrame(rows, columns=columns).to_csv(path, index=False)
    return path


def test_zone_correlations(tmp_path, paths):
    files = [
        correlation_table(tmp_path / f"{at}.csv", "zone", PARAMETERS.zone_names, value)
        for at, value in enumerate((-0.6, 0.1))
    ]
    recovery = recovered(tmp_path / "r.csv", 2.0)
    correlations.draw(files, [recovery] * 2, ["a", "b"], "Zones", PARAMETERS, *paths)
    table = read(paths)
    off = table[table["zone_1"] != table["zone_2"]].groupby("set")["mean"].mean()
    assert off["a"] == pytest.approx(-0.6) and off["b"] == pytest.approx(0.1)


def test_parameter_correlations(tmp_path, paths, titles):
    file = correlation_table(tmp_path / "c.csv", "parameter", PARAMETERS.names, -0.3)
    recovery = recovered(tmp_path / "r.csv", 2.0, failed=(0, 1))
    correlations.draw([file], [recovery], ["local, μ = 2"], "Parameters", PARAMETERS, *paths)
    table = read(paths)
    assert len(table) == 100 and set(table["cases"]) == {7}
    assert "2 OF 10 POSTERIORS FAILED" in titles[0]


def test_roc(tmp_path, paths):
    rows = [
        (quantity, zone, 0.5, x, x**power)
        for quantity, power in (("C_a", 0.2), ("C_b", 0.6), ("both", 0.1))
        for zone in ("all", *PARAMETERS.zone_names)
        for x in (0.0, 0.25, 0.5, 1.0)
    ]
    columns = ["quantity", "zone", "threshold", "false_positive_rate", "true_positive_rate"]
    pd.DataFrame(rows, columns=columns).to_csv(tmp_path / "roc.csv", index=False)
    area = pd.DataFrame(rows, columns=columns).drop_duplicates(["quantity", "zone"])
    area = area[["quantity", "zone"]].assign(auc_lower=0.5, auc_upper=1.0)
    # Of sets a and b without noise, then with it.
    given = [0.9, 0.8, 0.7, 0.6]
    areas = [tmp_path / f"auc-{auc}.csv" for auc in given]
    for auc, path in zip(given, areas, strict=True):
        area.assign(auc=auc).to_csv(path, index=False)
    recovery = recovered(tmp_path / "r.csv", 2.0)
    roc.draw([tmp_path / "roc.csv"] * 4, areas, [recovery] * 4, ["a", "b"], PARAMETERS, *paths)
    table = read(paths)
    assert len(table) == 4 * len(rows)
    shown = table.groupby(["noise", "set"])["auc"].unique()
    for at, noise in enumerate(NOISE):
        assert shown[noise]["a"].tolist() == [given[2 * at]]
        assert shown[noise]["b"].tolist() == [given[2 * at + 1]]


@pytest.mark.parametrize("passed", [True, False])
def test_sbc(tmp_path, paths, titles, passed):
    names = [*PARAMETERS.names, "all"]
    rows = [
        (name, 99, 40, b, 10 * b, 10 * b + 9, 4 * times, 4.0 * times)
        for name in names
        for times in [10 if name == "all" else 1]
        for b in range(10)
    ]
    columns = "parameter draws cases bin lower_rank upper_rank count expected".split()
    pd.DataFrame(rows, columns=columns).to_csv(tmp_path / "sbc.csv", index=False)
    pd.DataFrame(
        {"parameter": names, "p_chi2": 0.4, "p_ecdf": 0.3, "p_holm": 1.0, "passed": True}
    ).assign(passed=lambda t: passed | ~t["parameter"].isin(["C_b_septal", "all"])).to_csv(
        tmp_path / "test.csv", index=False
    )
    (tmp_path / "final.json").write_text('{"final": "exact_gp"}')
    files = [tmp_path / name for name in ("sbc.csv", "test.csv", "final.json")]
    sbc.draw(*files, PARAMETERS, *paths)
    table = read(paths).set_index(["parameter", "bin"])
    ranks = np.random.default_rng(1).integers(100, size=(20_000, 400), dtype=np.int8)
    for name, cases in (("C_a_septal", 40), ("all", 400)):
        counts = (ranks[:, :cases] < 10).sum(axis=1)
        low, high = table.loc[(name, 0), ["band_lower", "band_upper"]]
        for tail in (counts < low, counts > high):
            assert tail.mean() < 0.0065
        # No wider than it has to be.
        assert (counts <= low).mean() > 0.0035 and (counts >= high).mean() > 0.0035
    assert titles[0].endswith("REJECTED: $C_{b}$ septal") == (not passed)


@pytest.fixture
def noise_table(tmp_path):
    rows = [
        (scale, name, value, value - 0.1, value + 0.1, outside, 33, "passed")
        for scale, outside in ((0.05, 9), (0.3, 3), (1.0, 1))
        for name, value in (
            ("sigma_circumferential", scale),
            ("sigma_radial", 1.2 * scale),
            *((p, 1.0) for p in PARAMETERS.names),
        )
    ]
    columns = "prior_scale parameter median lower95 upper95 outside outputs verdict".split()
    pd.DataFrame(rows, columns=columns).to_csv(tmp_path / "noise.csv", index=False)
    return tmp_path / "noise.csv"


def test_noise_prior(noise_table, tmp_path, paths):
    noise_prior.draw(noise_table, "volunteer", "published_volunteer", PARAMETERS, *paths)
    assert read(paths)["width95"].to_numpy() == pytest.approx(0.2)
    table = table_of(posteriors.noise_prior, tmp_path, noise_table)
    assert list(table["outside"]) == [9, 3, 1]
    assert table["sigma_radial"].to_numpy() == pytest.approx([0.06, 0.36, 1.2])


@pytest.fixture
def shortlisted(tmp_path):
    """Test posteriors of two emulators in two files each: coverage, map_mse, diagnostics, nc."""
    rng = np.random.default_rng(3)
    files = {"coverage": {}, "errors": {}, "diagnostics": {}, "posteriors": {}}
    truth = rng.uniform(0.5, 2.0, (4, 10))
    for emulator, spread in (("exact_gp", 0.05), ("dnn", 0.2)):
        folder = tmp_path / emulator / "test"
        folder.mkdir(parents=True)
        table = pd.DataFrame({"parameter": [*PARAMETERS.names, "all"], "cases": 4, "failed": 1})
        for level in (50, 80, 95):
            table[f"coverage{level}"] = level / 100
            table[f"coverage{level}_lower"] = level / 100 - 0.1
            table[f"coverage{level}_upper"] = min(1.0, level / 100 + 0.1)
        table["variance_ratio"] = spread * (1 + np.arange(11) % 2)
        table["mse"], table["bias"], table["crps"], table["hpd_width95"] = 0.04, 0.01, 0.1, 0.5
        verdicts = ["passed", "passed", "passed", FAILED]
        per_case = pd.DataFrame(
            {"case": range(4), "mse": 0.1, "crps": [0.4, 0.1, 0.2, 0.3], "verdict": verdicts}
        )
        checks = pd.DataFrame(
            [
                (c, name, 1.0 + 0.001 * c, 900.0, 800.0, 0, verdict == "passed", verdict)
                for c, verdict in enumerate(verdicts)
                for name in PARAMETERS.names
            ],
            columns="case parameter rhat ess_bulk ess_tail divergences passed verdict".split(),
        )
        for kind, made in (("coverage", table), ("errors", per_case), ("diagnostics", checks)):
            made.to_csv(folder / f"{kind}.csv", index=False)
            files[kind][emulator] = folder / f"{kind}.csv"
        files["posteriors"][emulator] = []
        for batch in (0, 1):
            cases = [2 * batch, 2 * batch + 1]
            draws = truth[cases] + spread * rng.normal(size=(2, 60, 2, 10))
            names = {"case": [str(c) for c in cases], "parameter": list(PARAMETERS.names)}
            path = folder / f"batch-{batch}.nc"
            write(
                xr.DataTree.from_dict(
                    {
                        "posterior": xr.Dataset(
                            {"theta": (("chain", "draw", "case", "parameter"), draws)}, names
                        ),
                        "constant_data": xr.Dataset(
                            {"theta_true": (("case", "parameter"), truth[cases])}, names
                        ),
                    }
                ),
                path,
            )
            files["posteriors"][emulator].append(path)
    return files


def test_uncertainty(shortlisted, paths, titles):
    files = ([*shortlisted[kind].values()] for kind in ("coverage", "errors"))
    uncertainty.draw(*files, PARAMETERS, *paths)
    table = read(paths).set_index(["panel", "emulator", "item"]).sort_index()
    assert table.loc[("coverage", "dnn", "all"), "value"].item() == pytest.approx(0.95)
    assert table.loc[("crps", "exact_gp", "2"), "value"].item() == 0.2
    assert "2 OF 8 POSTERIORS FAILED" in titles[0]


def test_emulator_traces_show_the_middle_case(shortlisted, paths, titles):
    posteriors = [path for paths in shortlisted["posteriors"].values() for path in paths]
    diagnostics = [*shortlisted["diagnostics"].values()]
    errors = shortlisted["errors"]["exact_gp"]
    shown = ("C_a_anterior", "C_b_anterior")
    emulator_traces.draw(errors, posteriors, diagnostics, shown, *paths)
    table = read(paths)
    assert set(table["case"]) == {2} and set(table["emulator"]) == {"exact_gp", "dnn"}
    assert "Test case 2" in titles[0] and "FAILED" not in titles[0]
    draws = table[(table["item"] == "draw") & (table["parameter"] == "C_b_anterior")]
    assert (
        draws.groupby("emulator")["y"].std()["dnn"]
        > 2 * draws.groupby("emulator")["y"].std()["exact_gp"]
    )
    assert draws.groupby("emulator").size().eq(120).all()


# Tables


def test_variance_ratios(shortlisted, tmp_path):
    files = [*shortlisted["coverage"].values()]
    table = table_of(posteriors.variance_ratios, tmp_path, files, PARAMETERS)
    table = table.set_index("parameter")
    assert list(table.columns) == ["exact_gp", "dnn", "failed"]
    assert table.loc["C_b_apical", "dnn"] == pytest.approx(0.4)
    assert (table["failed"] == 2).all()


def test_convergence_tells_three_rhats(tmp_path):
    """A drift within the chains shows when chains are split, and only then."""
    rng = np.random.default_rng(0)
    drift = np.linspace(-1, 1, 200)[:, None, None]
    theta = rng.normal(size=(2, 200, 1, 10))
    theta[..., 0:1] = drift + 0.1 * theta[..., 0:1]
    names = {"case": ["heart"], "parameter": list(PARAMETERS.names)}
    write(
        xr.DataTree.from_dict(
            {
                "posterior": xr.Dataset(
                    {"theta": (("chain", "draw", "case", "parameter"), theta)}, names
                )
            }
        ),
        tmp_path / "h.nc",
    )
    pd.DataFrame(
        [("heart", name, 1.5, 50.0, 60.0, 0, False, FAILED) for name in PARAMETERS.names],
        columns="case parameter rhat ess_bulk ess_tail divergences passed verdict".split(),
    ).to_csv(tmp_path / "h.csv", index=False)
    files = tmp_path / "h.nc", tmp_path / "h.csv"
    table = table_of(posteriors.convergence, tmp_path, *files).set_index("parameter")
    assert table.loc["C_a_anterior", "rhat"] < 1.05 < 1.5 < table.loc["C_a_anterior", "split_rhat"]
    assert table["split_rhat"].iloc[1:].max() < 1.05
    assert set(table["verdict"]) == {FAILED}


def test_scenario_table(shortlisted, tmp_path):
    coverage = []
    for name in ("test", "local"):
        (tmp_path / "final" / name).mkdir(parents=True)
        coverage.append(tmp_path / "final" / name / "coverage.csv")
        coverage[-1].write_bytes(shortlisted["coverage"]["exact_gp"].read_bytes())
    auc, recovery = (tmp_path / "final" / "local" / f"{n}.csv" for n in ("auc", "recovery"))
    recovered(recovery, 2.0)
    pd.DataFrame(
        {"quantity": ["C_a", "both"], "zone": "all", "auc": [0.7, 0.9]}
        | {"auc_lower": 0.6, "auc_upper": 0.95}
    ).to_csv(auc, index=False)
    test = tmp_path / "final" / "test" / "recovery.csv"
    pd.read_csv(recovery).assign(zone=np.nan).to_csv(test, index=False)
    files = coverage, [auc], [test, recovery]
    table = table_of(posteriors.scenarios, tmp_path, *files, PARAMETERS).set_index("set")
    assert table.loc["local", "auc"] == 0.9 and np.isnan(table.loc["test", "auc"])
    assert np.isnan(table.loc["test", "map_rmse_stiffened"])
    assert table.loc["local", "map_rmse_stiffened"] == pytest.approx(0.05, abs=0.03)
    assert table.loc["local", "map_rmse"] == pytest.approx(0.2)


def test_choice(tmp_path):
    candidates = [{"emulator": "mvgp", "crps": 0.1}, {"emulator": "dnn", "crps": 0.2}]
    (tmp_path / "f.json").write_text(json.dumps({"final": "mvgp", "candidates": candidates}))
    table = table_of(posteriors.choice, tmp_path, tmp_path / "f.json")
    assert list(table["chosen"]) == [True, False]


def test_markdown_has_no_nan_and_escapes_bars():
    table = pd.DataFrame({"a": [1.23456, np.nan], "b": ["x|y", "z"]})
    lines = page.markdown(table).splitlines()
    assert lines == ["| a | b |", "|---:|---|", "| 1.235 | x\\|y |", "|  | z |"]


# The strain field


def test_weighted_quantiles():
    values, weights = np.array([3.0, 1.0, 2.0]), np.array([1.0, 1.0, 2.0])
    assert strain_field.weighted_quantiles(values, weights, [0.5])[0] == pytest.approx(2.0)
    heavy = strain_field.weighted_quantiles(values, np.array([98.0, 1.0, 1.0]), [0.5])[0]
    assert heavy > 2.9


# Checks of the chain


def test_resimulation(tmp_path, paths, titles, monkeypatch):
    figures, save = [], style.save
    monkeypatch.setattr(style, "save", lambda fig, *rest: (figures.append(fig), save(fig, *rest)))
    rng = np.random.default_rng(4)
    rows = [
        (case, draw, output, 0.0, 1.0, z, z, case == 1)
        for case in (0, 1)
        for draw in range(3)
        for output, z in zip(CHANNELS.names, [2.0, *rng.normal(size=51)], strict=True)
    ]
    columns = "case draw output mean sd simulator z outside".split()
    pd.DataFrame(rows, columns=columns).to_csv(tmp_path / "r.csv", index=False)
    resimulation.draw(tmp_path / "r.csv", *paths)
    assert read(paths)["quantity"].value_counts()["radial"] == 6 * 17
    assert figures[0].axes[0].texts[0].get_text().startswith("rms 2.00")  # all of it bias
    assert titles[0] == "Simulator at 6 posterior draws of 2 cases; 3 draws far from the design"


def test_agreement(tmp_path, paths, titles):
    rows = [("test", c, n, 0.05 * c, 1.0, c < 4) for c in range(5) for n in PARAMETERS.names]
    columns = "set case parameter mean_difference_in_sd sd_ratio agrees".split()
    pd.DataFrame(rows, columns=columns).to_csv(tmp_path / "a.csv", index=False)
    sampler_agreement.draw([tmp_path / "a.csv"], PARAMETERS, *paths)
    assert len(read(paths)) == 50
    assert "5 posteriors: 80 % agree" in titles[0]
    pd.DataFrame(columns=columns).to_csv(tmp_path / "a.csv", index=False)
    sampler_agreement.draw([tmp_path / "a.csv"], PARAMETERS, *paths)
    assert "0 posteriors: none passed the convergence check" in titles[1]
