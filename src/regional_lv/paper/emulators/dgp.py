"""DGP: two layers of sparse variational Gaussian processes."""

import math

import gpytorch
import torch
from gpytorch.models.deep_gps import DeepGP, DeepGPLayer
from gpytorch.utils.memoize import clear_cache_hook
from gpytorch.variational import MeanFieldVariationalDistribution, VariationalStrategy
from torch.nn.utils.parametrize import register_parametrization

from regional_lv.emulators.optimise import fit
from regional_lv.emulators.shared_kernel import subset
from regional_lv.paper.emulators.variational import BOUNDS, JITTER, SparseGP, VariationalGP, scaled
from regional_lv.seeds import derive

COPIES = 2
"""Places at which each simulation's hidden variables are tried in training, mirror images."""

DRAWS = 8
"""Fixed draws of the hidden variables that predictions average over, half of them mirrored."""

SPREAD_BOUNDS = {"original": (-15.0, 1.0)}
"""Of the logarithms of the standard deviations of the first layer's q(u)."""


class Exponential(torch.nn.Module):
    """A positive parameter by its logarithm."""

    def forward(self, x):
        return x.exp()

    def right_inverse(self, x):
        return x.log()


class IdentityMean(gpytorch.means.Mean):
    """Of P processes, each at inputs of its own (..., P, N, P): the p-th is input p."""

    def forward(self, x):
        return x.diagonal(dim1=-3, dim2=-1).mT


class HiddenLayer(DeepGPLayer):
    """P hidden variables that are GPs of the P inputs, around the inputs themselves.

    q(u) is Gaussian, independent between whitened inducing values. kernel: P side by side. points:
    (M, P).
    """

    def __init__(self, kernel: gpytorch.kernels.Kernel, points: torch.Tensor):
        width = points.shape[1]
        q = MeanFieldVariationalDistribution(len(points), kernel.batch_shape)
        register_parametrization(q, "_variational_stddev", Exponential())
        strategy = VariationalStrategy(self, points, q, jitter_val=JITTER)
        strategy.variational_params_initialized.fill_(1)
        super().__init__(strategy, width, width)
        self.mean_module = IdentityMean()
        self.covar_module = scaled(kernel)
        self.double()

    def forward(self, x):
        return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))

    def draw(self, x: torch.Tensor, draws: torch.Tensor) -> torch.Tensor:
        """Hidden variables (S N, P) of `x` (N, P) at standard normal `draws` (S, N or 1, P)."""
        hidden = self(x, are_samples=True)  # the draws are ours
        return (hidden.mean + hidden.variance.sqrt() * draws).reshape(-1, x.shape[1])

    def slopes(self, x: torch.Tensor, draws: torch.Tensor) -> torch.Tensor:
        """d(draw)/dx (S, N, P, P): two backward passes, as each process has inputs of its own."""
        with torch.enable_grad():
            own = x.detach().expand(self.output_dims, *x.shape).requires_grad_(True)
            hidden = self.variational_strategy(own)
            by_mean = torch.autograd.grad(hidden.mean.sum(), own, retain_graph=True)[0]
            by_sd = torch.autograd.grad(hidden.variance.sqrt().sum(), own)[0]
        return by_mean.transpose(0, 1) + draws[..., None] * by_sd.transpose(0, 1)


