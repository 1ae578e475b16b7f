"""The sparse variational GPs: bound and predictions against the library's and the closed form.

The emulators put the optimal q(u) in closed form into their bound, which GPyTorch's variational
models do not offer; the library's bound of the same model says whether what is optimised is right.
"""

import math

import gpytorch
import pytest
import torch
from gpytorch.utils.memoize import clear_cache_hook
from torch.distributions import Categorical, Independent, MixtureSameFamily, Normal

from regional_lv.emulators.kernels import make_kernel
from regional_lv.paper.emulators.dgp import HiddenLayer, TwoLayerGP
from regional_lv.paper.emulators.variational import SparseGP

NOISE = torch.tensor([0.05, 0.1, 0.2], dtype=torch.float64)
SCALES = torch.tensor([0.7, 1.3, 2.0, 0.9], dtype=torch.float64)


def draw(*shape: int, seed: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


X, Z, AT = draw(20, 4, seed=3), draw(20, 3, seed=5), draw(6, 4, seed=8)


def sparse(points: torch.Tensor, latents: int | None = None, kernel: str = "rq") -> SparseGP:
    """A model of three scores with parameters of no symmetry, q(u) not yet set."""
    each = make_kernel(kernel, 4, batch=[latents or 3])
    model = SparseGP(each, points, 3, mixed=latents is not None)
    model.likelihood.task_noises = NOISE
    if latents:
        model.variational_strategy.initialize(lmc_coefficients=draw(latents, 3, seed=6))
    else:
        model.covar_module.outputscale = torch.tensor([0.5, 1.4, 2.0]).double()
    kernel = getattr(model.covar_module, "base_kernel", model.covar_module)
    kernel.lengthscale = SCALES * (0.1 * draw(latents or 3, 1, 4, seed=7)).exp()
    return model


def elbo(model: SparseGP, x: torch.Tensor, z: torch.Tensor) -> float:
    """The library's, of all numbers in `z`."""
    bound = gpytorch.mlls.VariationalELBO(model.likelihood, model, len(x))
    return len(x) * float(bound(model(x), z))


def by_rows(function) -> torch.Tensor:
    """d(function)/dx (M, K, P) of each row of AT, by reverse differentiation of every number."""
    whole = torch.autograd.functional.jacobian(function, AT)
    return torch.stack([whole[i, :, i] for i in range(len(AT))])


@pytest.mark.parametrize("kernel", ["rq", "rbf", "matern52"])
@pytest.mark.parametrize("latents", [None, 2], ids=["independent", "mixed"])
def test_collapsed_bound_is_the_librarys_with_the_optimal_q(latents, kernel):
    model = sparse(draw(7, 4, seed=4), latents, kernel)
    bound = -Z.numel() * model.loss(X, Z).item()
    model.condition(X, Z)
    # GPyTorch adds the jitter once more to mixed processes.
    assert bound == pytest.approx(elbo(model, X, Z), rel=1e-6 if latents else 1e-10)


@pytest.mark.parametrize("latents", [None, 2], ids=["independent", "mixed"])
def test_no_other_q_has_a_higher_bound(latents):
    model = sparse(draw(7, 4, seed=4), latents)
    model.condition(X, Z)
    best, q = elbo(model, X, Z), model.latent._variational_distribution
    for parameter in (q.variational_mean, q.chol_variational_covar):
        kept, step = parameter.clone(), 1e-2 * draw(*parameter.shape, seed=9)
        for sign in (1, -1):
            parameter.copy_(kept + sign * step)
            clear_cache_hook(model.latent)
            assert elbo(model, X, Z) < best
        parameter.copy_(kept)


@pytest.mark.parametrize("latents", [None, 2], ids=["independent", "mixed"])
def test_inducing_points_at_the_data_give_the_exact_posterior(latents):
    """The mean is that of the joint Gaussian of all scores at all points. With q(u) independent
    between processes, each has the variance of a GP seen with precision beta_q."""
    model = sparse(X, latents)
    model.condition(X, Z)
    w, eye = model.mixing.detach(), torch.eye(len(X), dtype=X.dtype)
    within, cross, there = (
        model.covar_module(a, b).to_dense().detach() for a, b in ((X, X), (AT, X), (AT, AT))
    )

    def joint(each):
        """(3 M, 3 N), score by score."""
        return torch.einsum("kq,lq,qmn->kmln", w, w, each).flatten(2).flatten(0, 1)

    noise = torch.diag(NOISE.repeat_interleave(len(X)))
    mean = joint(cross) @ torch.linalg.solve(joint(within) + noise, Z.T.reshape(-1))
    # Conjugate gradients stop at a relative error of 1e-4 in the energy norm.
    atol = 1e-3 if latents else 1e-5
    torch.testing.assert_close(model.score_mean(AT), mean.reshape(3, -1).T, rtol=0, atol=atol)

    beta = (w.square() / NOISE[:, None]).sum(0)[:, None, None]
    known = cross @ torch.linalg.solve(within + eye / beta, cross.mT)
    variance = (there - known).diagonal(0, 1, 2)
    covariance = torch.einsum("kq,lq,qn->nkl", w, w, variance) + torch.diag(NOISE)
    found = model.score_covariance(AT)
    found = found if latents else torch.diag_embed(found)
    torch.testing.assert_close(found, covariance, rtol=0, atol=1e-5)


@pytest.mark.parametrize("latents", [None, 2], ids=["independent", "mixed"])
def test_predictions_are_the_librarys(latents):
    model = sparse(draw(7, 4, seed=4), latents)
    model.condition(X, Z)
    mean, covariance = model.score_mean(AT), model.score_covariance(AT)
    predicted = model.likelihood(model(AT))
    torch.testing.assert_close(mean, predicted.mean)
    variance = covariance.diagonal(0, 1, 2) if latents else covariance
    torch.testing.assert_close(variance, predicted.variance, rtol=1e-6, atol=2e-7)
    torch.testing.assert_close(model.score_slopes(AT), by_rows(model.score_mean))


# ----------------------------------------------------------------------------------- deep GP


def hidden_layer(spread: float) -> HiddenLayer:
    layer = HiddenLayer(make_kernel("rq", 4, batch=[4]), draw(7, 4, seed=4))
    q = layer.variational_strategy._variational_distribution
    with torch.no_grad():
        q.variational_mean.copy_(draw(4, 7, seed=11))
        q._variational_stddev = torch.full((4, 7), spread, dtype=torch.float64)
    layer.covar_module.outputscale = 0.3
    return layer.requires_grad_(False)


def test_hidden_variables_are_the_inputs_and_a_process():
    """Moments of q(f) = int p(f | u) q(u) du written out."""
    layer = hidden_layer(0.2)
    points, eye = layer.variational_strategy.inducing_points, torch.eye(7, dtype=torch.float64)
    kernel = make_kernel("rq", 4)
    factor = torch.linalg.cholesky(kernel(points).to_dense().detach() + 1e-7 * eye)
    a = torch.linalg.solve(factor, kernel(points, AT).to_dense().detach())
    mean = AT + math.sqrt(0.3) * (draw(4, 7, seed=11) @ a).T
    sd = (0.3 * (1 - 0.96 * a.square().sum(0))).sqrt()
    draws = draw(2, 1, 4, seed=12)
    expected = mean + sd[:, None] * draws
    torch.testing.assert_close(
        layer.draw(AT, draws).reshape(2, -1, 4), expected, rtol=1e-4, atol=1e-5
    )
    for one in draws:
        expected = by_rows(lambda at, one=one: layer.draw(at, one[None]))
        torch.testing.assert_close(layer.slopes(AT, one[None])[0], expected)


def test_bound_of_two_layers_is_the_librarys_over_the_same_draws():
    scores, hidden = sparse(draw(7, 4, seed=4)), hidden_layer(0.2)
    half = draw(20, 4, seed=13)
    draws = torch.stack([half, -half])
    model = TwoLayerGP(hidden, scores, draws[:, :1])
    bound = -Z.numel() * model.loss(X, Z, draws).item()
    places = hidden.draw(X, draws)
    scores.condition(places, Z.repeat(2, 1), copies=2)
    at_draws = [scores.likelihood.expected_log_prob(Z, scores(part)) for part in places.split(20)]
    expected = torch.stack(at_draws).sum() / 2 - model.variational_strategy.kl_divergence()
    assert bound == pytest.approx(float(expected), rel=1e-8)


def test_deep_predictions_are_those_of_the_mixture_over_draws():
    scores, hidden = sparse(draw(7, 4, seed=4)), hidden_layer(0.5)
    scores.condition(X, Z)
    half = draw(3, 1, 4, seed=14)
    model = TwoLayerGP(hidden, scores, torch.cat([half, -half])).eval()
    parts = [scores.likelihood(scores(hidden.draw(AT, d[None]))) for d in model.draws]
    one = Categorical(torch.full((6, 6), 1 / 6, dtype=torch.float64))
    means, variances = (torch.stack([getattr(p, k) for p in parts]) for k in ("mean", "variance"))
    mixture = MixtureSameFamily(
        one, Independent(Normal(means.transpose(0, 1), variances.sqrt().transpose(0, 1)), 1)
    )
    torch.testing.assert_close(model.score_mean(AT), mixture.mean)
    variance = model.score_covariance(AT).diagonal(0, 1, 2)
    torch.testing.assert_close(variance, mixture.variance, rtol=1e-6, atol=1e-8)
