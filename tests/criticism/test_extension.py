"""Extensions learnt from a study whose answers are known, and the closed forms."""

import json
import re

import numpy as np
import pandas as pd
import pytest
import torch

from regional_lv.channels import Channels
from regional_lv.criticism.differences import Scale
from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.criticism.extension import Extension, read_extensions, train_extension
from regional_lv.criticism.hypotheses import (
    REGISTRY,
    LoadHypothesis,
    NoiseHypothesis,
    ReportHypothesis,
    SimulatorHypothesis,
    asked,
)
from regional_lv.criticism.hypotheses.base import value_at, with_value
from regional_lv.criticism.injection import read_effects
from regional_lv.emulators.base import Prediction
from regional_lv.errors import InputError
from regional_lv.parameters import Parameterisation
from regional_lv.physics import physics_of
from regional_lv.registry import load_plugins, temporary
from tests.criticism.toy import CHANNELS, OUTPUTS, PARAMETERS


class KnownEmulator:
    """A base emulator that is exact: smooth outputs of theta in closed form."""

    outputs, parameters = OUTPUTS, PARAMETERS

    def predict(self, theta):
        return Prediction(self.predict_mean(theta), None)

    def predict_mean(self, theta):
        return base_outputs(theta)


MIX = torch.as_tensor(np.random.default_rng(0).normal(0, 0.03, (52, 10)))


def base_outputs(theta):
    """Volume about 180 mL, strains about +-0.2; (..., 52)."""
    effect = torch.log(theta) @ MIX.T
    sign = torch.tensor([1.0] + [-1.0] * 17 + [1.0] * 17 + [-1.0] * 17, dtype=theta.dtype)
    strain = 0.2 * sign * torch.exp(-effect)
    return torch.cat([180 * torch.exp(-effect[..., :1]), strain[..., 1:]], -1)


def extended_outputs(theta, z):
    """Logarithmic change quadratic in the hypothesis's coordinate z and smooth in theta."""
    base = base_outputs(theta)
    d = 0.05 * z * torch.exp(torch.log(theta) @ MIX.flip(0).T) + 0.01 * z**2
    strain = ((1 + 2 * base[..., 1:]) * torch.exp(2 * d[..., 1:]) - 1) / 2
    return torch.cat([base[..., :1] * torch.exp(d[..., :1]), strain], -1)


@pytest.fixture(scope="module")
def physics(smoke_config):
    return physics_of(smoke_config)


def closed_form(name):
    return Extension(REGISTRY[name], OUTPUTS, 2.0)


def train(name, physics, folder, batches=()):
    files = folder / "extension.pt", folder / "extension.json"
    train_extension(name, physics, PARAMETERS, CHANNELS, 3, *files, batches)
    return read_extensions([files[0]])


@pytest.fixture(scope="module")
def hypothesis():
    return REGISTRY["wall_thickness"]


@pytest.fixture(scope="module")
def study(tmp_path_factory, hypothesis, physics):
    """Forty anchors at the base and the nodes, one of which failed; trained."""
    folder = tmp_path_factory.mktemp("extension")
    rng, rows = np.random.default_rng(1), []
    for anchor in range(40):
        theta = torch.as_tensor(np.exp(rng.uniform(np.log(0.1), np.log(5.0), 10)))
        for psi in (hypothesis.base, *hypothesis.nodes):
            z = float(hypothesis.scale(psi) - hypothesis.scale(hypothesis.base))
            slope = torch.autograd.functional.jacobian(lambda t, z=z: extended_outputs(t, z), theta)
            by_z = torch.autograd.functional.jacobian(
                lambda z, theta=theta: extended_outputs(theta, z), torch.tensor(0.0).double()
            )
            failed = anchor == 7 and psi == hypothesis.nodes[-1]
            row = {"component": "", "anchor": f"batch-0000/{anchor}", "psi": psi, "cpu_s": 1.0}
            row |= dict(zip(PARAMETERS.names, theta.tolist(), strict=True))
            row |= {"status": "failed" if failed else "converged"}
            outputs = extended_outputs(theta, z).tolist()
            row |= dict(zip(OUTPUTS, [np.nan] * 52 if failed else outputs, strict=True))
            row["sensitivity"] = [] if failed else slope.ravel().tolist()
            # At the base dz/dpsi = 1 for a logarithm about 1.
            row["slope"] = by_z.tolist() if psi == hypothesis.base else []
            rows.append(row)
    pd.DataFrame(rows).to_parquet(folder / "batch-0000.parquet", index=False)
    train("wall_thickness", physics, folder, [folder / "batch-0000.parquet"])
    return folder


