"""The contract of every registered emulator, and what only some of them have."""

import functools
import json
import logging
from typing import ClassVar

import botorch.fit
import gpytorch
import numpy as np
import pandas as pd
import pytest
import torch
from botorch.models import SingleTaskGP
from gpytorch.mlls import ExactMarginalLogLikelihood

from regional_lv import emulators
from regional_lv.channels import Channels
from regional_lv.config.sections.emulators import Emulators
from regional_lv.emulators import exact_gp, optimise
from regional_lv.emulators.base import Architecture, Emulator, TrainingSet
from regional_lv.emulators.exact_gp import ExactGP, leave_one_out, shrinkage_of
from regional_lv.emulators.kernels import ZONAL, make_kernel, weighted_slopes
from regional_lv.emulators.recalibration import (
    Calibration,
    fit_freedom,
    fit_trend,
    interval_factor,
)
from regional_lv.emulators.reduced import ReducedEmulator
from regional_lv.emulators.shared_kernel import (
    OFFERED,
    SharedKernelGP,
    cholesky,
    choose_kernel,
    projected_precision,
)
from regional_lv.emulators.training import predict_test_set, train_emulator
from regional_lv.errors import InputError
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.mechanics.derivative_kernel import joint_covariance
from regional_lv.registry import temporary
from regional_lv.testing.emulators import (
    MIDDLE,
    NAMES,
    PARAMETERS,
    ROWS,
    TOY,
    EmulatorContract,
    points,
    toy,
    toy_slopes,
)

CHANNELS = Channels.of()
SMALL = {
    **{"neighbours": 60, "inducing": 60, "epochs": 150, "hidden": [32], "iterations": 40},
    **{"hyperparameter_rows": 75, "max_observations": 1200, "nugget": 3e-6},
}
"""Settings for a small training set, where an emulator has them. The toy is so smooth that with a
smaller nugget the differences of predictions are those of rounding."""


def many_outputs(theta: np.ndarray) -> np.ndarray:
    """All 52 outputs (N, 52), made from the toy's five."""
    columns = [toy(theta).numpy() + 0.01 * k * theta[:, [k % 10]] for k in range(11)]
    return np.concatenate(columns, axis=1)[:, :52]


def create(name: str, **settings):
    """A small emulator of this name."""
    offered = Emulators.model_fields[name].annotation.model_fields
    return emulators.create(name, {k: v for k, v in SMALL.items() if k in offered} | settings)


def fit(name: str, theta=None, y=None, **settings):
    """A small emulator of this name, fitted to the toy."""
    theta = points(ROWS, 1) if theta is None else theta
    y = toy(theta) if y is None else y
    return create(name, **settings).fit(theta, y, toy_slopes(theta), seed=3, **TOY)


REGISTERED = sorted(emulators.REGISTRY)
DEEP = pytest.mark.test_all("local_gp and local_dkmgp go through the same code")
SLOW = pytest.mark.test_all("trained at every point or in two layers; inputs are the base class's")


def each(mark, *names: str) -> list:
    """All names, some of them marked."""
    return [pytest.param(name, marks=mark if name in names else []) for name in REGISTERED]


LOCAL = [name for name in REGISTERED if name.startswith("local")]


class TestRegistered(EmulatorContract):
    @pytest.fixture(scope="class", params=each(DEEP, "local_mgp", "local_dkgp"))
    @classmethod
    def create(cls, request):
        return functools.partial(create, request.param)

    @pytest.mark.parametrize("create", each(SLOW, "dgp", *LOCAL), indirect=True)
    def test_identity_inputs(self, create):
        super().test_identity_inputs(create)

    @pytest.mark.parametrize("create", REGISTERED, indirect=True)
    def test_refuses_what_it_cannot_learn_from(self, create):
        super().test_refuses_what_it_cannot_learn_from(create)

    def test_local_ones_are_called_so(self, fitted):
        scope = emulators.architecture_of(fitted.name).training_scope
        assert (scope == "local") == fitted.name.startswith("local")

    def test_local_for_some_outputs(self, fitted):
        """Neighbours are sought by the outputs that there are; those that are left predict the same
        as beside the others."""
        names = ("radial_02", "volume_ml", "radial_01")
        index = [NAMES.index(name) for name in names]
        observed, whole = toy(MIDDLE[0])[index], fitted
        part = fitted.select(names).localise(observed)
        if emulators.architecture_of(fitted.name).training_scope == "local":
            y = toy(points(ROWS, 1))[:, index]
            distance = ((y - observed) / y.std(0)).square().sum(1)
            nearest = distance.argsort()[: SMALL["neighbours"]].sort().values
            assert part.rows.tolist() == nearest.tolist()
            whole = fitted._train(nearest)
        own, expected = part.predict(MIDDLE), whole.predict(MIDDLE)
        torch.testing.assert_close(own.mean, expected.mean[:, index])
        torch.testing.assert_close(own.covariance, expected.covariance[:, index][:, :, index])


