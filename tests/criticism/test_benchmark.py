"""The score of hidden effects, against cases counted by hand."""

import json

import numpy as np
import pandas as pd
import pytest
import torch
from statsmodels.regression.linear_model import GLS

from regional_lv.criticism import benchmark
from regional_lv.criticism.benchmark import expected_scores, measured_of, summarise
from regional_lv.criticism.observations import observe
from regional_lv.criticism.rates import rate
from regional_lv.measured import read_measured, write_measured
from regional_lv.plots import hidden_effects
from tests.criticism.test_verdict import findings
from tests.criticism.toy import (
    PARAMETERS,
    THETA,
    Pressure,
    ToyEmulator,
    basal,
    bias,
    measured,
    scars,
    simulate,
)


def case(subject, kind, effect, answer, z, covered=True, **more):
    row = {
        "subject": subject,
        "kind": kind,
        "effect": effect,
        "answer": answer,
        "expected_z": z,
        "contains": (effect in answer.split()) if effect != "none" else np.nan,
        "covered": covered if effect in answer.split() and effect != "none" else np.nan,
        "identifiable": True if effect != "none" else np.nan,
        "wrong_named": bool(set(answer.split()) - {effect, "none"}),
        "detected": answer != "none",
        "misfit_p": 0.5,
        "seconds": 1.0,
    }
    return row | more


@pytest.fixture
def cases():
    rows = [case(f"a{i}", "singles", "radial_scale", "radial_scale", 12.0) for i in range(8)]
    rows += [case(f"b{i}", "singles", "radial_scale", "basal_motion", 12.0) for i in range(2)]
    rows += [case(f"c{i}", "singles", "radial_scale", "none", 1.5) for i in range(5)]
    both = "radial_scale basal_motion"
    for name, answer in (("d0", both), ("d1", "radial_scale")):
        rows += [
            case(name, "pairs", effect, answer, 5.0, wrong_named=False) for effect in both.split()
        ]
    rows += [case(f"e{i}", "nulls", "none", "none", np.nan) for i in range(19)]
    rows += [case("e19", "nulls", "none", "focal_scar", np.nan)]
    hidden = case("f", "singles", "end_diastolic_pressure", "none", 0.0, identifiable=False)
    return pd.DataFrame([*rows, hidden])


def test_summary_counts(cases):
    found = summarise(cases)
    assert (found["nulls"]["wrong_named"]["hits"], found["nulls"]["subjects"]) == (1, 20)
    assert found["singles"]["found"]["share"] == pytest.approx(0.8)
    assert (found["pairs"]["found"]["hits"], found["pairs"]["found"]["of"]) == (1, 2)
    assert found["pairs"]["effects_found"]["share"] == pytest.approx(0.75)
    assert found["absent_named"]["hits"] == 2
    assert found["coverage"]["share"] == 1.0
    assert found["pressure_not_identifiable"]["hits"] == 1


def test_rates_have_exact_intervals():
    """Clopper-Pearson for 5 of 100 is 1.64 to 11.28 %."""
    found = rate(pd.Series([True] * 5 + [False] * 95))
    assert (found["low"], found["high"]) == (
        pytest.approx(0.0164, abs=1e-4),
        pytest.approx(0.1128, abs=1e-4),
    )
    assert rate(pd.Series([False] * 10))["low"] == 0.0


@pytest.mark.parametrize("effects", [[(bias(), 0.4)], [(bias(), 0.4), (basal(), 0.5)]])
def test_expected_score_is_the_effect_over_its_standard_error(effects):
    """That of generalised least squares in log theta and all effects, by statsmodels."""
    emulator = ToyEmulator(bend=0.0)
    table = measured(emulator)
    one = torch.ones((), dtype=torch.float64)
    columns = [extension.mean(emulator, THETA, one).numpy() for extension, _ in effects]
    covariance = emulator.output_covariance.numpy() + np.diag(table["sd"] ** 2)
    model = GLS(np.zeros(52), np.column_stack([emulator.w, *columns]), covariance)
    errors = np.sqrt(model.fit().normalized_cov_params.diagonal()[10:])
    expected = [value / error for (_, value), error in zip(effects, errors, strict=True)]
    observed = observe({"a": table}, emulator, 1.0)
    shifts = {str(i): value * columns[i] for i, (_, value) in enumerate(effects)}
    found = expected_scores(observed, emulator, shifts, THETA)
    assert [*found.values()] == pytest.approx(expected, rel=0.01)