@pytest.fixture(scope="module")
def extension(study):
    (found,) = read_extensions([study / "extension.pt"])
    return found


@pytest.fixture(scope="module")
def theta():
    return torch.as_tensor(np.exp(np.random.default_rng(2).uniform(-1.0, 1.0, (6, 10))))


def test_differences_are_those_of_the_extended_model(extension, hypothesis, theta):
    psi = torch.tensor([0.8, 0.9, 1.1, 1.2, 0.75, 1.0], dtype=theta.dtype)
    truth = extended_outputs(theta, torch.log(psi)[:, None]) - base_outputs(theta)
    found = extension.difference(base_outputs(theta), theta, psi)
    np.testing.assert_allclose(found.mean[:, 1:], truth[:, 1:], rtol=0, atol=2e-4)
    np.testing.assert_allclose(found.mean[:, 0], truth[:, 0], rtol=0, atol=0.1)
    assert found.covariance.shape == (6, 52, 52)
    eigenvalues = torch.linalg.eigvalsh(found.covariance)
    assert (eigenvalues > -1e-9 * eigenvalues.amax()).all()


def test_the_mean_alone_is_that_of_the_difference(extension, hypothesis, theta):
    outputs = base_outputs(theta)
    psi = torch.full(theta.shape[:-1], hypothesis.high, dtype=theta.dtype)
    expected = extension.difference(outputs, theta, psi).mean
    assert torch.allclose(extension.mean(outputs, theta, psi), expected, atol=1e-12)
    fewer = ("volume_ml", "radial_07")
    at = [OUTPUTS.index(name) for name in fewer]
    some = extension.select(fewer).mean(outputs[..., at], theta, psi)
    assert torch.allclose(some, expected[..., at], atol=1e-12)


def test_no_difference_at_the_base(extension, hypothesis, theta):
    psi = torch.full((6,), hypothesis.base, dtype=theta.dtype)
    found = extension.difference(base_outputs(theta), theta, psi)
    assert (found.mean == 0).all() and (found.covariance == 0).all()


def test_leading_shapes_and_one_psi_for_all(extension, theta):
    psi = torch.tensor(1.1, dtype=theta.dtype)
    outputs = base_outputs(theta)
    flat = extension.difference(outputs, theta, psi)
    folded = extension.difference(
        outputs.reshape(2, 3, 52), theta.reshape(2, 3, 10), psi.expand(2, 3)
    )
    assert folded.mean.shape == (2, 3, 52) and folded.covariance.shape == (2, 3, 52, 52)
    torch.testing.assert_close(folded.mean.reshape(6, 52), flat.mean)


def test_derivatives_are_those_of_the_values(extension, theta):
    """By theta and by psi, against differences of the mean and the variance."""
    theta, psi = theta[:1], torch.tensor([1.15], dtype=theta.dtype)

    def both(theta, psi):
        found = extension.difference(base_outputs(theta), theta, psi)
        return found.mean[0, 20], found.covariance[0, 20, 20] * 1e6

    at = theta.clone().requires_grad_(True), psi.clone().requires_grad_(True)
    for k in (0, 1):
        by_theta, by_psi = torch.autograd.grad(both(*at)[k], at)
        h = 1e-4  # the variance is what is left of numbers near one
        beside = [both(theta, psi + s * h)[k] for s in (1, -1)]
        assert float(by_psi) == pytest.approx(float(beside[0] - beside[1]) / (2 * h), rel=1e-4)
        step = torch.zeros_like(theta)
        step[0, 3] = h
        beside = [both(theta + s * step, psi)[k] for s in (1, -1)]
        slope = float(beside[0] - beside[1]) / (2 * h)
        assert float(by_theta[0, 3]) == pytest.approx(slope, rel=1e-3, abs=1e-9)