def test_registry_and_configuration_name_the_same():
    compared = [name for name in emulators.REGISTRY if name != emulators.OF_INPUTS]
    assert compared == Emulators().names
    assert set(emulators.REGISTRY) == set(Emulators.model_fields) - {"names", "shortlist", "final"}


def test_unknown_names():
    with pytest.raises(InputError, match="exact_gp"):
        emulators.create("exact_pg")
    with pytest.raises(InputError, match="matern52"):
        emulators.create("exact_gp", {"kernel": "matern"})
    with pytest.raises(InputError, match="identity"):
        emulators.create("exact_gp", {"input_transform": "sqrt"})
    with pytest.raises(InputError, match="neighbors"):
        emulators.create("local_gp", {"neighbors": 50})


# ------------------------------------------------------------------- sensitivities, locality


def test_sensitivities_teach():
    theta, at = points(40, 26), points(100, 27)
    errors = {}
    for name in ("exact_gp", "gradient_gp"):
        emulator = fit(name, theta)
        mean = emulator.predict(torch.as_tensor(at)).mean
        errors[name] = ((mean - toy(at)) / emulator.output_sd).square().mean().sqrt()
    assert errors["gradient_gp"] < 0.5 * errors["exact_gp"]


def test_some_of_the_derivatives_only():
    """Values of all, and as many derivatives as fit, which is not the same number of each;
    leaving out against really leaving out."""
    theta = points(30, 28)
    emulator = fit("gradient_gp", theta, max_observations=130, hyperparameter_rows=15)
    assert emulator.info["derivatives"] == 100
    counts = torch.bincount(emulator.seen.at, minlength=30)
    assert sorted(counts.unique().tolist()) == [3, 4]
    # Stiff matrices would hide what is compared here.
    emulator.nugget = 1e-3
    y, slopes = toy(theta).numpy(), toy_slopes(theta)
    targets = torch.as_tensor((y - emulator.output_mean.numpy()) / emulator.output_sd.numpy())
    by_x = torch.as_tensor(slopes) / emulator.output_sd[:, None]
    by_x = by_x / emulator.standardise_slope(torch.as_tensor(theta))[:, None, :]
    stacked = emulator._targets(TrainingSet(emulator.inputs, targets, by_x))
    matrix, constant = emulator._training_covariance()
    assert torch.allclose(matrix, matrix.T, atol=1e-12)
    matrix = matrix + emulator.nugget * torch.eye(130, dtype=matrix.dtype)
    precision = projected_precision(torch.linalg.cholesky(matrix), constant)
    errors, variances = emulator._leave_one_out(precision, stacked)
    for i in (int(counts.argmax()), int(counts.argmin())):
        gone = [i, *(30 + (emulator.seen.at == i).nonzero()[:, 0]).tolist()]
        rest = [j for j in range(130) if j not in gone]
        k, c = matrix[i, rest], constant[rest]
        inverse = torch.linalg.inv(matrix[rest][:, rest])
        mean = (c.T @ inverse @ stacked[rest]) / (c.T @ inverse @ c)
        predicted = mean[0] + k @ inverse @ (stacked[rest] - c * mean)
        lack = 1 - k @ inverse @ c[:, 0]
        variance = matrix[i, i] - k @ inverse @ k + lack**2 / (c.T @ inverse @ c)[0, 0]
        torch.testing.assert_close(errors[i], stacked[i] - predicted, rtol=1e-4, atol=1e-7)
        torch.testing.assert_close(variances[i], variance, rtol=1e-4, atol=1e-9)


def test_sensitivities_that_cannot_be_used():
    theta = points(30, 29)
    slopes = toy_slopes(theta)
    with pytest.raises(InputError, match="there are none"):
        create("gradient_gp").fit(theta, toy(theta), **TOY)
    with pytest.raises(InputError, match=r"expected \(30, 5, 10\)"):
        create("gradient_gp").fit(theta, toy(theta), slopes[:, :4], **TOY)
    slopes[7, 0, 0] = np.inf
    with pytest.raises(InputError, match="row 7"):
        create("gradient_gp").fit(theta, toy(theta), slopes, **TOY)


