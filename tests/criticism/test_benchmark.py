"""The score of hidden effects, against cases counted by hand."""

import json

import numpy as np
import pandas as pd
import pytest
import torch

from regional_lv.criticism import benchmark
from regional_lv.criticism.benchmark import expected_score, measured_of, summarise
from regional_lv.criticism.observations import observe
from regional_lv.criticism.rates import rate
from regional_lv.measured import read_measured, write_measured
from regional_lv.plots import hidden_effects
from tests.criticism.toy import PARAMETERS, THETA, Pressure, ToyEmulator, basal, bias, measured


def case(effect, answer, limits, size=1, covered=True, **more):
    row = {
        "effect": effect,
        "answer": answer,
        "limits": limits,
        "expected_z": 3 * limits,
        "size": size,
        "contains": (answer == effect) if effect != "none" else np.nan,
        "covered": covered if effect != "none" else np.nan,
        "identifiable": True if effect != "none" else np.nan,
        "misfit_p": 0.5,
        "seconds": 1.0,
    }
    return row | more


@pytest.fixture
def cases():
    rows = [case("radial_scale", "radial_scale", 4.0)] * 8
    rows += [case("radial_scale", "basal_motion", 4.0, covered=False)] * 2
    rows += [case("radial_scale", "none", 0.5, size=0)] * 5
    rows += [case("none", "none", np.nan, size=0)] * 19 + [case("none", "focal_scar", np.nan)]
    rows += [case("end_diastolic_pressure", "none", 0.0, size=0, identifiable=False)]
    return pd.DataFrame(rows)


def test_summary_counts(cases):
    found = summarise(cases)
    assert (found["false_positives"]["hits"], found["false_positives"]["of"]) == (1, 20)
    far = found["limit_of_the_test"]
    assert far["contains_injected"]["share"] == pytest.approx(0.8)
    assert far["mean_members"] == 1.0
    assert far["coverage"]["share"] == pytest.approx(0.8)
    assert found["pressure_not_identifiable"]["hits"] == 1


def test_rates_have_exact_intervals():
    """Clopper-Pearson for 5 of 100 is 1.64 to 11.28 %."""
    found = rate(pd.Series([True] * 5 + [False] * 95))
    assert (found["low"], found["high"]) == (
        pytest.approx(0.0164, abs=1e-4),
        pytest.approx(0.1128, abs=1e-4),
    )
    assert rate(pd.Series([False] * 10))["low"] == 0.0


def test_expected_score_is_the_effect_over_its_standard_error():
    emulator = ToyEmulator(bend=0.0)
    o = observe({"a": measured(emulator)}, emulator, 1.0)
    one, two = (expected_score(o, emulator, bias(), THETA, value) for value in (0.2, 0.4))
    assert two == pytest.approx(2 * one)
    noisier = observe({"a": measured(emulator, strain=0.02)}, emulator, 1.0)
    assert expected_score(noisier, emulator, bias(), THETA, 0.2) == pytest.approx(one / 2, rel=0.03)


def test_injected_rows_are_measured_tables(tmp_path):
    table = measured(ToyEmulator())
    row = pd.Series(
        {"subject": "a"}
        | dict(zip(table["output"], table["value"], strict=True))
        | {f"sd_{o}": sd for o, sd in zip(table["output"], table["sd"], strict=True)}
    )
    found = measured_of(row)
    write_measured(table, tmp_path / "a.csv")
    read = read_measured(tmp_path / "a.csv")
    columns = ["output", "quantity", "segment", "load_fraction", "value", "sd"]
    pd.testing.assert_frame_equal(found[columns], read[columns], check_exact=False)
    assert torch.equal(
        *(observe({"a": table}, ToyEmulator(), 1.0).present for table in (found, read))
    )


def test_figure_shows_confusions_and_power(cases, tmp_path):
    cases.to_csv(tmp_path / "cases.csv", index=False)
    hidden_effects.draw(tmp_path / "cases.csv", tmp_path / "a.png", tmp_path / "a.csv")
    table = pd.read_csv(tmp_path / "a.csv")
    cell = (table["effect"] == "radial_scale") & (table["answer"] == "basal_motion")
    assert table.loc[cell, "count"].tolist() == [2]
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_from_subjects_to_score(tmp_path, monkeypatch):
    """Two hearts in closed form through the files, one with an effect."""
    catalogue = [Pressure(), bias(), basal()]
    monkeypatch.setattr(benchmark.emulators, "load", lambda path: ToyEmulator())
    monkeypatch.setattr(benchmark, "read_extensions", lambda paths: catalogue)
    rows, truths = [], []
    for name, extension, psi in (("a", basal(), 1.0), ("b", None, 0.0)):
        table = measured(ToyEmulator(), extension, psi, seed=5)
        rows.append(
            {"subject": name}
            | dict(zip(table["output"], table["value"], strict=True))
            | {f"sd_{o}": sd for o, sd in zip(table["output"], table["sd"], strict=True)}
        )
        effect = "basal_motion" if extension else ""
        theta = dict(zip(PARAMETERS.names, THETA.tolist(), strict=True))
        truth = {"effect": effect, "component": "", "value": psi or np.nan}
        truths.append({"subject": name} | theta | truth | {"status": "converged"})
    subjects, truth = tmp_path / "subjects.parquet", tmp_path / "truth.parquet"
    pd.DataFrame(rows).to_parquet(subjects)
    pd.DataFrame(truths).to_parquet(truth)
    settings = {"bootstrap": 99, "level": 0.05, "leading": {"p": 0.02, "least": 1}}
    settings |= {"draws": 300, "rounds": 2, "load_fractions": []}
    verdicts = [tmp_path / f"{i}.parquet" for i in range(2)]
    for i, path in enumerate(verdicts):
        benchmark.criticise_benchmark(subjects, str(i), 1, "", [], settings, 1.0, 3, path)
    outputs = [tmp_path / name for name in ("cases.csv", "confusion.csv", "summary.json")]
    benchmark.score_benchmark(verdicts, truth, subjects, "", [], *outputs)
    cases = pd.read_csv(outputs[0], index_col="subject", keep_default_na=False)
    assert cases["answer"].to_dict() == {"a": "basal_motion", "b": "none"}
    assert float(cases.loc["a", "limits"]) > 3
    summary = json.loads(outputs[2].read_text())
    assert summary["limit_of_the_test"]["contains_injected"]["hits"] == 1
    assert summary["false_positives"] == rate(pd.Series([False]))
    hidden_effects.draw(outputs[0], tmp_path / "a.png", tmp_path / "a.csv")
