"""One suite for every registered emulator, and what only the exact GP has."""

import json

import numpy as np
import pandas as pd
import pytest
import torch

from regional_lv import aha, emulators
from regional_lv.emulators.exact_gp import (
    KERNELS,
    ExactGP,
    _squared_distance,
    choose_shrinkage,
    leave_one_out,
)
from regional_lv.errors import InputError

NAMES = ("volume_ml", "circumferential_01", "radial_01", "radial_02", "longitudinal_05")
BOX = {"lower": 0.1, "upper": 5.0}


def toy(theta: np.ndarray) -> np.ndarray:
    """Five smooth outputs of the ten parameters, on scales as different as volume and strain."""
    x = np.log(theta)
    a, b = x[:, ::2] @ [0.5, 0.3, 0.2, 0.4, 0.1], x[:, 1::2] @ [0.2, 0.1, 0.3, 0.1, 0.2]
    columns = [150 - 20 * np.tanh(a), -0.2 + 0.05 * a, np.exp(-a), np.sin(b), a * b + 0.1 * b]
    return np.stack(columns, axis=1)


def points(n: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.1, 5.0, size=(n, 10))


@pytest.fixture(scope="module", params=sorted(emulators.REGISTRY))
def emulator(request):
    theta = points(150, 1)
    return emulators.create(request.param).fit(theta, toy(theta), outputs=NAMES, seed=3, **BOX)


def test_shapes(emulator):
    for shape in ((), (4,), (2, 3)):
        prediction = emulator.predict(torch.ones(*shape, 10, dtype=torch.float64))
        assert prediction.mean.shape == (*shape, 5)
        assert prediction.covariance.shape == (*shape, 5, 5)
        assert prediction.sd.shape == (*shape, 5)


def test_covariance_is_positive_definite(emulator):
    covariance = emulator.predict(torch.as_tensor(points(20, 2))).covariance
    assert torch.linalg.eigvalsh(covariance).min() > 0


def test_error_on_held_out_points(emulator):
    theta = points(200, 4)
    mean = emulator.predict(torch.as_tensor(theta)).mean.numpy()
    error = (mean - toy(theta)) / emulator.output_sd.numpy()
    assert np.sqrt((error**2).mean()) < 0.1


def test_intervals_hold_what_they_promise(emulator):
    theta = points(400, 5)
    prediction = emulator.predict(torch.as_tensor(theta))
    inside = (prediction.mean - torch.as_tensor(toy(theta))).abs() < 1.96 * prediction.sd
    assert 0.88 < inside.double().mean() <= 1.0


def test_gradients_against_finite_differences(emulator):
    at = torch.as_tensor(1 + 0.6 * points(3, 6))

    def values(theta):
        prediction = emulator.predict(theta)
        log_sd = prediction.sd.log()
        return torch.cat([prediction.mean / emulator.output_sd, log_sd], dim=-1)

    theta = at.clone().requires_grad_(True)
    gradients = [torch.autograd.grad(v.sum(), theta, retain_graph=True)[0] for v in values(theta).T]
    # Steps large enough for a variance that is what is left of 1 minus a sum of squares.
    for i, step in enumerate(1e-3 * torch.eye(10, dtype=torch.float64)):
        with torch.no_grad():
            numeric = (values(at + step) - values(at - step)) / 2e-3
        analytic = torch.stack([gradient[:, i] for gradient in gradients], dim=1)
        torch.testing.assert_close(analytic, numeric, rtol=1e-3, atol=1e-4)


def test_jacobian_is_that_of_autograd(emulator):
    theta = torch.as_tensor(points(4, 7)).reshape(2, 2, 10)
    own, expected = emulator.jacobian(theta), emulators.Emulator.jacobian(emulator, theta)
    for a, b in zip(own, expected, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-8, atol=1e-10)


def test_file_brings_it_back(emulator, tmp_path):
    emulator.save(tmp_path / "emulator.pt")
    loaded = emulators.load(tmp_path / "emulator.pt")
    theta = torch.as_tensor(points(5, 8))
    a, b = emulator.predict(theta), loaded.predict(theta)
    assert torch.equal(a.mean, b.mean) and torch.equal(a.covariance, b.covariance)
    assert loaded.outputs == NAMES and loaded.info == emulator.info


def test_some_outputs_alone(emulator):
    names = ("radial_02", "volume_ml")
    theta = torch.as_tensor(points(5, 9))
    whole, part = emulator.predict(theta), emulator.select(names).predict(theta)
    index = [NAMES.index(name) for name in names]
    torch.testing.assert_close(part.mean, whole.mean[:, index])
    torch.testing.assert_close(part.covariance, whole.covariance[:, index][:, :, index])
    with pytest.raises(InputError, match="radial_17"):
        emulator.select(["radial_17"])


def test_same_seed_same_emulator(emulator):
    theta = points(150, 1)
    again = emulators.create(emulator.name)
    again.fit(theta, toy(theta), outputs=NAMES, seed=3, **BOX)
    at = torch.as_tensor(points(5, 10))
    assert torch.equal(again.predict(at).mean, emulator.predict(at).mean)


@pytest.mark.parametrize("name", sorted(emulators.REGISTRY))
def test_refuses_what_it_cannot_learn_from(name):
    theta = points(30, 11)
    y = toy(theta)
    with pytest.raises(InputError, match="too few"):
        emulators.create(name).fit(theta[:8], y[:8], outputs=NAMES, **BOX)
    y[4, 2] = np.nan
    with pytest.raises(InputError, match="row 4"):
        emulators.create(name).fit(theta, y, outputs=NAMES, **BOX)
    y[:, 2] = 1.0
    with pytest.raises(InputError, match="radial_01"):
        emulators.create(name).fit(theta, y, outputs=NAMES, **BOX)


