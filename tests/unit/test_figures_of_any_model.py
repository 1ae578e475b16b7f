"""Figures and tables of other zones, factors and channels than the paper's: one zone, the 17
segments, another material law, several loads, torsion and shortening."""

import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.inference.posteriors import load, write
from regional_lv.inputs.stiffness import ZONES, StiffnessInputs
from regional_lv.mechanics.materials import MATERIALS, Factor
from regional_lv.paper import case_posterior
from regional_lv.paper.plots import (
    bullseye_map,
    correlations,
    emulator_traces,
    hpd_widths,
    map_errors,
    noise_prior,
    parity,
    recovery,
    resimulation,
    roc,
    sampler_agreement,
    sbc,
    traces,
    uncertainty,
)
from regional_lv.paper.plots import bullseye_posterior as bullseye_as_it_is
from regional_lv.paper.plots import posterior_predictive as predictive_as_it_is
from regional_lv.paper.posteriors.sets_table import read_sets
from regional_lv.paper.tables import posteriors
from regional_lv.plots import (
    bullseye_posterior,
    criticism,
    design,
    strain_field,
    style,
    zones,
)
from regional_lv.registry import temporary
from regional_lv.tables import subjects
from tests.criticism.findings_example import example, write_posterior
from tests.drawn import read, table_of
from tests.unit.test_figures import ring_mesh

SEPTUM = [2, 3, 8, 9, 14]
TWO_WALLS = {"septal": SEPTUM, "free_wall": sorted({*range(1, 18)} - {*SEPTUM})}
MODELS = {
    "whole": StiffnessInputs(ZONES["whole"]),
    "segments": StiffnessInputs(ZONES["segments"]),
    "guccione": StiffnessInputs(
        TWO_WALLS, law="guccione", bounds={"C_c": (0.1, 5.0), "C_b": (0.2, 3.0)}
    ),
    "one factor": StiffnessInputs(factors=["C_a"]),
    "one parameter": StiffnessInputs(ZONES["whole"], factors=["C_a"]),
}
CHANNELS = Channels.of(
    ("volume", "circumferential", "radial", "torsion", "shortening"),
    {"radial": [f"{n:02d}" for n in range(1, 17)], "torsion": ["basal-mid", "basal-apical"]},
    load_fractions=(0.5,),
)


DEEP = {
    "segments": "the figures of 34 parameters take as long as all others",
    "whole": "one zone, as `one parameter` has, and two factors, as `guccione`",
    "one factor": "one factor, as `one parameter` has, and the zones of other figures",
}


@pytest.fixture(
    params=[
        pytest.param(name, marks=pytest.mark.test_all(DEEP[name]) if name in DEEP else [])
        for name in MODELS
    ]
)
def parameters(request) -> StiffnessInputs:
    return MODELS[request.param]


@pytest.fixture
def choice(tmp_path):
    (tmp_path / "final.json").write_text('{"final": "exact_gp"}')
    return tmp_path / "final.json"


@pytest.fixture
def subject(tmp_path):
    """A posterior of one subject that observes every channel: (nc, diagnostics)."""

    def make(parameters, outputs=CHANNELS.names):
        rng = np.random.default_rng(0)
        theta = np.linspace(0.5, 2.0, len(parameters))
        theta = theta * np.exp(0.1 * rng.normal(size=(2, 40, 1, len(parameters))))
        sigma = 0.3 * np.exp(0.1 * rng.normal(size=(2, 40, 1, 2)))
        value = np.array([100.0 if name.startswith("volume") else 0.1 for name in outputs])
        predicted = value * (1 + 0.05 * rng.normal(size=(2, 40, 1, len(outputs))))
        case, output = {"case": ["heart"]}, {"output": list(outputs)}
        write(
            xr.DataTree.from_dict(
                {
                    "posterior": xr.Dataset(
                        {
                            "theta": (("chain", "draw", "case", "parameter"), theta),
                            "sigma": (("chain", "draw", "case", "direction"), sigma),
                        },
                        case
                        | {
                            "parameter": list(parameters.names),
                            "direction": ["circumferential", "radial"],
                        },
                    ),
                    "observed_data": xr.Dataset(
                        {"y": (("case", "output"), value[None])}, case | output
                    ),
                    "posterior_predictive": xr.Dataset(
                        {"y": (("chain", "draw", "case", "output"), predicted)}, case | output
                    ),
                }
            ),
            tmp_path / "heart.nc",
        )
        checks = pd.DataFrame({"parameter": [*parameters.names, "sigma_circumferential"]})
        checks = checks.assign(case="heart", rhat=1.0, ess_bulk=900.0, ess_tail=800.0)
        checks = checks.assign(divergences=0, passed=True, verdict="passed")
        checks.to_csv(tmp_path / "diagnostics.csv", index=False)
        return tmp_path / "heart.nc", tmp_path / "diagnostics.csv"

    return make