class TwoLayerGP(DeepGP):
    """Scores that are GPs of hidden variables; predictions average over `draws` (S, 1, P)."""

    def __init__(self, hidden: HiddenLayer, scores: SparseGP, draws: torch.Tensor):
        super().__init__()
        self.hidden, self.scores = hidden, scores
        self.register_buffer("draws", draws)

    def loss(self, x: torch.Tensor, z: torch.Tensor, draws: torch.Tensor) -> torch.Tensor:
        """Minus the lower bound per number in `z` (N, K), its expectation over the hidden variables
        taken over `draws` (S, N, P)."""
        places = self.hidden.draw(x, draws)
        bound = self.scores.loss(places, z.repeat(len(draws), 1), len(draws))
        return bound + self.hidden.variational_strategy.kl_divergence().sum() / z.numel()

    def _parts(self, values) -> torch.Tensor:
        """(S, N, ...) of what the second layer says at all draws."""
        return values.reshape(len(self.draws), -1, *values.shape[1:])

    def score_mean(self, x):
        return self._parts(self.scores.score_mean(self.hidden.draw(x, self.draws))).mean(0)

    def score_slopes(self, x):
        outer = self._parts(self.scores.score_slopes(self.hidden.draw(x, self.draws)))
        return (outer @ self.hidden.slopes(x, self.draws)).mean(0)

    def score_covariance(self, x):
        places = self.hidden.draw(x, self.draws)
        apart = self._parts(self.scores.score_mean(places))
        apart = (apart - apart.mean(0)).permute(1, 0, 2)
        within = self._parts(self.scores.score_covariance(places)).mean(0)
        return torch.diag_embed(within) + apart.mT @ apart / len(self.draws)


class DGP(VariationalGP):
    """Deep GP of the paper: scores are independent GPs of P hidden variables, and these are GPs
    of the inputs (Salimbeni and Deisenroth 2017, arXiv:1705.08933).

    The second layer's q(u) is at its optimum (`variational`). Fixed draws of the hidden variables
    make the bound a deterministic objective; training starts from a VGP, the case of hidden
    variables that are the inputs. Settings: those of VGP, deep_iterations.
    """

    name = "dgp"
    mixed = False

    def _fit_scores(self, x, z, seed):
        super()._fit_scores(x, z, seed)
        rows = subset(len(x), self.settings["hyperparameter_rows"], seed)
        generator = torch.Generator().manual_seed(derive(seed, "draws"))
        half = torch.randn(len(x), x.shape[1], generator=generator, dtype=x.dtype)
        draws = torch.stack([half, -half])
        few = torch.randn(DRAWS // 2, 1, x.shape[1], generator=generator, dtype=x.dtype)
        scores = self.model.requires_grad_(True)
        self.model = TwoLayerGP(self._first_layer(scores), scores, torch.cat([few, -few]))
        seen = x[rows], z[rows], draws[:, rows]
        loss = fit(
            [*self.model.hidden.named_parameters(), *scores.named_hyperparameters()],
            lambda: self.model.loss(*seen),
            BOUNDS | SPREAD_BOUNDS,
            self.settings["deep_iterations"],
        )
        with torch.no_grad():
            places = self.model.hidden.draw(x, draws)
            hidden_sd = self.model.hidden.covar_module.outputscale.sqrt().tolist()
        scores.condition(places, z.repeat(COPIES, 1), COPIES)
        clear_cache_hook(self.model.hidden.variational_strategy)  # of what training passed by
        self.model.eval().requires_grad_(False)
        self.info |= {
            "bound_per_number": -loss,
            "hidden_sd": hidden_sd,
            "noise": scores.likelihood.task_noises.tolist(),
        }

    def _first_layer(self, scores: SparseGP) -> HiddenLayer:
        """Hidden variables that are the inputs, but for a little."""
        layer = self._empty_layer(scores)
        q = layer.variational_strategy._variational_distribution
        with torch.no_grad():
            q.variational_mean.zero_()
            q._variational_stddev = torch.full_like(q.variational_mean, math.exp(-4))
        outer, inner = (model.covar_module.base_kernel for model in (scores, layer))
        layer.covar_module.outputscale = 0.1**2
        inner.initialize(raw_lengthscale=outer.raw_lengthscale.mean(0))
        if hasattr(outer, "alpha"):
            inner.initialize(raw_alpha=outer.raw_alpha.mean())
        return layer

    def _build(self, weights):
        scores = {k.removeprefix("scores."): v for k, v in weights.items() if "scores." in k}
        scores = super()._build(scores)
        return TwoLayerGP(self._empty_layer(scores), scores, weights["draws"])

    def _empty_layer(self, scores: SparseGP) -> HiddenLayer:
        points = scores.latent.inducing_points
        return HiddenLayer(self._kernels(points.shape[1]), points)