def test_what_reduction_leaves_out_is_uncertain():
    """With fewer components the means get worse, and the variances larger by as much."""
    theta = points(60, 30)
    y = many_outputs(theta)
    at = points(15, 31)
    for share in (0.9, 0.999):
        emulator = create("local_mgp", neighbours=40, kernel="rq", explained_variance=share)
        emulator.fit(theta, y, parameters=PARAMETERS, outputs=CHANNELS.names)
        truth = torch.as_tensor(many_outputs(at))
        scaled = []
        for t, row in zip(torch.as_tensor(at), truth, strict=True):
            prediction = emulator.localise(row).predict(t)
            scaled.append(((prediction.mean - row) / prediction.sd).square().mean())
        assert 0.2 < torch.stack(scaled).mean() < 3.0


# ------------------------------------------------------------------------- kernels, optimiser


def some_kernel(name):
    """Of four inputs, two in each zone."""
    kernel = make_kernel(name, 4, [slice(0, 2), slice(2, 4)])
    scales = torch.tensor([[0.7, 1.3, 2.0, 0.9]], dtype=torch.float64)
    return kernel.initialize(lengthscale=scales).requires_grad_(False)


@pytest.mark.parametrize("name", [*OFFERED, ZONAL])
def test_slopes_of_kernels(name):
    rng = np.random.default_rng(24)
    a, b, weights = (torch.as_tensor(rng.normal(size=s)) for s in ((3, 4), (6, 4), (6, 2)))
    kernel = some_kernel(name)

    def value(at):
        return (kernel(at[None], b).to_dense() @ weights)[0]

    expected = torch.stack([torch.autograd.functional.jacobian(value, row) for row in a])
    values, slopes = weighted_slopes(kernel, a, b, weights)
    torch.testing.assert_close(slopes, expected)
    torch.testing.assert_close(values, torch.stack([value(row) for row in a]))
    # At zero distance the square root in the Matern kernel must not spoil the derivative.
    here = a.clone().requires_grad_(True)
    kernel(here, a).to_dense().sum().backward()
    assert torch.isfinite(here.grad).all()


@pytest.mark.parametrize("name", ["rq", "zonal_rq"])
def test_rational_quadratic_kernels_are_products_of_gpytorchs(name):
    rng = np.random.default_rng(28)
    a, b = (torch.as_tensor(rng.normal(size=(n, 4))) for n in (3, 6))
    ours = some_kernel(name)
    ours.alpha = 1.7
    parts = [(0, 1), (2, 3)] if name == "zonal_rq" else [(0, 1, 2, 3)]
    theirs = [
        gpytorch.kernels.RQKernel(ard_num_dims=len(dims), active_dims=dims).double()
        for dims in parts
    ]
    for kernel, dims in zip(theirs, parts, strict=True):
        kernel.initialize(lengthscale=ours.lengthscale[:, list(dims)], alpha=ours.alpha)
    expected = gpytorch.kernels.ProductKernel(*theirs)(a, b).to_dense()
    torch.testing.assert_close(ours(a, b).to_dense(), expected)
    assert (ours(a, diag=True) == 1).all()


def test_kernel_is_chosen_by_its_error():
    x = torch.as_tensor(np.random.default_rng(25).uniform(-2, 2, size=(80, 2)))
    smooth = torch.stack([torch.sin(2 * x[:, 0]), torch.cos(x.sum(1))], dim=1)
    rough = torch.stack([x[:, 0].abs(), (x[:, 1] - 0.3).abs()], dim=1)
    assert choose_kernel(x, smooth, 1e-8, 1)[0] != "matern52"
    name, errors = choose_kernel(x, rough, 1e-8, 1)
    assert name == "matern52" and set(errors) == set(OFFERED)


def test_jitter_is_said(caplog):
    matrix = torch.ones(3, 3, dtype=torch.float64)
    matrix[0, 0] -= 1e-6
    with caplog.at_level(logging.WARNING):
        _, nugget = cholesky(matrix, 1e-9, "somebody")
    assert nugget > 1e-9 and "somebody: nugget raised" in caplog.text


def test_optimiser_finds_a_minimum_within_bounds():
    free, bound = (torch.nn.Parameter(torch.zeros(2, dtype=torch.float64)) for _ in range(2))

    def loss():
        return (free - 1).square().sum() + (bound - 5).square().sum()

    value = optimise.fit([("a.free", free), ("a.bound", bound)], loss, {"bound": (0, 3)}, 50)
    torch.testing.assert_close(free.data, torch.ones(2, dtype=torch.float64))
    assert bound.tolist() == [3, 3] and value == pytest.approx(8)