def recovered(path, parameters, kind="local"):
    """A `recovery.csv` with one case for each stiff zone, or three cases that are stiff all over;
    the first factor is 2 in a stiff zone, the second 3, and the MAP lies 0.1 above the truth."""
    rng = np.random.default_rng(0)
    rows = []
    for case, stiff in enumerate(parameters.zones if kind == "local" else ["all"] * 3):
        for p in parameters:
            truth = 1.0
            if stiff in ("all", p.zone):
                truth = 2.0 + parameters.factors.index(p.factor)
            width = rng.uniform(0.2, 0.4)
            rows.append(
                {"case": str(case), "parameter": p.name, "truth": truth, "map": truth + 0.1}
                | {"lower95": truth - width, "upper95": truth + width, "hpd_width95": width}
                | {"covered95": True, "zone": stiff, "verdict": "passed", "crps": 0.1}
            )
    pd.DataFrame(rows).to_csv(path, index=False)
    return path


def coverage(path, parameters):
    path.parent.mkdir(parents=True, exist_ok=True)
    names = [*parameters.names, "all"]
    table = pd.DataFrame({"parameter": names, "cases": 3, "failed": 0, "mse": 0.01})
    table = table.assign(bias=0.1, mean_mse=0.01, crps=0.1, variance_ratio=0.02, hpd_width95=0.3)
    for level in (50, 80, 95):
        table[f"coverage{level}"] = level / 100 - 0.01
        table[f"coverage{level}_lower"], table[f"coverage{level}_upper"] = level / 120, 1.0
    table.to_csv(path, index=False)
    return path


def checked(path, parameters, cases):
    rows = [(c, n, 1.0, 500.0, 500.0, 0, True, "passed") for c in cases for n in parameters.names]
    columns = "case parameter rhat ess_bulk ess_tail divergences passed verdict".split()
    pd.DataFrame(rows, columns=columns).to_csv(path, index=False)
    return path


def test_recovery(parameters, choice, tmp_path, paths):
    files = (
        recovered(tmp_path / "recovery.csv", parameters),
        coverage(tmp_path / "coverage.csv", parameters),
        checked(tmp_path / "diagnostics.csv", parameters, range(len(parameters.zones))),
    )
    recovery.draw(*files, choice, parameters, *paths)
    drawn = read(paths)
    cases = drawn[drawn["panel"] == "recovery"]
    assert set(cases["parameter"]) == set(parameters.names)
    assert (cases["map"] - cases["truth"]).to_numpy() == pytest.approx(0.1)
    assert (drawn["panel"] == "coverage").sum() == len(parameters) + 1
    assert len(table_of(posteriors.recovery, tmp_path, files[1])) == len(parameters) + 1