def test_some_outputs_are_those_of_all(extension, theta):
    psi, outputs = torch.tensor(0.85, dtype=theta.dtype), base_outputs(theta)
    names = ("radial_05", "volume_ml", "circumferential_17")
    index = [OUTPUTS.index(name) for name in names]
    all_of_them = extension.difference(outputs, theta, psi)
    chosen = extension.select(names).difference(outputs[:, index], theta, psi)
    torch.testing.assert_close(chosen.mean, all_of_them.mean[:, index])
    torch.testing.assert_close(
        chosen.covariance, all_of_them.covariance[:, index][:, :, index], rtol=1e-6, atol=1e-14
    )
    with pytest.raises(InputError, match="select the same of both"):
        ExtendedEmulator(KnownEmulator(), [extension.select(names)])


def test_outputs_that_an_effect_leaves_alone(extension, theta):
    """As of a subject whose volume alone was measured, and an effect on strains."""
    other = extension.select(["radial_05"]).select(["volume_ml"])
    psi, volume = torch.tensor(0.85, dtype=theta.dtype), base_outputs(theta)[:, :1]
    found = other.difference(volume, theta, psi)
    assert (found.mean == 0).all() and found.covariance.shape == (6, 1, 1)
    assert (other.mean(volume, theta, psi) == 0).all()


def test_the_report_tells_failures_and_errors(study, extension):
    report = json.loads((study / "extension.json").read_text())["components"][0]
    assert extension.fraction_simulated == report["fraction_simulated"] == pytest.approx(79 / 80)
    assert report["anchors"] == 39
    assert report["relative_error"] < 0.05
    # The derivative by psi at the base comes with the polynomial, from nodes far away.
    assert report["relative_error_of_slope"] < 0.05
    assert 0.8 < report["coverage95"] <= 1.0


# ---------------------------------------------------------------------------- closed forms


def test_pressure_hides_in_the_stiffness(theta):
    """Twice the pressure and twice every C_a: no difference is left."""
    extended = ExtendedEmulator(KnownEmulator(), [closed_form("end_diastolic_pressure")])
    doubled = theta.clone()
    doubled[:, 0::2] *= 2
    found = extended.mean(doubled, torch.full((6, 1), 16.0).double().log())
    torch.testing.assert_close(found, base_outputs(theta))


def test_mixed_frames_leave_the_volume(theta):
    extended = ExtendedEmulator(KnownEmulator(), [closed_form("mixed_frames")])
    found = extended.mean(theta, torch.full((6, 1), 0.5).double())
    stiffer = theta.clone()
    stiffer[:, 0::2] *= 2
    torch.testing.assert_close(found[:, 0], base_outputs(theta)[:, 0])
    torch.testing.assert_close(found[:, 1:], base_outputs(stiffer)[:, 1:])


def test_radial_scale_scales_radial_strains(theta):
    extension, outputs = closed_form("radial_scale"), base_outputs(theta)
    found = extension.difference(outputs, theta, torch.full((6,), 1.3, dtype=theta.dtype)).mean
    torch.testing.assert_close(found[:, 18:35], 0.3 * outputs[:, 18:35])
    assert (np.delete(found.numpy(), range(18, 35), axis=1) == 0).all()


@pytest.mark.parametrize(
    "name",
    [
        n
        for n, h in REGISTRY.items()
        if isinstance(h, LoadHypothesis | ReportHypothesis | NoiseHypothesis)
    ],
)
def test_closed_forms_survive_their_file(tmp_path, theta, physics, name):
    hypothesis = REGISTRY[name]
    (found,) = train(name, physics, tmp_path)
    assert found.hypothesis.name == name and found.fraction_simulated == 1.0
    psi = torch.full((6,), hypothesis.base, dtype=theta.dtype)
    zero = found.difference(base_outputs(theta), theta, psi)
    assert (zero.mean == 0).all() and (zero.covariance == 0).all()


# ------------------------------------------------------------------------------- catalogue


CATALOGUE = (
    *("end_diastolic_pressure", "fibre_rotation", "helix_endo", "helix_epi", "sheet_angle"),
    *("basal_motion", "basal_twist", "basal_axial", "endocardial_sampling"),
    *("epicardial_sampling", "strain_measure", "line_strain", "septal_load", "epicardial_support"),
    *("wall_thickness", "focal_scar", "radial_scale", "segment_rotation", "mixed_frames"),
    *("compressibility", "anisotropy", "sheet_stiffness", "exponent_ratio", "heavy_tails"),
)