def test_optimiser_steps_back_from_where_there_is_no_cholesky_factor():
    x = torch.nn.Parameter(torch.full((1,), 2.0, dtype=torch.float64))

    def loss():
        return torch.linalg.cholesky(x[:, None] - 1).sum() - 0.1 * x.sum().log()

    optimise.fit([("x", x)], loss, {}, 50)
    assert 1 < x.item() < 2


def test_optimiser_says_if_there_is_nowhere_to_start(caplog):
    x = torch.nn.Parameter(torch.zeros(1, dtype=torch.float64))
    assert optimise.fit([("x", x)], lambda: x.log().sum(), {}, 50) == optimise.TOO_FAR
    assert x.item() == 0 and "cannot be evaluated where its parameters start" in caplog.text


@pytest.mark.parametrize(
    "blocks", [[slice(0, 4)], [slice(0, 2), slice(2, 4)], [slice(0, 1), slice(1, 4)]]
)
def test_joint_covariance_holds_the_derivatives(blocks):
    """Of the kernel written out, by automatic differentiation."""
    rng = np.random.default_rng(26)
    x, y = (torch.as_tensor(rng.normal(size=(n, 4))) for n in (2, 3))
    scales, alpha = torch.as_tensor(rng.uniform(0.5, 2.0, 4)), torch.tensor(0.7).double()

    def value(a, b):
        squared = ((a - b) / scales) ** 2
        parts = [1 + squared[part].sum() / (2 * alpha) for part in blocks]
        return torch.stack(parts).prod() ** -alpha

    given = (each.numpy() for each in (x, y, scales))
    found = torch.as_tensor(joint_covariance(*given, 0.7, blocks))
    for i, a in enumerate(x):
        for j, b in enumerate(y):
            grads = torch.autograd.functional.jacobian(value, (a, b))
            second = torch.autograd.functional.hessian(value, (a, b))[0][1]
            expected = torch.zeros(5, 5, dtype=x.dtype)
            expected[0, 0] = value(a, b)
            expected[1:, 0], expected[0, 1:] = grads
            expected[1:, 1:] = second
            torch.testing.assert_close(found[i :: len(x), j :: len(y)], expected)


# -------------------------------------------------------------------------------- exact GP


@pytest.mark.parametrize("rows", [40, 4])
def test_restricted_likelihood_with_its_best_output_covariance(rows):
    """Against the formula written out, and B against others, of which none is more likely."""
    theta = points(rows, 12)
    x, y = torch.as_tensor(np.log(theta)), toy(theta)
    y = (y - y.mean(0)) / y.std(0)
    model = SharedKernelGP("rq", 10, 1e-3, None, x, y)
    model.start_at(np.concatenate([np.linspace(0.5, 1.5, 10), [0.3, -8.0]]))
    k = model.covar_module(x).to_dense().detach().numpy()
    k = k + (1e-3 + np.exp(-8.0)) * np.eye(rows)
    inverse, ones = np.linalg.inv(k), np.ones(rows)
    q = inverse - np.outer(inverse @ ones, inverse @ ones) / (ones @ inverse @ ones)
    b = y.numpy().T @ q @ y.numpy() / (rows - 1)
    if rows <= 5:
        b = np.diag(np.diag(b))

    def minus_log_likelihood(of_outputs):
        fit = np.trace(np.linalg.solve(of_outputs, y.numpy().T @ q @ y.numpy()))
        common = np.linalg.slogdet(k)[1] + np.log(ones @ inverse @ ones)
        return 0.5 * (fit + (rows - 1) * np.linalg.slogdet(of_outputs)[1] + 5 * common)

    constant = 0.5 * 5 * (rows - 1)
    found = model.loss().item()
    assert found == pytest.approx(minus_log_likelihood(b) - constant, rel=1e-5)
    for scale in (0.9, 1.1):
        assert minus_log_likelihood(scale * b) > minus_log_likelihood(b)


def test_leave_one_out_against_leaving_one_out():
    x = torch.as_tensor(np.log(points(25, 13)))
    y = toy(np.exp(x.numpy()))
    kernel = make_kernel("rq", 10).requires_grad_(False)
    kernel.lengthscale = 3.0
    matrix = kernel(x).to_dense()
    matrix = matrix + 1e-4 * torch.eye(25, dtype=x.dtype)
    ones = torch.ones(25, 1, dtype=x.dtype)
    precision = projected_precision(torch.linalg.cholesky(matrix), ones)
    errors, variances = leave_one_out(precision, y)
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