def test_bullseye_posterior(parameters, subject, paths):
    files = subject(parameters)
    bullseye_as_it_is.draw(*files, "file", parameters, *paths)
    drawn = read(paths)
    medians = drawn[drawn["item"] == "median"].set_index("parameter")["value"]
    draws = case_posterior.read(*files).draws
    assert set(medians.index) == {*parameters.names, "sigma_circumferential", "sigma_radial"}
    for name, values in draws.items():
        assert medians[name] == pytest.approx(np.median(values))
    zone = drawn.dropna(subset="zone").drop_duplicates("parameter").set_index("parameter")["zone"]
    assert zone.to_dict() == {p.name: p.zone for p in parameters}


def test_bullseye_and_table_of_an_average(parameters, tmp_path, paths):
    nc, findings = tmp_path / "posterior.nc", tmp_path / "findings.json"
    content = example(parameters, CHANNELS.names)
    findings.write_text(json.dumps(content))
    value, sd = dict.fromkeys(CHANNELS.names, 0.1), dict.fromkeys(CHANNELS.names, 0.01)
    write_posterior(content, value, sd, nc)
    bullseye_posterior.draw(nc, findings, "file", parameters, *paths)
    drawn = read(paths)
    means = drawn[drawn["item"] == "as_is_mean"].set_index("parameter")["value"]
    assert list(means.index) == list(parameters.names)
    table = table_of(subjects.subjects, tmp_path, [nc], [findings], ["file"])
    assert list(table["as_is_mean"]) == pytest.approx(list(means))
    tex = (tmp_path / "tables" / "made.tex").read_text()
    assert (r"C_{c}$ septal" in tex) == (parameters.law == "guccione")


def test_what_is_written_into_a_zone_lies_in_it(parameters):
    """Zero line, densities and text, of any number of factors."""
    for shape in bullseye_posterior.bullseye.zone_shapes(parameters).values():
        place = bullseye_posterior._layout(shape, len(parameters.factors), inches=5.0)
        lines = len(parameters.factors) + 1
        y = [place.y + place.height, place.y, place.text, place.text - lines * place.line]
        x = place.x + place.half * np.array([-1, 0, 1])
        corners = np.array([(a, b) for a in x for b in y])
        assert shape.holds(corners).all()
        assert place.height > 0 and place.text < place.y


def test_traces_of_a_subject(parameters, subject, paths):
    traces.draw(*subject(parameters), "file", *paths)
    drawn = read(paths)
    assert drawn.groupby("parameter", sort=False).size().index[0] == parameters.names[0]
    assert set(drawn["parameter"]) >= set(parameters.names)


def test_posterior_predictive(subject, paths):
    files = subject(MODELS["whole"])
    predictive_as_it_is.draw(*files, "file", *paths)
    drawn = read(paths)
    observed = drawn[drawn["item"] == "observed"].set_index("output")
    assert set(observed.index) == set(CHANNELS.names)
    assert observed.loc["volume_ml@0.5", "quantity"] == "volume"
    assert observed.loc["circumferential_07@0.5", "segment"] == 7
    assert np.isnan(observed.loc["torsion_basal-mid", "segment"])
    assert observed["inside"].astype(str).eq("True").all()


def test_posterior_predictive_that_is_not_there(subject, paths):
    """As in a file that someone wrote with ArviZ from the posterior alone."""
    posterior, diagnostics = subject(MODELS["whole"])
    data = load(posterior)
    del data["posterior_predictive"]
    write(data, posterior)
    with pytest.raises(InputError, match=r"heart\.nc: no group .*; rerun the subject's inference"):
        predictive_as_it_is.draw(posterior, diagnostics, "file", *paths)


def test_posterior_predictive_without_strains(subject, paths):
    outputs = ["volume_ml", "shortening"]
    predictive_as_it_is.draw(*subject(MODELS["whole"], outputs), "file", *paths)
    drawn = read(paths)
    assert list(drawn["output"].unique()) == outputs