def test_unknown_names():
    with pytest.raises(InputError, match="exact_gp"):
        emulators.create("exact_pg")
    with pytest.raises(InputError, match="matern52"):
        emulators.create("exact_gp", {"kernel": "matern"})
    with pytest.raises(InputError, match="identity"):
        emulators.create("exact_gp", {"input_transform": "sqrt"})


# -------------------------------------------------------------------------------- exact GP


@pytest.mark.parametrize("kernel", KERNELS)
def test_marginal_likelihood_gradient(kernel):
    theta = points(40, 12)
    gp = ExactGP(kernel=kernel)
    x, y = torch.as_tensor(np.log(theta)), torch.as_tensor(toy(theta))
    y = (y - y.mean(0)) / y.std(0)
    p = np.concatenate([np.linspace(0.5, 1.5, 10), [0.3, -8.0]])
    gradient = gp._negative_log_likelihood(p, x, y)[1]
    numeric = [
        gp._negative_log_likelihood(p + step, x, y)[0]
        - gp._negative_log_likelihood(p - step, x, y)[0]
        for step in 1e-5 * np.eye(12)
    ]
    np.testing.assert_allclose(gradient, np.array(numeric) / 2e-5, rtol=1e-3, atol=1e-4)


def test_leave_one_out_against_leaving_one_out():
    x = torch.as_tensor(np.log(points(25, 13)))
    y = torch.as_tensor(toy(np.exp(x.numpy())))
    matrix = KERNELS["rq"](_squared_distance(x / 3, x / 3), 1.0)[0]
    matrix = matrix + 1e-4 * torch.eye(25, dtype=x.dtype)
    errors, variances = leave_one_out(torch.linalg.cholesky(matrix), y)
    for i in (0, 7, 24):
        rest = torch.arange(25) != i
        inverse = torch.linalg.inv(matrix[rest][:, rest])
        k, ones = matrix[i, rest], torch.ones(24, dtype=x.dtype)
        mean = ones @ inverse @ y[rest] / (ones @ inverse @ ones)
        predicted = mean + k @ inverse @ (y[rest] - mean)
        lack = 1 - ones @ inverse @ k
        variance = matrix[i, i] - k @ inverse @ k + lack**2 / (ones @ inverse @ ones)
        torch.testing.assert_close(errors[i], y[i] - predicted, rtol=1e-6, atol=1e-8)
        torch.testing.assert_close(variances[i], variance, rtol=1e-6, atol=1e-9)


def test_calibration_widens_what_is_too_narrow():
    theta = points(120, 14)
    fits = {
        kind: ExactGP(calibration=kind).fit(theta, toy(theta), outputs=NAMES, **BOX)
        for kind in ("none", "variance_factor")
    }
    factor = fits["variance_factor"].info["variance_factor"]
    assert factor >= 1
    at = torch.as_tensor(points(3, 15))
    narrow, wide = (fits[kind].predict(at).covariance for kind in ("none", "variance_factor"))
    torch.testing.assert_close(wide, factor * narrow)


def test_shrinkage_only_where_rows_are_few():
    rng = np.random.default_rng(16)
    mixing = rng.normal(size=(30, 30)) @ np.diag(np.logspace(0, -4, 30))
    few, many = (torch.as_tensor(rng.normal(size=(n, 30)) @ mixing) for n in (20, 3000))
    assert choose_shrinkage(few) > choose_shrinkage(many)


def test_fewer_rows_than_outputs():
    theta = points(32, 17)
    y = np.concatenate([toy(theta) + 0.01 * k * theta[:, [k % 10]] for k in range(11)], axis=1)
    emulator = ExactGP(iterations=20).fit(theta, y[:, :52], **BOX)
    covariance = emulator.predict(torch.as_tensor(points(2, 18))).covariance
    assert torch.linalg.cholesky_ex(covariance)[1].sum() == 0


def test_workflow_functions(tmp_path):
    def table(n, seed):
        theta = points(n, seed)
        y = np.concatenate([toy(theta) + 0.01 * k * theta[:, [k % 10]] for k in range(11)], axis=1)
        frame = pd.DataFrame(theta, columns=list(aha.PARAMETERS))
        frame.insert(0, "sample", range(n))
        outputs = pd.DataFrame(y[:, :52], columns=list(aha.OUTPUTS))
        path = tmp_path / f"{n}.parquet"
        pd.concat([frame, outputs], axis=1).to_parquet(path)
        return path

    files = [tmp_path / name for name in ("e.pt", "fit.json", "predictions.parquet", "errors.csv")]
    emulators.train_emulator("exact_gp", {}, table(100, 19), 0.1, 5.0, 1, *files[:2])
    emulators.predict_test_set(files[0], table(8, 20), *files[2:])
    assert json.loads(files[1].read_text())["rows"] == 100
    assert len(pd.read_parquet(files[2])) == 8 * 52
    assert pd.read_csv(files[3])["output"].tolist() == [*aha.OUTPUTS, "all"]
    pd.read_parquet(tmp_path / "8.parquet").drop(columns="radial_03").to_parquet(files[2])
    with pytest.raises(InputError, match="radial_03"):
        emulators.predict_test_set(files[0], files[2], files[2], files[3])
