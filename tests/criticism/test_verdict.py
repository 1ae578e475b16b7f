"""The whole criticism of hearts in closed form: what is injected is found, and nothing else."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from regional_lv import aha
from regional_lv.criticism.findings import findings_of, write_findings
from regional_lv.criticism.observations import observe
from regional_lv.criticism.report import write_report
from regional_lv.criticism.verdict import Settings, criticise
from regional_lv.errors import InputError
from tests.criticism.toy import (
    TAILS,
    THETA,
    Extension,
    Hypothesis,
    ToyEmulator,
    basal,
    bias,
    catalogue,
    measured,
    pattern,
    scars,
)

BASAL = tuple(f"_{segment:02d}" for segment in aha.LEVELS["basal"])
SETTINGS = Settings(bootstrap=119, level=0.05, leading_p=0.02, leading_least=1, draws=500, rounds=2)


def findings(table, extensions=None, noises=(TAILS,), settings=SETTINGS):
    emulator = ToyEmulator()
    extensions = catalogue() if extensions is None else extensions
    o = observe({"heart": table}, emulator, 1.0)
    criticism = criticise(o, emulator, extensions, list(noises), settings, 7)
    return findings_of("heart", criticism, emulator, extensions, {"heart": table})


@pytest.fixture(scope="module")
def injected():
    return measured(ToyEmulator(), basal(), 0.8, seed=5)


@pytest.fixture(scope="module")
def found(injected):
    return findings(injected)


def test_injected_effect_is_named(found):
    assert found["named_cause"] == "basal_motion"
    assert found["misfit"]["detected"]
    (basal_motion,) = [h for h in found["hypotheses"] if h["name"] == "basal_motion"]
    low, high = basal_motion["interval95"]
    assert low < 0.8 < high
    assert found["gain"]["elpd"] > 2 * found["gain"]["elpd_se"]
    assert found["gain"]["rmse_after"] < found["gain"]["rmse_before"]
    assert found["remaining"]["p_value"] > 0.05


def test_pressure_is_reported_as_absorbed(found):
    (pressure,) = [h for h in found["hypotheses"] if h["name"] == "end_diastolic_pressure"]
    assert not pressure["identifiable"]
    assert "C_a of all zones together" in pressure["why"]
    assert pressure["elpd_gain"] is None


def test_findings_keep_the_contract(found, tmp_path):
    write_findings(found, tmp_path / "findings.json")
    content = json.loads((tmp_path / "findings.json").read_text())
    assert {"subject", "misfit", "hypotheses", "named_cause", "indistinguishable", "gain"} <= set(
        content
    )
    assert {"detected", "p_value", "channels"} <= set(content["misfit"])
    channel = {"quantity", "segment", "observed", "predicted", "sd", "z"}
    assert all(channel <= set(row) for row in content["misfit"]["channels"])
    assert len(content["misfit"]["channels"]) == 52
    keys = {"name", "p_value", "estimate", "interval95", "unit", "elpd_gain", "elpd_gain_se"}
    keys |= {"weight", "identifiable", "why"}
    assert all(keys <= set(row) for row in content["hypotheses"])
    gain = {"elpd", "elpd_se", "rmse_before", "rmse_after", "coverage_before", "coverage_after"}
    assert gain <= set(content["gain"])


def test_report_needs_nothing_but_itself(found, tmp_path):
    write_findings(found, tmp_path / "findings.json")
    figure, table = tmp_path / "residuals.png", tmp_path / "residuals.csv"
    write_report(tmp_path / "findings.json", tmp_path / "report.html", figure, table)
    page = (tmp_path / "report.html").read_text()
    assert "The cause is basal motion" in page
    assert page.count("data:image/png;base64,") == 4
    assert 'src="http' not in page and 'href="http' not in page
    assert "<link" not in page and "<script" not in page
    for name in ("residuals", "causes", "parameters", "theta"):
        assert (tmp_path / f"{name}.csv").stat().st_size > 0


def test_nothing_is_found_once_the_effect_is_removed():
    found = findings(measured(ToyEmulator(), seed=5))
    assert found["named_cause"] is None and found["indistinguishable"] == []
    assert found["words"][0].startswith("The model fits")
    assert any("Nothing was found" in s for s in found["words"])


def test_shuffled_channels_name_nothing(injected):
    """Within each direction: a mess that no listed cause explains."""
    shuffled = injected.copy()
    rng = np.random.default_rng(0)
    for _, rows in shuffled.groupby("quantity"):
        shuffled.loc[rows.index, "value"] = rng.permutation(rows["value"].to_numpy())
    found = findings(shuffled, noises=())
    assert found["misfit"]["detected"]
    assert found["named_cause"] is None
    assert any("No listed cause explains the misfit" in s for s in found["words"])


def test_a_cause_that_is_not_listed():
    """A wave that none of the causes resembles."""
    sign = np.tile([1.0, -1.0], 9)[:17]
    wave = sum(pattern("longitudinal", [s], 0.05 * sign[s - 1]) for s in range(1, 18))
    cause = Extension(Hypothesis("unheard_of", 0.0, 0.0, 2.0), wave)
    found = findings(measured(ToyEmulator(), cause, 1.0, seed=5), noises=())
    assert found["misfit"]["detected"]
    assert found["named_cause"] is None
    assert any("No listed cause explains the misfit" in s for s in found["words"])


def test_causes_that_look_alike_are_named_together(injected):
    """A twin with the same signature but for a hair in one channel."""
    twin = basal()
    twin = Extension(
        replace(twin.hypothesis, name="twin"), twin.pattern + pattern("radial", [17], 0.01)
    )
    found = findings(injected, [bias(), basal(), twin])
    assert found["named_cause"] is None
    assert set(found["indistinguishable"]) == {"basal_motion", "twin"}
    assert found["separating"][0]["channels"][0]["output"] == "radial_17"


def test_a_lower_load_tells_apart_what_end_diastole_cannot(injected):
    """A twin with the same signature, of an effect that shrinks with the load as springs do."""
    twin = basal()
    twin = Extension(replace(twin.hypothesis, name="twin", load_power=1.0), twin.pattern)
    settings = replace(SETTINGS, load_fractions=(0.75, 0.5))
    found = findings(injected, [bias(), basal(), twin], settings=settings)
    assert set(found["indistinguishable"]) == {"basal_motion", "twin"}
    best = found["separating"][0]["channels"][0]
    assert best["load_fraction"] == 0.5 and best["output"].endswith(BASAL)
    assert any("at 50 % of the end-diastolic pressure" in sentence for sentence in found["words"])


def test_a_scar_is_found_in_its_segment():
    found = findings(measured(ToyEmulator(), scars()[9], 0.8, seed=5))
    assert (found["named_cause"], found["named_component"]) == ("focal_scar", "10")


def test_two_effects_come_one_after_the_other():
    emulator = ToyEmulator()
    table = measured(emulator, basal(), 1.0, seed=5)
    more = bias().mean(emulator, THETA, torch.tensor(0.5, dtype=torch.float64))
    table["value"] += more.numpy()
    found = findings(table, [bias(), basal()], settings=replace(SETTINGS, rounds=3))
    assert {r["found"] for r in found["rounds"]} == {"basal_motion", "radial_scale", None}
    assert found["explained"]


def test_noise_that_is_inferred():
    few = replace(SETTINGS, bootstrap=79, draws=250, rounds=1)
    table = measured(ToyEmulator(), bias(), 1.0, seed=5, known=False)
    found = findings(table, [bias(), basal()], settings=few)
    assert found["named_cause"] == "radial_scale"
    assert "overall" not in found["misfit"]["families"]
    assert {row["quantity"] for row in found["noise"]} == {
        "circumferential",
        "radial",
        "longitudinal",
    }


def test_few_channels_say_what_they_cannot():
    table = measured(ToyEmulator())
    table = table[table["quantity"].isin(["volume", "circumferential"])]
    table = table[table["segment"].isna() | (table["segment"] <= 6)]
    found = findings(table, [bias(), basal()])
    assert found["named_cause"] is None
    assert any("no radial strain" in s for s in found["limits"])
    assert any("no more channels than parameters" in s for s in found["limits"])


# -------------------------------------------------------------------------- several together


def together(known: bool):
    emulator, rng = ToyEmulator(), np.random.default_rng(2)
    thetas = torch.as_tensor(rng.uniform(0.6, 1.6, (3, 10)))
    scaled = thetas.clone()
    if known:
        scaled[:, 0::2] *= 1.3
        scaled[:, 1::2] *= 0.8
    tables = {
        f"heart{i}": measured(emulator, basal(), 0.3, seed=i, theta=theta)
        for i, theta in enumerate(scaled)
    }
    o = observe(tables, emulator, 1.0)
    extensions = [bias(), basal()]
    return (
        criticise(o, emulator, extensions, [], SETTINGS, 7, thetas if known else None),
        (emulator, extensions, tables),
    )


def test_known_hearts_on_an_unknown_material():
    criticism, rest = together(known=True)
    found = findings_of("all", criticism, *rest)
    assert found["named_cause"] == "basal_motion"
    factors = {row["parameter"]: row["after"] for row in found["theta"]}
    for name, truth in (("factor C_a", 1.3), ("factor C_b", 0.8)):
        mean, sd = factors[name]
        assert mean == pytest.approx(truth, abs=4 * sd)
    assert {c["subject"] for c in found["misfit"]["channels"]} == {"heart0", "heart1", "heart2"}


def test_hearts_of_unknown_theta_share_the_cause():
    criticism, _ = together(known=False)
    assert criticism.named.name == "basal_motion"
    x = criticism.named.sampled.fit.x[0]
    assert float(x[30]) == pytest.approx(0.3, abs=0.1)


def test_known_noise_and_unknown_do_not_mix():
    emulator = ToyEmulator()
    tables = {"a": measured(emulator), "b": measured(emulator, known=False)}
    with pytest.raises(InputError, match="criticise them apart"):
        observe(tables, emulator, 1.0)


def test_known_thetas_need_room_for_common_factors():
    emulator = ToyEmulator()
    theta = torch.ones(2, 10).double()
    theta[0], theta[1] = 0.11, 4.9
    o = observe({"a": measured(emulator), "b": measured(emulator)}, emulator, 1.0)
    with pytest.raises(InputError, match="nearer to its middle"):
        criticise(o, emulator, [], [], SETTINGS, 1, theta)