def test_parity(parameters, choice, tmp_path, paths):
    rows = [(c, name, c, c + 0.1 * c, 0.1) for c in (0, 1, 3) for name in CHANNELS.names]
    columns = ["case", "output", "truth", "mean", "sd"]
    pd.DataFrame(rows, columns=columns).to_parquet(tmp_path / "test.parquet")
    parity.draw(tmp_path / "test.parquet", choice, parameters, *paths)
    drawn = read(paths)
    assert len(drawn) == len(rows)
    assert drawn["coverage95"].to_numpy() == pytest.approx(2 / 3)
    assert set(drawn["quantity"]) == set(CHANNELS.quantities)


def test_design_shows_end_diastole(parameters, tmp_path, paths):
    rng = np.random.default_rng(2)
    table = pd.DataFrame(rng.normal(size=(20, len(CHANNELS))), columns=list(CHANNELS.names))
    table.assign(sample=range(20), scale="log").to_parquet(tmp_path / "train.parquet")
    lost = pd.DataFrame({"sample": [99], "scale": ["log"]})
    lost = lost.assign(**{f"place_{name}": 0.25 for name in parameters.names})
    lost.to_csv(tmp_path / "excluded.csv", index=False)
    files = tmp_path / "train.parquet", tmp_path / "excluded.csv"
    design.draw(*files, parameters, CHANNELS, *paths)
    drawn = read(paths)
    assert set(drawn["panel"]) == {*CHANNELS.quantities, "excluded"}
    assert not drawn["item"].str.contains("@").any()
    assert (drawn.loc[drawn["panel"] == "excluded", "item"] == list(parameters.names)).all()
    assert drawn.loc[drawn["panel"] == "torsion", "value"].sum() == 40


def test_scenario_figures(parameters, tmp_path, paths):
    files = [
        recovered(tmp_path / "local.csv", parameters),
        recovered(tmp_path / "global.csv", parameters, "global"),
    ]
    labels = ["local", "global"]
    table = read_sets(files, labels, parameters)
    assert set(table["quantity"]) == set(parameters.factors)
    assert set(table["of"]) == set(parameters.zones)
    bullseye_map.draw(files, labels, "stiffened", "Stiffening", parameters, *paths)
    drawn = read(paths)
    assert len(drawn) == 2 * len(parameters)
    expected = 2.0 + drawn["quantity"].map(list(parameters.factors).index)
    assert drawn["truth"].to_numpy() == pytest.approx(expected.to_numpy())
    assert drawn["rmse"].to_numpy() == pytest.approx(0.1)
    map_errors.draw(2 * files, labels, parameters, *paths)
    drawn = read(paths)
    assert drawn["rmse"].to_numpy() == pytest.approx(0.1)
    assert set(drawn["zone"]) == set(parameters.zones)
    hpd_widths.draw(2 * files, labels, parameters, *paths)
    groups = read(paths).groupby("parameters")["cases"].max()
    assert groups["all parameters"] == max(len(parameters.zones), 3)


def test_width_of_the_prior_is_said_by_factor():
    assert hpd_widths._prior_width(MODELS["whole"]) == "4.66"
    assert hpd_widths._prior_width(MODELS["guccione"]) == "$C_{c}$ 4.66, $C_{b}$ 2.66"


def correlated(path, what, names):
    rows = [(a, b, 1.0 if a == b else -0.3, 0.02, 7) for a in names for b in names]
    columns = [f"{what}_1", f"{what}_2", "mean", "se", "cases"]
    pd.DataFrame(rows, columns=columns).to_csv(path, index=False)
    return path


def test_correlations(parameters, tmp_path, paths):
    recovery_file = recovered(tmp_path / "r.csv", parameters)
    file = correlated(tmp_path / "z.csv", "zone", parameters.zones)
    correlations.draw([file] * 2, [recovery_file] * 2, ["a", "b"], "Zones", parameters, *paths)
    drawn = read(paths)
    assert len(drawn) == 2 * len(parameters.zones) ** 2
    assert set(drawn["zone_1"]) == set(parameters.zones)
    file = correlated(tmp_path / "c.csv", "parameter", parameters.names)
    correlations.draw([file], [recovery_file], ["local"], "Parameters", parameters, *paths)
    assert len(read(paths)) == len(parameters) ** 2