def test_the_catalogue_is_complete(physics):
    assert set(REGISTRY) == set(CATALOGUE)
    for name, h in REGISTRY.items():
        assert h.name == name and h.low <= h.base <= h.high and h.low < h.high
        assert h.description and h.source and h.parameter and h.unit
        psi = np.linspace(h.low, h.high, 50)
        scaled = [h.scale(float(value)) for value in psi]
        np.testing.assert_allclose([h.scale.inverse(value) for value in scaled], psi, atol=1e-12)
        tensor = torch.tensor(psi, requires_grad=True)
        np.testing.assert_allclose(h.scale.inverse(h.scale(tensor)).detach(), psi, atol=1e-12)
        (by_psi,) = torch.autograd.grad(h.scale(tensor + 0 * tensor).sum(), tensor)
        np.testing.assert_allclose(1 / by_psi, h.scale.slope(psi) * np.ones(50), rtol=1e-9)
        if isinstance(h, SimulatorHypothesis):
            assert h.base not in h.nodes
            assert all(h.low <= node <= h.high for node in h.nodes)
    # Green's strain of a line is that of the tensor.
    assert set(REGISTRY) - set(asked("all", physics)) == {"line_strain"}
    with pytest.raises(InputError, match="did you mean focal_scar"):
        asked(["focal_scars"], physics)


def test_what_the_study_has_already_is_not_asked(physics):
    physics = with_value(physics, ("loading", "septal_pressure_mmhg"), 3.0)
    physics = with_value(physics, ("supports", "base", "radial"), 2.0)
    left_out = {"basal_motion", "septal_load", "end_diastolic_pressure", "mixed_frames"}
    assert set(REGISTRY) - set(asked("all", physics)) == {"line_strain"} | left_out


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("material", "bulk_modulus_kpa"), 300.0),
        (("supports", "epicardium_kpa_per_mm"), 0.01),
        (("supports", "base", "axial"), 2.0),
        (("loading", "septal_pressure_mmhg"), 3.0),
        (("parameters", "factors"), ["C_b"]),
    ],
)
def test_only_a_scaling_study_is_asked_for_its_pressure(physics, path, value):
    name = "end_diastolic_pressure"
    assert REGISTRY[name].why_not(physics) == ""
    assert REGISTRY[name].why_not(with_value(physics, path, value))
    free = with_value(physics, ("supports", "base", "circumferential"), "held")
    assert REGISTRY[name].why_not(free) == ""


def test_a_law_without_sheets_is_not_asked_for_them(physics):
    material = physics["material"] | {"law": "guccione", "constants": {}, "reference": {}}
    parameters = Parameterisation(law="guccione").spec()
    left_out = set(REGISTRY) - set(
        asked("all", physics | {"material": material, "parameters": parameters})
    )
    assert left_out == {"line_strain", "anisotropy", "sheet_stiffness", "sheet_angle"}
    reason = REGISTRY["anisotropy"].why_not(physics | {"material": material})
    assert reason == "the law guccione has no constant a_f_kpa"


def test_what_is_not_observed_is_not_asked(physics):
    physics = with_value(physics, ("observables", "quantities"), ["volume", "torsion"])
    left_out = set(REGISTRY) - set(asked("all", physics))
    sampled = {"endocardial_sampling", "epicardial_sampling", "strain_measure", "line_strain"}
    assert left_out == sampled | {"segment_rotation", "radial_scale"}


def test_the_range_of_the_pressure_is_the_studys(physics):
    physics = with_value(physics, ("loading", "pressure_mmhg"), 10.0)
    pressure = asked("all", physics)["end_diastolic_pressure"]
    assert (pressure.base, pressure.low, pressure.high) == (10.0, 5.0, 20.0)
    assert REGISTRY["end_diastolic_pressure"].base == 8.0


def test_the_measure_starts_from_the_studys(physics):
    """With nominal strains at its base, lines differ from the tensor, and Green's is a node. From
    Green's strain, the other measure is one of the tensor or of the line."""
    from_green = asked("all", physics)["strain_measure"].components
    assert from_green == ("", "material line")
    physics = with_value(physics, ("observables", "strain_exponent"), 1.0)
    found = asked("all", physics)
    assert found["strain_measure"].base == 1.0
    assert found["strain_measure"].nodes == (-2.0, 0.0, 2.0)
    assert "line_strain" in found and found["strain_measure"].components == ("",)
    lines = with_value(physics, ("observables", "line_share"), 1.0)
    assert asked(["line_strain"], lines)["line_strain"].nodes == (0.0, 0.5)
    assert REGISTRY["strain_measure"].base == 2.0


