"""Extensions learnt from a study whose answers are known, and the closed forms."""

import json

import numpy as np
import pandas as pd
import pytest
import torch

from regional_lv import aha
from regional_lv.criticism.extension import Extension, read_extensions, train_extension
from regional_lv.criticism.hypotheses import (
    REGISTRY,
    NoiseHypothesis,
    SimulatorHypothesis,
    TransformHypothesis,
    asked,
)
from regional_lv.emulators.base import Prediction
from regional_lv.errors import InputError

BOUNDS = (0.1, 5.0)


class KnownEmulator:
    """A base emulator that is exact: smooth outputs of theta in closed form."""

    outputs = aha.OUTPUTS

    def predict(self, theta):
        return Prediction(base_outputs(theta), None)

    def outside(self, theta):
        return ((theta < BOUNDS[0]) | (theta > BOUNDS[1])).any(-1)

    def select(self, outputs):
        chosen = KnownEmulator()
        chosen.outputs = tuple(outputs)
        index = [aha.OUTPUTS.index(name) for name in outputs]
        chosen.predict = lambda theta: Prediction(base_outputs(theta)[..., index], None)
        return chosen


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
def hypothesis():
    return REGISTRY["wall_thickness"]


@pytest.fixture(scope="module")
def study(tmp_path_factory, hypothesis):
    """Forty anchors at the base and the nodes, one of which failed; trained."""
    folder = tmp_path_factory.mktemp("extension")
    rng, rows = np.random.default_rng(1), []
    for anchor in range(40):
        theta = torch.as_tensor(np.exp(rng.uniform(np.log(0.1), np.log(5.0), 10)))
        for psi in (hypothesis.base, *hypothesis.nodes):
            z = float(hypothesis.coordinate(psi) - hypothesis.coordinate(hypothesis.base))
            slope = torch.autograd.functional.jacobian(lambda t, z=z: extended_outputs(t, z), theta)
            by_z = torch.autograd.functional.jacobian(
                lambda z, theta=theta: extended_outputs(theta, z), torch.tensor(0.0).double()
            )
            failed = anchor == 7 and psi == hypothesis.nodes[-1]
            row = {"component": "", "anchor": f"batch-0000/{anchor}", "psi": psi, "cpu_s": 1.0}
            row |= dict(zip(aha.PARAMETERS, theta.tolist(), strict=True))
            row |= {"status": "failed" if failed else "converged"}
            outputs = extended_outputs(theta, z).tolist()
            row |= dict(zip(aha.OUTPUTS, [np.nan] * 52 if failed else outputs, strict=True))
            row["sensitivity"] = [] if failed else slope.ravel().tolist()
            # At the base dz/dpsi = 1 for a logarithm about 1.
            row["slope"] = by_z.tolist() if psi == hypothesis.base else []
            rows.append(row)
    pd.DataFrame(rows).to_parquet(folder / "batch-0000.parquet", index=False)
    train_extension(
        *(hypothesis, [folder / "batch-0000.parquet"], BOUNDS, 3),
        *(folder / "extension.pt", folder / "extension.json"),
    )
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
    found = extension.difference(KnownEmulator(), theta, psi)
    np.testing.assert_allclose(found.mean[:, 1:], truth[:, 1:], rtol=0, atol=2e-4)
    np.testing.assert_allclose(found.mean[:, 0], truth[:, 0], rtol=0, atol=0.1)
    assert found.covariance.shape == (6, 52, 52)
    eigenvalues = torch.linalg.eigvalsh(found.covariance)
    assert (eigenvalues > -1e-9 * eigenvalues.amax()).all()


def test_the_mean_alone_is_that_of_the_difference(extension, hypothesis, theta):
    base, psi = KnownEmulator(), torch.full(theta.shape[:-1], hypothesis.high, dtype=theta.dtype)
    expected = extension.difference(base, theta, psi).mean
    assert torch.allclose(extension.mean(base, theta, psi), expected, atol=1e-12)
    known = extension.mean(None, theta, psi, base_outputs(theta))
    assert torch.allclose(known, expected, atol=1e-12)
    fewer = ("volume_ml", "radial_07")
    some = extension.select(fewer).mean(base.select(fewer), theta, psi)
    at = [aha.OUTPUTS.index(name) for name in fewer]
    assert torch.allclose(some, expected[..., at], atol=1e-12)


def test_no_difference_at_the_base(extension, hypothesis, theta):
    psi = torch.full((6,), hypothesis.base, dtype=theta.dtype)
    found = extension.difference(KnownEmulator(), theta, psi)
    assert (found.mean == 0).all() and (found.covariance == 0).all()


def test_leading_shapes_and_one_psi_for_all(extension, theta):
    psi = torch.tensor(1.1, dtype=theta.dtype)
    flat = extension.difference(KnownEmulator(), theta, psi)
    folded = extension.difference(KnownEmulator(), theta.reshape(2, 3, 10), psi.expand(2, 3))
    assert folded.mean.shape == (2, 3, 52) and folded.covariance.shape == (2, 3, 52, 52)
    torch.testing.assert_close(folded.mean.reshape(6, 52), flat.mean)


def test_derivatives_are_those_of_the_values(extension, theta):
    """By theta and by psi, against differences of the mean and the variance."""
    theta, psi = theta[:1], torch.tensor([1.15], dtype=theta.dtype)

    def both(theta, psi):
        found = extension.difference(KnownEmulator(), theta, psi)
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
    psi, base = torch.tensor(0.85, dtype=theta.dtype), KnownEmulator()
    names = ("radial_05", "volume_ml", "circumferential_17")
    index = [aha.OUTPUTS.index(name) for name in names]
    all_of_them = extension.difference(base, theta, psi)
    chosen = extension.select(names).difference(base.select(names), theta, psi)
    torch.testing.assert_close(chosen.mean, all_of_them.mean[:, index])
    torch.testing.assert_close(
        chosen.covariance, all_of_them.covariance[:, index][:, :, index], rtol=1e-6, atol=1e-14
    )
    with pytest.raises(InputError, match="select the same of both"):
        extension.select(names).difference(base, theta, psi)