def test_roc(parameters, tmp_path, paths):
    rows = [
        (quantity, zone, 0.5, x, x**0.3)
        for quantity in (*parameters.factors, "both")
        for zone in ("all", *parameters.zones)
        for x in (0.0, 0.5, 1.0)
    ]
    columns = ["quantity", "zone", "threshold", "false_positive_rate", "true_positive_rate"]
    table = pd.DataFrame(rows, columns=columns)
    table.to_csv(tmp_path / "roc.csv", index=False)
    area = table.drop_duplicates(["quantity", "zone"])[["quantity", "zone"]]
    area.assign(auc=0.9, auc_lower=0.8, auc_upper=0.95).to_csv(tmp_path / "auc.csv", index=False)
    names = [tmp_path / "roc.csv", tmp_path / "auc.csv", recovered(tmp_path / "r.csv", parameters)]
    roc.draw(*([name] * 2 for name in names), ["a"], parameters, *paths)
    assert len(read(paths)) == 2 * len(rows)


def test_sbc(parameters, choice, tmp_path, paths):
    names = [*parameters.names, "all"]
    rows = [(n, 99, 40, b, 10 * b, 10 * b + 9, 4, 4.0) for n in names for b in range(10)]
    columns = "parameter draws cases bin lower_rank upper_rank count expected".split()
    pd.DataFrame(rows, columns=columns).to_csv(tmp_path / "sbc.csv", index=False)
    tests = pd.DataFrame({"parameter": names, "p_chi2": 0.4, "p_ecdf": 0.3, "passed": True})
    tests.to_csv(tmp_path / "test.csv", index=False)
    sbc.draw(tmp_path / "sbc.csv", tmp_path / "test.csv", choice, parameters, *paths)
    drawn = read(paths)
    assert list(drawn["parameter"].unique()) == names
    assert (drawn["band_lower"] < 4).all() and (drawn["band_upper"] > 4).all()


def test_uncertainty_and_traces_of_emulators(parameters, subject, tmp_path, paths):
    folder = tmp_path / "exact_gp" / "test"
    covered = coverage(folder / "coverage.csv", parameters)
    errors = pd.DataFrame({"case": ["heart"], "mse": 0.1, "crps": 0.2, "verdict": "passed"})
    errors.to_csv(folder / "map_mse.csv", index=False)
    uncertainty.draw([covered], [folder / "map_mse.csv"], parameters, *paths)
    drawn = read(paths)
    assert list(drawn.loc[drawn["panel"] == "coverage", "item"]) == [*parameters.names, "all"]
    nc, checks = subject(parameters)
    for file in (nc, checks):
        file.rename(folder / file.name)
    files = folder / "map_mse.csv", [folder / nc.name], [folder / checks.name]
    emulator_traces.draw(*files, parameters.names, *paths)
    assert list(read(paths)["parameter"].unique()) == list(parameters.names)
    table = table_of(posteriors.variance_ratios, tmp_path, [covered], parameters)
    assert list(table["parameter"]) == [*parameters.names, "all"]


def test_noise_prior(parameters, tmp_path, paths, monkeypatch):
    rows = [
        (scale, name, 1.0, 0.9, 1.1, 2, 33, "passed")
        for scale in (0.05, 0.3)
        for name in (*(f"sigma_{q}" for q in CHANNELS.quantities[1:]), *parameters.names)
    ]
    columns = "prior_scale parameter median lower95 upper95 outside outputs verdict".split()
    pd.DataFrame(rows, columns=columns).to_csv(tmp_path / "noise.csv", index=False)
    figures, save = [], style.save
    monkeypatch.setattr(style, "save", lambda fig, *rest: (figures.append(fig), save(fig, *rest)))
    noise_prior.draw(tmp_path / "noise.csv", "heart", "file", parameters, *paths)
    assert read(paths)["width95"].to_numpy() == pytest.approx(0.2)
    legend = figures[0].axes[0].get_legend().get_texts()
    assert tuple(text.get_text() for text in legend) == CHANNELS.quantities[1:]