def test_psi_reaches_its_keys(physics):
    """What each hypothesis writes; constants and angles start from the study's own."""

    def value(name, psi, path, physics=physics):
        return value_at(REGISTRY[name].extend(physics, psi), path)

    assert value("basal_twist", 4.0, ("supports", "base", "circumferential")) == 0.25
    assert value("basal_axial", 4.0, ("supports", "base", "axial")) == 4.0
    assert value("endocardial_sampling", 0.25, ("observables", "layer")) == [0.0, 0.75]
    assert value("epicardial_sampling", 0.25, ("observables", "layer")) == [0.25, 1.0]
    assert value("helix_epi", -5.0, ("fibres", "helix_epi_deg")) == -65.0
    sheets = REGISTRY["sheet_angle"].extend(physics, 10.0)["fibres"]
    assert (sheets["sheet_endo_deg"], sheets["sheet_epi_deg"]) == (55.0, -55.0)
    path = ("material", "constants", "a_f_kpa")
    assert value("anisotropy", 2.0, path) == pytest.approx(2 * 20.037)
    own = with_value(physics, path, 10.0)
    assert value("anisotropy", 2.0, path, own) == 20.0
    assert "a_f_kpa" not in physics["material"]["constants"]


# ---------------------------------------------------- other channels, and what a plugin adds


MIXED = Channels.of(("volume", "radial", "torsion", "shortening"), load_fractions=(0.5,))


def test_differences_of_other_quantities_are_plain():
    """Volumes and strains by their logarithms at every load, all others as they are."""
    scale = Scale(MIXED, 2.0)
    torsion = MIXED.of_quantity("torsion") | MIXED.of_quantity("shortening")
    mean = torch.as_tensor(np.where(MIXED.is_strain, 0.3, np.where(torsion, 0.2, 150.0)))
    change = torch.full_like(mean, 0.1)
    found, slope = scale.differences(mean, change, 2.0)
    volume, radial = MIXED.of_quantity("volume"), MIXED.of_quantity("radial")
    assert MIXED.load_fractions == (1.0, 0.5) and radial.sum() == 34 and torsion.sum() == 4
    np.testing.assert_allclose(found[volume], 150.0 * np.expm1(0.1))
    np.testing.assert_allclose(found[radial], (1.6 * np.exp(0.2) - 1) / 2 - 0.3)
    np.testing.assert_allclose(found[torsion], 0.1)
    h = 1e-6
    ahead, _ = scale.differences(mean, change + h, 2.0)
    np.testing.assert_allclose((ahead - found) / h, slope, rtol=1e-5)
    sensitivity = np.ones((1, len(MIXED), 2))
    before, _ = scale.logarithms(mean.numpy()[None], sensitivity, 2.0)
    after, _ = scale.logarithms((mean + found).numpy()[None], sensitivity, 2.0)
    np.testing.assert_allclose(after - before, 0.1)


@pytest.mark.parametrize("own", [2.0, 1.0, 0.0])
@pytest.mark.parametrize("n", [2.0, 1.0, 0.0, -2.0])
def test_another_measure_of_a_line_needs_no_emulator(own, n):
    """The strain of a stretch, from that of another exponent: what is emulated is nothing."""
    stretch = torch.linspace(0.5, 1.9, 17, dtype=torch.float64)

    def strain(exponent):
        return stretch.log() if exponent == 0 else (stretch**exponent - 1) / exponent

    scale = Scale(Channels.of(("radial",)), own)
    psi = torch.tensor(n, dtype=torch.float64)
    found, _ = scale.differences(strain(own), torch.zeros(17).double(), psi)
    np.testing.assert_allclose(strain(own) + found, strain(n), atol=1e-12)
    assert n != own or (found == 0).all()
    step = torch.tensor(1e-6, dtype=torch.float64)
    psi = psi.clone().requires_grad_(True)
    mean = scale.differences(strain(own), torch.zeros(17).double(), psi)[0]
    (by_psi,) = torch.autograd.grad(mean.sum(), psi)
    ahead, behind = (
        scale.differences(strain(own), torch.zeros(17).double(), psi.detach() + s * step)[0].sum()
        for s in (1, -1)
    )
    assert float(by_psi) == pytest.approx(float((ahead - behind) / (2 * step)), rel=1e-3)
    value, slope = scale.logarithms(strain(n).numpy()[None], np.ones((1, 17, 1)), n)
    np.testing.assert_allclose(value[0], stretch.log(), atol=1e-12)
    np.testing.assert_allclose(slope[0, :, 0], (stretch**-n).numpy(), rtol=1e-9)