def test_calibration_is_of_the_errors_that_move_estimates():
    """Those along the Jacobians have 2.25 times their predicted variance. The others, which no
    theta explains, have nine times theirs."""
    rng = np.random.default_rng(14)
    slopes = rng.normal(size=(3000, 8, 3)) * [0.1, 1.0, 10.0]
    basis, white = np.linalg.qr(slopes)[0], rng.normal(size=(3000, 8, 1))
    along = basis @ (basis.swapaxes(1, 2) @ white)
    errors = 1.5 * along + 3.0 * (white - along)
    known = [torch.as_tensor(a) for a in (errors[..., 0], slopes, np.zeros(3000))]
    assert Calibration.fit("variance_factor", *known).factor == pytest.approx(2.25, rel=0.05)
    assert Calibration.fit("none", *known) == Calibration()


def test_intervals_of_outputs_hold_heavy_tailed_errors():
    """Errors of a simulation are large or small together, and the larger the softer a heart is."""
    rng = np.random.default_rng(15)
    stiffness = rng.normal(0.4, 0.5, (2, 3000))
    size = np.exp(0.3 - stiffness) / rng.chisquare(4.0, (2, 3000))
    errors = torch.as_tensor(rng.normal(size=(2, 3000, 6)) * np.sqrt(size)[..., None])
    known, other = torch.as_tensor(stiffness)
    found = Calibration.fit("intervals", errors[0], torch.zeros(3000, 6, 1).double(), known)
    sd = (found.factor * found.scale(other)).sqrt()[:, None]
    assert (errors[1].abs() < 1.96 * sd).double().mean() == pytest.approx(0.95, abs=0.01)
    soft = other < other.quantile(0.3)
    assert (errors[1].abs() < 1.96 * sd)[soft].double().mean() == pytest.approx(0.95, abs=0.015)


def test_trend_of_the_variance_is_found():
    rng = np.random.default_rng(21)
    x = torch.as_tensor(rng.normal(0.4, 0.5, 4000))
    squares = torch.as_tensor(rng.normal(size=(4000, 6)) ** 2).mean(1)
    level, power = fit_trend(torch.exp(0.7 - 1.3 * x) * squares, x)
    assert level == pytest.approx(0.7, abs=0.05) and power == pytest.approx(-1.3, abs=0.06)
    level, power = fit_trend(squares[:4], x[:4])
    assert abs(power) < 1.5  # four simulations say nothing


def test_size_of_the_errors_is_found_to_be_common():
    rng = np.random.default_rng(25)
    size = 8.0 / rng.chisquare(8.0, 6000)
    along, across = (torch.as_tensor(size * rng.chisquare(k, 6000)) for k in (10, 42))
    assert fit_freedom(along, across, 10, 42) == pytest.approx(8.0, rel=0.15)
    # With sizes of their own the ones tell nothing of the others.
    shuffled = torch.as_tensor(rng.permutation(along.numpy()))
    assert fit_freedom(shuffled, across, 10, 42) > 40


@pytest.mark.parametrize("freedom", [4.0, np.inf])
def test_intervals_hold_the_share_that_they_state(freedom):
    """One parameter and five outputs, on a grid; its estimates move further than predicted."""
    rng = np.random.default_rng(26)
    size = freedom / rng.chisquare(freedom, 4000) if np.isfinite(freedom) else np.ones(4000)
    moved = 1.4 * rng.normal(size=4000) * np.sqrt(size)
    across = size * rng.chisquare(4, 4000)
    factor = interval_factor(torch.as_tensor(moved)[:, None], torch.as_tensor(across), freedom, 5)
    shift = np.linspace(-60, 60, 6001)
    square = across[:, None] + shift**2 / factor
    if np.isfinite(freedom):
        density = (1 + square / freedom) ** (-(freedom + 5) / 2)
    else:
        density = np.exp(-0.5 * (square - across[:, None]))
    below = density.cumsum(1) / density.sum(1, keepdims=True)
    at = below[np.arange(4000), np.searchsorted(shift, moved)]
    assert factor > 1.2
    assert (abs(at - 0.5) < 0.475).mean() == pytest.approx(0.95, abs=0.005)