def test_the_report_tells_failures_and_errors(study, extension):
    report = json.loads((study / "extension.json").read_text())["components"][0]
    assert extension.fraction_simulated == report["fraction_simulated"] == pytest.approx(79 / 80)
    assert report["anchors"] == 39
    assert report["relative_error"] < 0.05
    # The derivative by psi at the base comes with the polynomial, from nodes far away.
    assert report["relative_error_of_slope"] < 0.05
    assert 0.8 < report["coverage95"] <= 1.0


def test_outside_says_where_it_extrapolates(extension, theta):
    inside, beyond = (torch.tensor(psi, dtype=theta.dtype) for psi in (1.2, 1.3))
    base = KnownEmulator()
    assert not extension.outside(base, theta, inside).any()
    assert extension.outside(base, theta, beyond).all()
    assert extension.outside(base, 10 * theta, inside).any()
    pressure = Extension(REGISTRY["end_diastolic_pressure"])
    four = torch.tensor(4.0, dtype=theta.dtype)
    stiff = torch.full((1, 10), 4.0, dtype=theta.dtype)
    assert pressure.outside(base, stiff, four.expand(1)).all()


# ---------------------------------------------------------------------------- closed forms


def test_pressure_hides_in_the_stiffness(theta):
    """Twice the pressure and twice every C_a: no difference is left."""
    extension, base = Extension(REGISTRY["end_diastolic_pressure"]), KnownEmulator()
    psi = torch.full((6,), 16.0, dtype=theta.dtype)
    doubled = theta.clone()
    doubled[:, 0::2] *= 2
    found = extension.difference(base, doubled, psi).mean + base_outputs(doubled)
    torch.testing.assert_close(found, base_outputs(theta))


def test_mixed_frames_leave_the_volume(theta):
    extension, base = Extension(REGISTRY["mixed_frames"]), KnownEmulator()
    found = extension.difference(base, theta, torch.full((6,), 0.5, dtype=theta.dtype)).mean
    stiffer = theta.clone()
    stiffer[:, 0::2] *= 2
    assert (found[:, 0] == 0).all()
    torch.testing.assert_close(found[:, 1:], (base_outputs(stiffer) - base_outputs(theta))[:, 1:])


def test_radial_scale_scales_radial_strains(theta):
    extension, base = Extension(REGISTRY["radial_scale"]), KnownEmulator()
    found = extension.difference(base, theta, torch.full((6,), 1.3, dtype=theta.dtype)).mean
    torch.testing.assert_close(found[:, 18:35], 0.3 * base_outputs(theta)[:, 18:35])
    assert (np.delete(found.numpy(), range(18, 35), axis=1) == 0).all()


@pytest.mark.parametrize(
    "name", [n for n, h in REGISTRY.items() if isinstance(h, TransformHypothesis | NoiseHypothesis)]
)
def test_closed_forms_survive_their_file(tmp_path, theta, name):
    hypothesis = REGISTRY[name]
    files = tmp_path / "extension.pt", tmp_path / "extension.json"
    train_extension(hypothesis, [], BOUNDS, 0, *files)
    (found,) = read_extensions([files[0]])
    assert found.hypothesis.name == name and found.fraction_simulated == 1.0
    psi = torch.full((6,), hypothesis.base, dtype=theta.dtype)
    zero = found.difference(KnownEmulator(), theta, psi)
    assert (zero.mean == 0).all() and (zero.covariance == 0).all()


# ------------------------------------------------------------------------------- catalogue


def test_the_catalogue_is_complete(smoke_config):
    effects = _effects_schema()
    assert set(REGISTRY) == set(effects)
    for name, h in REGISTRY.items():
        assert h.name == name and h.low <= h.base <= h.high and h.low < h.high
        assert h.description and h.source and h.parameter and h.unit
        unit = effects[name].get("unit", "1")
        assert unit == h.unit or name == "focal_scar"
        if isinstance(h, SimulatorHypothesis):
            assert h.base not in h.nodes
            assert all(h.low <= node <= h.high for node in h.nodes)
            zs = [h.coordinate(float(psi)) for psi in np.linspace(h.low, h.high, 50)]
            assert (np.diff(zs) > 0).all()
            tensors = h.coordinate(torch.linspace(h.low, h.high, 50, dtype=torch.float64))
            np.testing.assert_allclose(tensors, zs)
    assert list(asked("all", smoke_config)) == list(REGISTRY)


def _effects_schema():
    from regional_lv.schema import load_schema

    subject = load_schema()["properties"]["synthetic_subjects"]["patternProperties"]
    return next(iter(subject.values()))["properties"]["effects"]["properties"]


def test_what_the_study_has_already_is_not_asked(smoke_config):
    loading = smoke_config["loading"] | {"base": "fixed", "septal_pressure_mmhg": 3.0}
    names = asked("all", smoke_config | {"loading": loading})
    left_out = {"basal_motion", "septal_load", "end_diastolic_pressure", "mixed_frames"}
    assert set(REGISTRY) - set(names) == left_out


def test_the_range_of_the_pressure_is_the_studys(smoke_config):
    loading = smoke_config["loading"] | {"pressure_mmhg": 10.0}
    pressure = asked("all", smoke_config | {"loading": loading})["end_diastolic_pressure"]
    assert (pressure.base, pressure.low, pressure.high) == (10.0, 5.0, 20.0)
    assert REGISTRY["end_diastolic_pressure"].base == 8.0