def test_effects_that_do_the_same_or_nothing_have_no_score():
    emulator = ToyEmulator(bend=0.0)
    observed = observe({"a": measured(emulator)}, emulator, 1.0)
    one = bias().mean(emulator, THETA, torch.ones((), dtype=torch.float64)).numpy()
    twice = {"same": one, "again": 2 * one, "nothing": 0 * one}
    assert max(expected_scores(observed, emulator, twice, THETA).values()) < 0.01


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
    # Of the third heart, basal motion is the other effect injected.
    assert table.loc[cell, "count"].tolist() == [2]


def test_a_scar_in_a_wrong_segment_is_a_wrong_answer():
    content = findings(measured(ToyEmulator(), scars()[6], 0.8, seed=5))
    verdicts = pd.DataFrame(benchmark._rows(content, 1.0))
    for place, right in (("7", True), ("8", False)):
        (case,) = benchmark._cases("a", verdicts, "singles", {"focal_scar": (0.8, place)}, {})
        assert case["contains"] is right and case["wrong_named"] is not right


def test_from_subjects_to_score(tmp_path, monkeypatch):
    """Hearts in closed form through the files: an effect, none, and one that is withheld."""
    catalogue = [Pressure(), bias(), basal()]
    monkeypatch.setattr(benchmark, "load_emulator", lambda *_: ToyEmulator())
    monkeypatch.setattr(benchmark, "read_extensions", lambda paths: catalogue)
    rows, truths = [], []
    hearts = ("a", "singles", basal()), ("b", "nulls", None), ("c", "unlisted", basal())
    for name, kind, extension in hearts:
        table = measured(ToyEmulator(), extension, 1.0, seed=5)
        rows.append(
            {"subject": name, "withheld": "basal_motion" if kind == "unlisted" else ""}
            | dict(zip(table["output"], table["value"], strict=True))
            | {f"sd_{o}": sd for o, sd in zip(table["output"], table["sd"], strict=True)}
        )
        effects = json.dumps({"basal_motion": [1.0, ""]} if extension else {})
        theta = dict(zip(PARAMETERS.names, THETA.tolist(), strict=True))
        one = torch.ones((), dtype=torch.float64)
        change = basal().mean(ToyEmulator(), THETA, one).flatten().tolist()
        shifts = json.dumps({"basal_motion": change} if extension else {})
        truth = {"kind": kind, "effects": effects, "shifts": shifts, "status": "converged"}
        truths.append({"subject": name} | theta | truth)
    subjects, truth = tmp_path / "subjects.parquet", tmp_path / "truth.parquet"
    pd.DataFrame(rows).to_parquet(subjects)
    pd.DataFrame(truths).to_parquet(truth)
    settings = {"bootstrap": 99, "level": 0.05, "draws": 300, "largest_set": 2}
    settings |= {"load_fractions": []}
    settings |= {"confirmation": {"sets": 2, "simulations": 4, "rounds": 1}}
    verdicts = []
    for i in range(3):  # the last one is without a heart
        batch = {"subjects": subjects, "batch": str(i), "batch_size": 2, "emulator": ""}
        batch |= {"extensions": [], "settings": settings, "strain_exponent": 2.0}
        batch |= {"noise_prior_scale": 1.0, "seed": 3}
        files = [tmp_path / f"{i}-{name}" for name in ("search", "design", "made", "verdicts")]
        benchmark.search_batch(files[0], **batch)
        benchmark.plan_batch(files[0], "0", files[1], **batch)
        simulate(catalogue)(pd.read_parquet(files[1])).to_parquet(files[2])
        benchmark.conclude_batch(files[0], [files[2]], files[3], **batch)
        verdicts.append(files[3])
    outputs = [tmp_path / name for name in ("cases.csv", "confusion.csv", "summary.json")]
    benchmark.score_benchmark(verdicts, truth, subjects, "", *outputs)
    cases = pd.read_csv(outputs[0], index_col="subject", keep_default_na=False)
    assert cases["answer"].to_dict() == {"a": "basal_motion", "b": "none", "c": "none"}
    assert float(cases.loc["a", "expected_z"]) > 3
    summary = json.loads(outputs[2].read_text())
    assert summary["singles"]["found"]["hits"] == 1
    assert summary["nulls"]["wrong_named"] == rate(pd.Series([False]))
    assert summary["unlisted"]["detected"]["hits"] == 1
    assert pd.read_parquet(tmp_path / "2-design").empty
    hidden_effects.draw(outputs[0], tmp_path / "a.png", tmp_path / "a.csv")