def test_intervals_that_are_wide_enough_stay():
    moved, across = 0.5 * torch.ones(50, 3), torch.ones(50)
    assert interval_factor(moved, across, 5.0, 8) == interval_factor(moved, across, np.inf, 8) == 1


def test_errors_that_grow_where_hearts_are_soft_are_foreseen():
    """Outputs with a rough part that is the larger the softer the heart is."""

    def rough(theta):
        size = np.exp(-2 * np.log(theta).mean(1, keepdims=True))
        return toy(theta).numpy() + 0.1 * sd * size * np.sin(7 * np.log(theta) @ mixing)

    mixing, sd = np.random.default_rng(22).normal(size=(10, 5)), toy(points(500, 1)).std(0).numpy()
    theta, at = points(150, 23), points(400, 24)
    truth, size = torch.as_tensor(rough(at)), torch.as_tensor(at).log().mean(1)
    powers = {}
    for kind in ("variance_factor", "variance_trend"):
        emulator = ExactGP(calibration=kind).fit(theta, rough(theta), **TOY)
        with torch.no_grad():
            prediction = emulator.predict(torch.as_tensor(at))
        covariance = torch.linalg.cholesky(prediction.covariance)
        error = torch.linalg.solve_triangular(
            covariance, (truth - prediction.mean)[..., None], upper=False
        )
        distance = error.square().mean((1, 2))
        _, powers[kind] = fit_trend(distance, size)
    assert powers["variance_factor"] < -0.8
    assert abs(powers["variance_trend"]) < 0.4 * abs(powers["variance_factor"])


def test_shrinkage_only_where_rows_are_few():
    rng = np.random.default_rng(16)
    mixing = rng.normal(size=(30, 30)) @ np.diag(np.logspace(0, -4, 30))
    few, many = (torch.as_tensor(rng.normal(size=(n, 30)) @ mixing) for n in (20, 3000))
    assert 0.1 < shrinkage_of(few) < 1
    assert shrinkage_of(few) > 5 * shrinkage_of(many)


@pytest.mark.parametrize("rows", [32, 52])
def test_no_more_rows_than_outputs(rows):
    """Of 52 multiples of one function. Each has the likelihood and the variance that it has by
    itself; correlations, which are 1 or -1, lose the tenth that is the least."""
    theta, multiples = points(rows, 17), np.arange(1.0, 53.0) * np.resize([1, 1, -1], 52)
    y = toy(theta).numpy()[:, 2:3] * multiples
    # A nugget with which the inverse below has all the digits that are compared.
    emulator = ExactGP(iterations=20, nugget=1e-4)
    emulator.fit(theta, y, parameters=PARAMETERS, outputs=CHANNELS.names)
    matrix = emulator._training_covariance()[0] + emulator.nugget * torch.eye(rows).double()
    inverse = torch.linalg.inv(matrix)
    z = torch.as_tensor(y[:, 0] / y[:, 0].std(ddof=1))
    z = z - (inverse @ z).sum() / inverse.sum()
    variance = z @ inverse @ z / (rows - 1)
    loss = (rows - 1) * variance.log() + torch.logdet(matrix) + inverse.sum().log()
    assert emulator.info["log_marginal_likelihood"] == pytest.approx(-52 * float(loss) / 2)
    correlation = 0.9 * np.outer(np.sign(multiples), np.sign(multiples)) + 0.1 * np.eye(52)
    sd = variance.sqrt() * emulator.output_sd
    found = emulator.predict(torch.as_tensor(points(2, 18))).output_covariance
    torch.testing.assert_close(found / sd / sd[:, None], torch.as_tensor(correlation))


