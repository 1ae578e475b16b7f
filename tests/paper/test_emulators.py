"""What the paper's emulators have of their own; what all share is in `tests/unit`."""

import numpy as np
import pytest
import torch
from scipy.special import expit

from regional_lv import emulators
from regional_lv.emulators.shared_kernel import OFFERED
from regional_lv.errors import InputError
from regional_lv.paper.emulators.networks import build
from tests.unit.test_emulators import CHANNELS, MIDDLE, PARAMETERS, fit, many_outputs, points, toy


def test_network_without_its_error_has_the_same_mean():
    network = fit("dnn")
    bare, theta = network.without_error(), torch.as_tensor(points(5, 26))
    whole, rest = network.predict(theta), bare.predict(theta)
    torch.testing.assert_close(whole.mean, rest.mean)
    torch.testing.assert_close(network.jacobian(theta)[0], bare.jacobian(theta)[0])
    excess = whole.covariance - rest.covariance
    assert (torch.linalg.eigvalsh(excess) > -1e-9).all() and (excess.diagonal(0, 1, 2) > 0).all()


def test_local_needs_an_observation_and_neighbours():
    emulator = fit("local_mgp")
    with pytest.raises(InputError, match="localise"):
        emulator.predict(MIDDLE)
    with pytest.raises(InputError, match="one number per output"):
        emulator.localise(toy(MIDDLE))
    with pytest.raises(InputError, match="lower local_mgp"):
        fit("local_mgp", neighbours=140)


@pytest.mark.parametrize("kernel", OFFERED)
@pytest.mark.parametrize("name", ["local_gp", "local_mgp", "local_dkgp", "local_dkmgp"])
def test_local_model_is_that_of_gpytorch(name, kernel):
    local = fit(name, kernel=kernel, iterations=5).localise(toy(MIDDLE[0]))
    model, x = local.local, local.standardise(torch.as_tensor(points(6, 32)))
    posterior = model.likelihood(model(x))
    torch.testing.assert_close(model.mean(x).T, posterior.mean, rtol=1e-5, atol=1e-7)
    expected = emulators.base.row_jacobian(model.mean, x)
    torch.testing.assert_close(model.mean_jacobian(x), expected, rtol=1e-7, atol=1e-9)
    variance = model.covariance(x)
    if model.joint:
        variance = variance.diagonal(dim1=-2, dim2=-1)
    # Of constants that have to be estimated: how far the weights of 1 are from predicting 1.
    model.set_train_data(targets=torch.ones_like(model.train_targets))
    lack = 1 - (model.initialize(**{"mean_module.constant": 0.0})(x)).mean
    signal = model.b.diagonal() if model.joint else model.b[:, 0, 0]
    expected = signal[:, None] * (posterior.variance + lack.square() / model.total)
    torch.testing.assert_close(variance.T, expected, rtol=1e-5, atol=1e-9)


def test_local_fit_is_in_the_file(tmp_path):
    for name in ("local_gp", "local_dkmgp"):
        local = fit(name, kernel="rq", iterations=5).localise(toy(MIDDLE[0]))
        local.save(tmp_path / "local.pt")
        a, b = local.predict(MIDDLE), emulators.load(tmp_path / "local.pt").predict(MIDDLE)
        assert torch.equal(a.mean, b.mean) and torch.equal(a.covariance, b.covariance)


def test_few_latent_processes_start_with_the_volume_among_them():
    """It is the last of the scores, and not the least."""
    theta = points(60, 40)
    y = many_outputs(theta)
    emulator = emulators.create("mvgp", {"latents": 3, "inducing": 30, "iterations": 1})
    emulator.fit(theta, y, seed=3, parameters=PARAMETERS, outputs=CHANNELS.names)
    assert emulator.info["scores"] > 3
    assert emulator.model.mixing[-1].abs().max() > 0.3
    at = torch.as_tensor(points(20, 41))
    error = emulator.predict_mean(at)[:, 0] - torch.as_tensor(many_outputs(at.numpy()))[:, 0]
    assert (error / emulator.output_sd[0]).square().mean() < 0.2


def test_sparse_processes_have_the_zones_of_a_zonal_kernel():
    deep = fit("dgp", kernel="zonal_rq", iterations=2, deep_iterations=2).model
    for layer in (deep.hidden, deep.scores):
        assert layer.covar_module.base_kernel.blocks == PARAMETERS.blocks


@pytest.mark.parametrize("name", ["local_gp", "local_dkmgp"])
def test_local_processes_have_the_zones_of_a_zonal_kernel(name):
    emulator = fit(name, kernel="zonal_rq", iterations=2)
    local = emulator.localise(toy(points(1, 7))[0])
    assert local.local.covar_module.blocks == PARAMETERS.blocks
    assert torch.isfinite(local.predict(torch.as_tensor(points(3, 8))).covariance).all()


def test_initial_network_passes_variances_on():
    """All of it through the first layer, and of q before a SiLU twice the second moment after it:
    the limit of wide layers, by quadrature."""
    sizes = [400, 3000, 1000, 2000]
    x = torch.randn(500, sizes[0], generator=torch.Generator().manual_seed(1))
    nodes, weights = np.polynomial.hermite_e.hermegauss(60)
    expected = 1.0
    for depth in (1, 2, 3):
        network = build(sizes[: depth + 1], 2).requires_grad_(False)
        # Widths of a thousand leave 2 % by chance.
        assert float(network(x).square().mean()) == pytest.approx(expected, rel=0.05)
        assert (network(torch.zeros(1, sizes[0])) == 0).all()
        z = np.sqrt(expected) * nodes
        expected = 2 * np.average((z * expit(z)) ** 2, weights=weights)