def test_checks_of_the_chain(parameters, tmp_path, paths):
    rows = [("1", 0, name, 0.0, 1.0, 0.5, 0.5, False) for name in CHANNELS.names]
    columns = "case draw output mean sd simulator z outside".split()
    pd.DataFrame(rows, columns=columns).to_csv(tmp_path / "r.csv", index=False)
    resimulation.draw(tmp_path / "r.csv", *paths)
    assert list(read(paths)["quantity"].unique()) == list(CHANNELS.quantities)
    rows = [("test", "1", name, 0.05, 1.0, True) for name in parameters.names]
    columns = "set case parameter mean_difference_in_sd sd_ratio agrees".split()
    pd.DataFrame(rows, columns=columns).to_csv(tmp_path / "a.csv", index=False)
    sampler_agreement.draw([tmp_path / "a.csv"], parameters, *paths)
    assert len(read(paths)) == len(parameters)


def test_heart_and_its_strains(parameters, tmp_path, paths):
    mesh = ring_mesh(tmp_path / "mesh.vtu")
    zones.draw(mesh, parameters, *paths)
    drawn = read(paths)
    assert list(drawn["zone"]) == [parameters.zone_of(number) for number in range(1, 18)]
    rng = np.random.default_rng(3)
    strains = pd.DataFrame({"cell": np.repeat(np.arange(17), 8), "point": np.tile(range(8), 17)})
    strains = strains.assign(segment=strains["cell"] + 1, volume_mm3=1.0)
    for name, mean in (("circumferential", -0.15), ("radial", 0.3)):
        strains[name] = mean + 0.01 * rng.normal(size=len(strains))
    strains.to_parquet(tmp_path / "strains.parquet")
    strain_field.draw(mesh, tmp_path / "strains.parquet", 2.0, parameters, *paths)
    medians = read(paths).query("item == 'median'")
    assert set(medians["zone"]) == set(parameters.zones)
    assert set(medians["direction"]) == {"circumferential", "radial"}
    mine = medians[(medians["segment"] == 3) & (medians["direction"] == "radial")]["value"]
    raw = strains.loc[strains["segment"] == 3, "radial"]
    assert mine.item() == pytest.approx(raw.median(), abs=0.005)


def test_residuals_of_a_criticism(parameters, paths):
    channels = [
        {"output": c.name, "quantity": c.quantity, "segment": c.segment, "z": 1.5}
        | {"load_fraction": c.load_fraction, "observed": 0.1, "predicted": 0.0, "sd": 0.1}
        for c in CHANNELS
    ]
    step = {"channels": channels}
    findings = {"misfit": step, "remaining": step}
    criticism.draw_residuals(findings, *paths, parameters)
    drawn = read(paths)
    assert list(drawn["when"].unique()) == ["before", "after"]
    assert len(drawn) == 2 * len(CHANNELS)


def test_labels_and_colours():
    assert style.label("C_a_segment_03") == "$C_{a}$ segment 03"
    assert style.label("sigma_radial") == r"$\sigma$ radial"
    assert style.label("all") == "all"
    with temporary():
        MATERIALS.add(type("Plugin", (), {"name": "plugin", "factors": [Factor("mu", "")]}))
        assert style.label("mu_free_wall") == "mu free wall"
    colours = style.factor_colours(f"C_{i}" for i in range(8))
    assert list(colours.values())[:2] == [style.BLUE, style.VERMILLION]
    assert len(set(list(colours.values())[:6])) == 6 and len(colours) == 8
    assert len(set(style.quantity_colours(CHANNELS.quantities).values())) == 5
    (rows, columns), places = style.zone_places(17, 2)
    assert (rows, columns) == (6, 6)
    assert len({tuple(place) for place in places.reshape(-1, 2)}) == 34
    assert style.zone_places(5, 2)[0] == (2, 5)