def table(path, n: int, seed: int):
    """A screened table of simulations with its sensitivities."""
    theta = points(n, seed)
    slopes = torch.func.vmap(torch.func.jacrev(toy))(torch.as_tensor(theta)).numpy()
    slopes = np.tile(slopes, (1, 11, 1))
    for k in range(55):
        slopes[:, k, (k // 5) % 10] += 0.01 * (k // 5)
    frame = pd.DataFrame(theta, columns=list(PARAMETERS.names))
    frame.insert(0, "sample", range(n))
    outputs = pd.DataFrame(many_outputs(theta), columns=list(CHANNELS.names))
    frame = pd.concat([frame, outputs], axis=1)
    frame["sensitivity"] = [row[:52].ravel().tolist() for row in slopes]
    frame.to_parquet(path)
    return path


@pytest.mark.parametrize("name", ["exact_gp", "gradient_gp", "local_mgp"])
def test_workflow_functions(name, tmp_path):
    train, test = table(tmp_path / "train.parquet", 60, 19), table(tmp_path / "test", 8, 20)
    files = [tmp_path / f for f in ("e.pt", "fit.json", "predictions.parquet", "errors.csv")]
    settings = create(name).settings | ({"neighbours": 50} if name == "local_mgp" else {})
    train_emulator(name, settings, train, PARAMETERS, CHANNELS, 1, *files[:2])
    predict_test_set(files[0], test, *files[2:])
    assert json.loads(files[1].read_text())["emulator"] == name
    assert len(pd.read_parquet(files[2])) == 8 * 52
    errors = pd.read_csv(files[3])
    assert errors["output"].tolist() == [*CHANNELS.names, "all"]
    assert errors["rmse_standardised"].iloc[-1] < 0.5


def test_tables_that_cannot_be_used(tmp_path):
    whole = pd.read_parquet(table(tmp_path / "train.parquet", 20, 19))
    files = [tmp_path / f for f in ("bad.parquet", "e.pt", "fit.json")]
    columns = PARAMETERS, CHANNELS
    whole.drop(columns="radial_03").to_parquet(files[0])
    with pytest.raises(InputError, match="radial_03"):
        train_emulator("exact_gp", {}, files[0], *columns, 1, *files[1:])
    whole.drop(columns="sensitivity").to_parquet(files[0])
    with pytest.raises(InputError, match="no column sensitivity"):
        train_emulator("gradient_gp", {}, files[0], *columns, 1, *files[1:])
    whole.at[3, "sensitivity"] = []
    whole.to_parquet(files[0])
    with pytest.raises(InputError, match="row 3 has 0"):
        train_emulator("gradient_gp", {}, files[0], *columns, 1, *files[1:])


@pytest.mark.parametrize("name", ["exact_gp", "gradient_gp"])
def test_sparse_emulator_has_nearly_the_same_mean(name, monkeypatch):
    monkeypatch.setattr(exact_gp, "SPARSE_ROWS", 60)
    emulator, theta = fit(name), torch.as_tensor(points(200, 31))
    sparse = emulator.sparse
    assert sparse is emulator.sparse and len(sparse.inputs) == 60
    with torch.no_grad():
        exact, near = emulator.predict(theta), sparse.predict(theta)
    error = (near.mean - exact.mean) / emulator.output_sd
    assert 0 < error.square().mean().sqrt() < 0.2
    # Its variance is that of knowing less.
    assert (near.variance > exact.variance).all()
    some = ("radial_02", "volume_ml")
    part = emulator.select(some).sparse.predict(theta).mean
    torch.testing.assert_close(part, near.mean[:, [3, 0]])


def test_sparse_emulator_is_itself_where_rows_are_few():
    emulator = fit("exact_gp")
    assert emulator.sparse is emulator


# ------------------------------------------------------------- other parameters, other emulators


ONE_ZONE = StiffnessInputs({"whole": range(1, 18)}, bounds={"C_a": (0.1, 5.0), "C_b": (0.4, 2.5)})
SEGMENTS = StiffnessInputs(
    {f"segment_{s:02d}": (s,) for s in range(1, 18)}, factors=("C_a",), bounds=(0.3, 3.0)
)
LOADS = Channels.parse(["radial_01", "volume_ml@0.5", "torsion_basal-apical", "volume_ml"])


def at_loads(theta):
    """Four smooth outputs of any number of parameters."""
    x = torch.log(torch.as_tensor(theta))
    weights = torch.linspace(1.0, 0.5, x.shape[-1], dtype=x.dtype) / x.shape[-1]
    a, b = x @ weights, x @ weights.flip(0)
    columns = [0.3 * torch.exp(-0.5 * a), 130 - 8 * b, 2.0 + torch.sin(b), 150 - 10 * torch.tanh(a)]
    return torch.stack(columns, dim=-1)


AS_17 = pytest.mark.test_all("what one zone asks of them they are asked by 17")


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        pytest.param(
            name,
            parameters,
            marks=AS_17 if parameters is ONE_ZONE and name not in ("exact_gp", "dnn") else [],
            id=f"{name}-{len(parameters.zones)}",
        )
        for name in ("exact_gp", "gradient_gp", "local_mgp", "mvgp", "dgp", "dnn")
        for parameters in (ONE_ZONE, SEGMENTS)
    ],
)
def test_any_zones_factors_bounds_and_channels(name, parameters, tmp_path):
    rng = np.random.default_rng(33)
    theta, at = rng.uniform(parameters.lower, parameters.upper, (2, 90, len(parameters)))
    slopes = torch.func.vmap(torch.func.jacrev(at_loads))(torch.as_tensor(theta)).numpy()
    few = {"hyperparameter_rows": 40} if name == "gradient_gp" else {}
    emulator = create(name, **few).fit(
        theta, at_loads(theta), slopes, parameters=parameters, outputs=LOADS.names, seed=3
    )
    emulator.save(tmp_path / "e.pt")
    loaded = emulators.load(tmp_path / "e.pt")
    assert loaded.parameters == parameters and loaded.channels == LOADS
    np.testing.assert_array_equal(loaded.lower, parameters.lower)
    np.testing.assert_array_equal(loaded.upper, parameters.upper)
    truth = at_loads(at[:20])
    with torch.no_grad():
        mean = [
            loaded.localise(y).predict(t).mean
            for y, t in zip(truth, torch.as_tensor(at[:20]), strict=True)
        ]
    error = (torch.stack(mean) - truth) / emulator.output_sd
    assert error.square().mean().sqrt() < 0.4
    local = loaded.localise(truth[0])
    own, expected = (
        local.jacobian(torch.as_tensor(at[:2])),
        Emulator.jacobian(local, torch.as_tensor(at[:2])),
    )
    torch.testing.assert_close(own[0], expected[0], rtol=1e-7, atol=1e-9)
    with pytest.raises(InputError, match=f"simulate at least {len(parameters) + 2} "):
        few = theta[: len(parameters) + 1]
        create(name).fit(few, at_loads(few), parameters=parameters, outputs=LOADS.names)


