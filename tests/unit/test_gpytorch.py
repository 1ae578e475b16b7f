"""Our kernels, likelihoods and bounds against GPyTorch's, at the same parameters.

The emulators put the optimal q(u) in closed form into their bound, which GPyTorch's variational
models do not offer; an independent implementation says whether what is optimised is the bound.
"""

import math

import gpytorch
import pytest
import torch

from regional_lv.emulators.kernels import correlation
from regional_lv.emulators.mvgp import MVGP
from regional_lv.emulators.variational import JITTER
from regional_lv.emulators.vgp import VGP

SCALES = torch.tensor([0.7, 1.3, 2.0, 0.9], dtype=torch.float64)
ALPHA = 1.7


def draw(rows: int, columns: int, seed: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(rows, columns, generator=generator, dtype=torch.float64)


def theirs(name: str):
    """GPyTorch's kernel of unit variance with the parameters above."""
    kernel = {
        "rq": gpytorch.kernels.RQKernel,
        "rbf": gpytorch.kernels.RBFKernel,
        "matern52": lambda **k: gpytorch.kernels.MaternKernel(nu=2.5, **k),
    }[name](ard_num_dims=len(SCALES)).double()
    kernel.lengthscale = SCALES
    if name == "rq":
        kernel.alpha = torch.tensor(ALPHA)
    return kernel


@pytest.mark.parametrize("name", ["rq", "rbf", "matern52"])
def test_kernels(name):
    a, b = draw(6, 4, 1), draw(5, 4, 2)
    ours = correlation(name, a, b, SCALES[None], torch.tensor([ALPHA], dtype=torch.float64))[0]
    torch.testing.assert_close(ours, theirs(name)(a, b).to_dense().detach(), rtol=1e-7, atol=1e-9)


class SVGP(gpytorch.models.ApproximateGP):
    """Independent latent processes; with a mixing matrix, GPyTorch's LMC of them."""

    def __init__(self, points, kernels, mixing=None):
        latents = len(kernels)
        distribution = gpytorch.variational.CholeskyVariationalDistribution(
            len(points), batch_shape=torch.Size([latents])
        )
        strategy = gpytorch.variational.VariationalStrategy(
            self,
            points.expand(latents, *points.shape).clone(),
            distribution,
            learn_inducing_locations=False,
            jitter_val=JITTER,
        )
        if mixing is None:
            strategy = gpytorch.variational.IndependentMultitaskVariationalStrategy(
                strategy, num_tasks=latents
            )
        else:
            strategy = gpytorch.variational.LMCVariationalStrategy(
                strategy, num_tasks=len(mixing), num_latents=latents, latent_dim=-1
            )
        super().__init__(strategy)
        self.kernels = kernels

    def forward(self, x):
        each = x if x.ndim > 2 else x.expand(len(self.kernels), *x.shape)
        matrices = [kernel(at).to_dense() for kernel, at in zip(self.kernels, each, strict=True)]
        return gpytorch.distributions.MultivariateNormal(
            torch.zeros(len(matrices), x.shape[-2], dtype=x.dtype), torch.stack(matrices)
        )


@pytest.mark.parametrize("cls", [VGP, MVGP])
def test_bound_is_gpytorchs_with_the_optimal_q(cls):
    """ELBO of the same model, its q(u) set to what ours takes as the optimum."""
    x, points, z = draw(20, 4, 3), draw(7, 4, 4), draw(20, 3, 5)
    latents = 2 if cls is MVGP else 3
    mixing = draw(3, latents, 6) if cls is MVGP else torch.tensor([0.3, -0.2, 0.1]).double()
    parameters = {
        "points": points,
        "length_scales": SCALES.log() + 0.1 * draw(latents, 4, 7),
        "alpha": torch.full((latents,), math.log(ALPHA), dtype=torch.float64),
        "mixing": mixing,
        "noise": torch.tensor([0.05, 0.1, 0.2], dtype=torch.float64).log(),
    }
    ours = cls()
    ours.kernel = "rq"
    loss = ours._loss(parameters, x, z)
    w, noise, _, a, _, h = ours._terms(parameters, x, 1)
    m = ours._means(w, noise, a, h, z)

    kernels = []
    for q in range(latents):
        kernel = theirs("rq")
        kernel.lengthscale = parameters["length_scales"][q].exp()
        kernels.append(kernel)
    model = SVGP(points, kernels, mixing if cls is MVGP else None).double()
    base = model.variational_strategy.base_variational_strategy
    base.variational_params_initialized.fill_(1)
    with torch.no_grad():
        q = base._variational_distribution
        q.variational_mean.copy_(m)
        q.chol_variational_covar.copy_(torch.linalg.cholesky(torch.cholesky_inverse(h)))
        if cls is MVGP:
            model.variational_strategy.lmc_coefficients.copy_(mixing.T)
        model.eval()
        predicted = model(x)
        mean, variance = predicted.mean, predicted.variance
        if cls is VGP:
            mean, variance = mean * mixing.exp(), variance * mixing.exp().square()
        fit = (z - mean).square() + variance
        expected = -0.5 * ((2 * math.pi * noise).log() + fit / noise).sum()
        bound = expected - base.kl_divergence().sum()
    assert -loss * z.numel() == pytest.approx(float(bound), rel=1e-5)