@pytest.fixture
def without_effect(tmp_path):
    """Simulations of a hypothesis that changes nothing."""
    rng, rows = np.random.default_rng(1), []
    hypothesis = REGISTRY["sheet_angle"]
    for anchor in range(12):
        theta = torch.as_tensor(np.exp(rng.uniform(-1, 1, 10)))
        for psi in (hypothesis.base, *hypothesis.nodes):
            row = {"component": "", "anchor": f"a/{anchor}", "psi": psi, "cpu_s": 1.0}
            row |= dict(zip(PARAMETERS.names, theta.tolist(), strict=True))
            row |= dict(zip(OUTPUTS, base_outputs(theta).tolist(), strict=True))
            row |= {"status": "converged", "sensitivity": [0.0] * 520}
            rows.append(row | {"slope": [0.0] * 52 if psi == 0 else []})
    return pd.DataFrame(rows)


def test_a_cause_that_cannot_be_simulated_is_left_out(tmp_path, physics, without_effect):
    """Of twelve anchors, eight fail at the last value of psi: no extension, and the study goes on
    with a report that says why."""
    last = without_effect["psi"] == REGISTRY["sheet_angle"].nodes[-1]
    failed = last & (without_effect["anchor"].str.partition("/")[2].astype(int) < 8)
    without_effect.loc[failed, "status"] = "failed"
    without_effect.to_parquet(tmp_path / "batch.parquet", index=False)
    assert train("sheet_angle", physics, tmp_path, [tmp_path / "batch.parquet"]) == []
    (component,) = json.loads((tmp_path / "extension.json").read_text())["components"]
    assert re.match(r".*sheet_angle converged .* 4 of 12 anchors", component["left_out"])


def test_an_effect_that_changes_nothing(tmp_path, physics, without_effect):
    """Simulated, trained, read again: no difference, and the criticism says so."""
    without_effect.to_parquet(tmp_path / "batch.parquet", index=False)
    (found,) = train("sheet_angle", physics, tmp_path, [tmp_path / "batch.parquet"])
    theta = torch.ones(3, 10).double()
    psi = torch.full((3,), 20.0).double()
    assert (found.difference(base_outputs(theta), theta, psi).mean == 0).all()
    assert (found.mean(base_outputs(theta), theta, psi) == 0).all()


def test_a_hypothesis_from_outside(tmp_path, theta, physics):
    """One class in a plugin: asked, simulated, trained and read again like those of the package."""
    plugin = tmp_path / "plugin.py"
    plugin.write_text(
        """
from regional_lv.criticism.hypotheses import REGISTRY, ReportHypothesis
from regional_lv.criticism.hypotheses.base import with_value


class Gain(ReportHypothesis):
    name, parameter, unit = "toy_gain", "gain of all channels", "1"
    description, source = "All channels are multiplied by one number.", "made up"
    base, low, high = 1.0, 0.5, 1.5

    def extend(self, physics, value, component=""):
        scale = {"volume": value, "radial": value}
        return with_value(physics, ("observables", "scale"), scale)

    def reported(self, mean, outputs, psi):
        return psi[..., None] * mean


REGISTRY.add(Gain())
"""
    )
    with temporary():
        load_plugins([plugin])
        assert "toy_gain" in asked("all", physics)
        (found,) = train("toy_gain", physics, tmp_path)
        psi = torch.full((6,), 1.2, dtype=theta.dtype)
        difference = found.difference(base_outputs(theta), theta, psi).mean
        torch.testing.assert_close(difference, 0.2 * base_outputs(theta))
        (effect,) = read_effects({"toy_gain": 1.2})
        extended = effect.hypothesis.extend(physics, effect.value)
        assert extended["observables"]["scale"] == {"volume": 1.2, "radial": 1.2}
    assert "toy_gain" not in REGISTRY