class FromOutside(ExactGP):
    """What a plugin might register: another name, and settings that no section has."""

    name = "from_outside"
    architecture = Architecture("Outside", "GP", "global", "multi-output")
    defaults: ClassVar[dict] = {
        **{"kernel": "rq", "nugget": 1e-6, "iterations": 20, "calibration": "none", "mine": 7}
    }


def test_a_file_of_another_version_is_refused(tmp_path):
    fit("exact_gp").save(tmp_path / "e.pt")
    content = torch.load(tmp_path / "e.pt", weights_only=True)
    torch.save(content | {"format": 1}, tmp_path / "old.pt")
    with pytest.raises(InputError, match=r"old\.pt: another version.*train it again"):
        emulators.load(tmp_path / "old.pt")


def test_a_file_of_another_emulator_is_refused(tmp_path):
    fit("exact_gp").save(tmp_path / "e.pt")
    with pytest.raises(InputError, match=r"e\.pt: holds the emulator exact_gp, not gradient_gp"):
        emulators.REGISTRY["gradient_gp"].load(tmp_path / "e.pt")


@pytest.fixture
def from_outside():
    with temporary():
        yield emulators.REGISTRY.add(FromOutside)


def test_an_emulator_from_outside_says_its_settings_itself(from_outside, tmp_path):
    emulator = emulators.create("from_outside", {"iterations": 5})
    assert emulator.settings == FromOutside.defaults | {"iterations": 5, "input_transform": "log"}
    theta = points(40, 5)
    emulator.fit(theta, toy(theta), **TOY).save(tmp_path / "e.pt")
    assert isinstance(emulators.load(tmp_path / "e.pt"), FromOutside)
    with pytest.raises(InputError, match=r"from_outside\.yours: unknown setting"):
        emulators.create("from_outside", {"yours": 1})


fit_gpytorch_mll = functools.partial(
    botorch.fit.fit_gpytorch_mll, optimizer_kwargs={"options": {"maxiter": 20}}
)
"""With a short search."""


class OffTheShelf(ReducedEmulator):
    """BoTorch's default model of each score, as anybody would take it."""

    name = "off_the_shelf"
    architecture = Architecture("BoTorch", "GP", "global", "single-output")
    defaults: ClassVar[dict] = {"explained_variance": 0.9999}
    _KEYS = ("x", "z")

    def _fit_scores(self, x, z, seed):
        self.x, self.z = x, z
        self.model = SingleTaskGP(x, z)
        fit_gpytorch_mll(ExactMarginalLogLikelihood(self.model.likelihood, self.model))

    def _build(self, weights):
        return SingleTaskGP(self.x, self.z)

    def _mean(self, x):
        return self.model.posterior(x).mean

    def _covariance(self, x):
        return self.model.posterior(x).variance


class TestOffTheShelf(EmulatorContract):
    plugin = OffTheShelf
