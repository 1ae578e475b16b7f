"""Sparse variational Gaussian processes: latent processes, mixed into the scores.

Scores y_k = sum_q W_kq g_q(x) + noise of variance s_k, g_q ~ GP(0, K_q). At M inducing points Z,
g_q = L_q u_q with K_q(Z, Z) = L_q L_q' (whitening), and q(u) = prod_q N(m_q, S_q). The lower bound
on the evidence is (Hensman et al. 2015, arXiv:1411.2005; Alvarez and Lawrence 2011 for the mixing)

    sum_k [-N/2 log(2 pi s_k) - |y_k - (W mu)_k|^2 / (2 s_k)]
    - 1/2 sum_q [beta_q (tr K_q(X, X) - |A_q|^2) + log|H_q| + |m_q|^2],

with A_q = L_q^-1 K_q(Z, X), mu_q = A_q' m_q, beta_q = sum_k W_kq^2 / s_k and
H_q = I + beta_q A_q A_q', once S_q = H_q^-1 is put in, its optimum (Titsias 2009, for one output).
The optimal m solves a linear system. What is left to optimise, length scales, mixing, noise and
inducing points, has a smooth deterministic objective: natural gradients with step one for q(u),
L-BFGS for the rest, instead of thousands of stochastic steps. Model, q(u) and predictions are
GPyTorch's.
"""

import math

import gpytorch
import torch
from gpytorch.variational import (
    CholeskyVariationalDistribution,
    IndependentMultitaskVariationalStrategy,
    LMCVariationalStrategy,
    VariationalStrategy,
)
from linear_operator.operators import DiagLinearOperator

from regional_lv.emulators.kernels import make_kernel, positive
from regional_lv.emulators.optimise import fit
from regional_lv.emulators.reduced import ReducedEmulator
from regional_lv.emulators.reduction import VOLUME
from regional_lv.emulators.shared_kernel import (
    SharedKernelGP,
    cholesky,
    fit_hyperparameters,
    subset,
)
from regional_lv.seeds import derive

JITTER = 1e-7
"""On the diagonal of the prior covariances, part of the model."""

START_ROWS, START_ITERATIONS = 500, 60
"""The exact GP with a shared kernel that gives the first length scales."""

CG_STEPS, CG_TOLERANCE = 60, 1e-8
"""Conjugate gradients for the means of coupled latent processes."""

CACHE_ROWS = 64
"""Points predicted at a time: larger matrices take longer, as the cache does not hold them."""

BOUNDS = {
    "raw_lengthscale": (-3.0, 6.0),
    "raw_alpha": (-3.0, 5.0),
    "raw_outputscale": (-20.0, 9.0),
    "raw_task_noises": (math.log(1e-8), 1.0),
}
"""Of the parameters, all logarithms; mixing and inducing points are free."""


class PreparedStrategy(VariationalStrategy):
    """The library's, with what predictions of single points need prepared once q(u) is known.

    At k = K(Z, x) the mean is k'w, w = L^-T m (Q, M), and the variance K(x, x) - |Rk|^2 with
    R'R = L^-T (I - S) L^-1 (Q, M, M): one product, where the library solves with L and multiplies
    by both factors of S at every call. Means and their slopes take a fifth to a fifteenth of the
    library's time, variances two fifths. Only marginals (diag) of a zero-mean prior after training.
    """

    def __init__(self, model, points: torch.Tensor, q: CholeskyVariationalDistribution):
        super().__init__(model, points, q, jitter_val=JITTER)
        size = len(points)
        self.register_buffer("mean_weights", torch.zeros(*q.batch_shape, size))
        self.register_buffer("variance_root", torch.zeros(*q.batch_shape, size, size))

    def mean(self, x: torch.Tensor) -> torch.Tensor:
        """(Q, N)"""
        return self._mean(self._cross(x))

    def _mean(self, cross):
        return (self.mean_weights[:, None] @ cross)[:, 0]

    def _cross(self, x):
        return self.model.covar_module.forward(self.inducing_points, x)

    def forward(self, x, inducing_points, *args, diag=True, **kwargs):
        if self.training or not diag:
            return super().forward(x, inducing_points, *args, diag=diag, **kwargs)
        cross = self._cross(x)
        prior = self.model.forward(x).variance + self.jitter_val
        variance = prior - (self.variance_root @ cross).square().sum(-2)
        covariance = DiagLinearOperator(variance)
        return gpytorch.distributions.MultivariateNormal(self._mean(cross), covariance)

    @torch.no_grad()
    def prepare(self, m: torch.Tensor, h: torch.Tensor, factor: torch.Tensor) -> None:
        """Write q(u) = N(m, H^-1) into the variational distribution, and what it means for
        predictions; `factor` is L."""
        eye = torch.eye(h.shape[-1], dtype=h.dtype).expand_as(h)
        # H^-1 = (U U')^-1 = U^-T U^-1, U upper: the factor of H from its last row to the first
        upper = torch.linalg.cholesky(h.flip(-2, -1)).flip(-2, -1)
        q = self._variational_distribution
        q.variational_mean.copy_(m)
        q.chol_variational_covar.copy_(torch.linalg.solve_triangular(upper.mT, eye, upper=False))
        self.variational_params_initialized.fill_(1)
        weights = torch.linalg.solve_triangular(factor.mT, m[..., None], upper=True)
        self.mean_weights.copy_(weights[..., 0])
        # I - H^-1 = V diag(1 - 1/e) V'
        values, vectors = torch.linalg.eigh(h)
        root = (1 - 1 / values.clamp(min=1)).sqrt()[..., None] * vectors.mT
        self.variance_root.copy_(
            torch.linalg.solve_triangular(factor, root, upper=False, left=False)
        )


class SparseGP(gpytorch.models.ApproximateGP):
    """Q latent processes on inducing points (M, P) that they share, and the K scores made of them.

    kernel: of unit variance, Q side by side. mixed: by a full matrix (linear model of
    coregionalisation); otherwise each score has a process, with a variance of its own.
    """

    def __init__(self, kernel: gpytorch.kernels.Kernel, points, scores: int, mixed: bool):
        batch = kernel.batch_shape
        q = CholeskyVariationalDistribution(len(points), batch)
        strategy = PreparedStrategy(self, points, q)
        if mixed:
            strategy = LMCVariationalStrategy(strategy, scores, *batch, jitter_val=JITTER)
        else:
            strategy = IndependentMultitaskVariationalStrategy(strategy, scores)
        super().__init__(strategy)
        self.mixed = mixed
        self.mean_module = gpytorch.means.ZeroMean(batch)
        self.covar_module = kernel if mixed else scaled(kernel)
        self.likelihood = gpytorch.likelihoods.MultitaskGaussianLikelihood(
            scores, has_global_noise=False, noise_constraint=positive()
        )
        self.double()

    def forward(self, x):
        x = x.expand(*self.covar_module.batch_shape, *x.shape[-2:])
        return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))

    @property
    def latent(self) -> PreparedStrategy:
        return self.variational_strategy.base_variational_strategy

    @property
    def mixing(self) -> torch.Tensor:
        """W (K, Q)."""
        if self.mixed:
            return self.variational_strategy.lmc_coefficients.T
        return torch.eye(self.likelihood.num_tasks, dtype=torch.float64)

    # ------------------------------------------------------------------------- the lower bound

    def _terms(self, x, copies):
        """Noise variances (K,), L (Q, M, M), A (Q, M, N), beta (Q,), H (Q, M, M) and its factor."""
        points = self.latent.inducing_points
        eye = torch.eye(len(points), dtype=x.dtype)
        noise = copies * self.likelihood.task_noises
        factor = torch.linalg.cholesky(self.covar_module(points).to_dense() + JITTER * eye)
        cross = self.covar_module(points, x).to_dense()
        a = torch.linalg.solve_triangular(factor, cross, upper=False)
        beta = (self.mixing.square() / noise[:, None]).sum(0)
        h = eye + beta[:, None, None] * (a @ a.mT)
        return noise, factor, a, beta, h, torch.linalg.cholesky(h)

    def loss(self, x: torch.Tensor, z: torch.Tensor, copies: int = 1) -> torch.Tensor:
        """Minus the lower bound per number in `z` (N, K) at `x` (N, P), q(u) at its optimum.

        By the envelope theorem the optimum's own dependence on the parameters does not matter for
        the gradient. copies: how often each observation stands in `x` and `z`, at different places,
        with as small a share of the likelihood.
        """
        noise, _, a, beta, _, root = self._terms(x, copies)
        with torch.no_grad():
            m = self._means(noise, a, root, z)
        fitted = (m[:, None] @ a)[:, 0].T @ self.mixing.T
        prior = self.latent(x, prior=True).variance.sum(-1) + len(x) * JITTER
        value = len(x) / copies * (2 * math.pi * noise / copies).log().sum()
        value = value + ((z - fitted).square().sum(0) / noise).sum()
        value = value + (beta * (prior - a.square().sum((1, 2)))).sum()
        value = value + 2 * root.diagonal(dim1=-2, dim2=-1).log().sum() + m.square().sum()
        return 0.5 * copies * value / z.numel()

    def _means(self, noise, a, root, z) -> torch.Tensor:
        """Optimal whitened means m (Q, M) of all latent processes together.

        H_q m_q + sum_q' c_qq' A_q A_q'' m_q' = A_q (z W / noise)_q over q' other than q, with
        c = W' diag(1/noise) W; conjugate gradients with the factors of H as preconditioner.
        """
        weighted = self.mixing / noise[:, None]
        coupling = self.mixing.T @ weighted

        def apply(m):
            return m + (a @ (coupling @ (m[:, None] @ a)[:, 0])[..., None])[..., 0]

        def precondition(r):
            return torch.cholesky_solve(r[..., None], root)[..., 0]

        right = (a @ (z @ weighted).T[..., None])[..., 0]
        m = precondition(right)
        if not self.mixed:
            return m
        residual = right - apply(m)
        step = preconditioned = precondition(residual)
        size, enough = (residual * preconditioned).sum(), CG_TOLERANCE * (right * m).sum()
        for _ in range(CG_STEPS):
            if size <= enough:
                break
            image = apply(step)
            rate = size / (step * image).sum()
            m, residual = m + rate * step, residual - rate * image
            preconditioned = precondition(residual)
            before, size = size, (residual * preconditioned).sum()
            step = preconditioned + size / before * step
        return m

    @torch.no_grad()
    def condition(self, x: torch.Tensor, z: torch.Tensor, copies: int = 1) -> None:
        """Write the optimal q(u) for all of `x` and `z`, as in `loss`; nothing is learnt after."""
        noise, factor, a, _, h, root = self._terms(x, copies)
        self.latent.prepare(self._means(noise, a, root, z), h, factor)
        self.eval().requires_grad_(False)

    # ---------------------------------------------------------------------------- predicting

    def score_mean(self, x: torch.Tensor) -> torch.Tensor:
        """(N, K)"""
        mean = torch.cat([self.latent.mean(rows) for rows in x.split(CACHE_ROWS)], 1).T
        return mean @ self.mixing.T if self.mixed else mean

    def score_slopes(self, x: torch.Tensor) -> torch.Tensor:
        """d(mean)/dx (N, K, P), one backward pass: each latent process has inputs of its own."""
        slopes = []
        for rows in x.detach().split(CACHE_ROWS):
            with torch.enable_grad():
                own = rows.expand(self.latent.mean_weights.shape[0], *rows.shape)
                own = own.requires_grad_(True)
                slopes.append(torch.autograd.grad(self.latent.mean(own).sum(), own)[0])
        slopes = torch.cat(slopes, 1).transpose(0, 1)
        return self.mixing @ slopes if self.mixed else slopes

    def score_covariance(self, x: torch.Tensor) -> torch.Tensor:
        """Variances (N, K), or if mixed covariances (N, K, K), of observed scores."""
        variance = torch.cat([self.latent(rows).variance for rows in x.split(CACHE_ROWS)], 1).T
        noise = self.likelihood.task_noises
        if not self.mixed:
            return variance + noise
        return (self.mixing * variance[:, None, :]) @ self.mixing.T + torch.diag(noise)


def scaled(kernel: gpytorch.kernels.Kernel) -> gpytorch.kernels.ScaleKernel:
    """A kernel, or each of some side by side, times a variance."""
    return gpytorch.kernels.ScaleKernel(
        kernel, batch_shape=kernel.batch_shape, outputscale_constraint=positive()
    ).double()


class VariationalGP(ReducedEmulator):
    """Sparse variational GP on all simulations.

    mixed: latent processes are mixed by a full matrix (linear model of coregionalisation), or each
    score has its own. Settings: inducing (number of points, shared by the processes), kernel,
    iterations (L-BFGS), hyperparameter_rows (rows that the hyperparameters see; q(u) sees all).
    """

    mixed: bool
    _KEYS = ("kernel",)

    def _fit_scores(self, x, z, seed):
        s = self.settings
        self.kernel = self._choose_kernel(x, z, JITTER, seed)
        self.model = self._start(x, z, seed)
        rows = subset(len(x), s["hyperparameter_rows"], seed)
        seen = x[rows], z[rows]
        parameters = self.model.named_hyperparameters()
        loss = fit(parameters, lambda: self.model.loss(*seen), BOUNDS, s["iterations"])
        self.model.condition(x, z)
        self.info |= {
            "hyperparameter_rows": len(rows),
            "inducing": len(self.model.latent.inducing_points),
            "bound_per_number": -loss,
            "noise": self.model.likelihood.task_noises.tolist(),
        }

    def _start(self, x, z, seed) -> SparseGP:
        """Inducing points by k-means, length scales of an exact GP, mixing by one score each."""
        rows = subset(len(x), START_ROWS, derive(seed, "start"))
        exact = fit_hyperparameters(
            x[rows],
            z[rows],
            self.kernel,
            JITTER,
            START_ITERATIONS,
            restarts=1,
            seed=seed,
            blocks=self.parameters.blocks,
        )
        points = x
        if self.settings["inducing"] < len(x):
            from sklearn.cluster import KMeans  # slow to load, and every job loads this module

            means = KMeans(self.settings["inducing"], n_init=1, max_iter=50, random_state=seed)
            scaled_x = (x / exact.length_scales).numpy()
            points = torch.as_tensor(means.fit(scaled_x).cluster_centers_) * exact.length_scales
        model = self._empty(points, z.shape[1])
        # A process may vary more than its N values do: the exact GP knows by how much.
        signal = self._signal(exact, x[rows], z[rows])
        kernel = model.covar_module
        if self.mixed:
            # With fewer processes than scores, the last ones have none at the start. Volumes stand
            # last and are no small components: without one, L-BFGS has to find them in others'.
            components = z.shape[1] - int(self.channels.of_quantity(VOLUME).sum())
            order = [*range(components, z.shape[1]), *range(components)]
            mixing = torch.diag(signal)[order[: model.variational_strategy.num_latents]]
            model.variational_strategy.initialize(lmc_coefficients=mixing)
        else:
            kernel.outputscale, kernel = signal.square(), kernel.base_kernel
        kernel.lengthscale = exact.length_scales
        if hasattr(kernel, "alpha"):
            kernel.alpha = exact.alpha
        model.likelihood.task_noises = torch.tensor(1e-2)
        return model

    def _signal(self, exact: SharedKernelGP, x, z) -> torch.Tensor:
        """Standard deviation (K,) of the process of each score, from the exact GP."""
        with torch.no_grad():
            factor, _ = cholesky(exact.covar_module(x).to_dense(), exact.nugget, self.name)
        return torch.linalg.solve_triangular(factor, z, upper=False).square().mean(0).sqrt()

    def _empty(self, points: torch.Tensor, scores: int) -> SparseGP:
        latents = min(self.settings["latents"], scores) if self.mixed else scores
        return SparseGP(self._kernels(latents), points, scores, self.mixed)

    def _kernels(self, count: int) -> gpytorch.kernels.Kernel:
        """`count` of the chosen kind side by side."""
        inputs, blocks = len(self.parameters), self.parameters.blocks
        return make_kernel(self.kernel, inputs, blocks, [count])

    def _build(self, weights):
        points = weights["variational_strategy.base_variational_strategy.inducing_points"]
        return self._empty(points, len(self.score_sd))

    # ---------------------------------------------------------------------------- predicting

    def _mean(self, x):
        return self.model.score_mean(x)

    def _mean_jacobian(self, x):
        return self.model.score_slopes(x)

    def _covariance(self, x):
        return self.model.score_covariance(x)


class VGP(VariationalGP):
    """VGP of the paper. Settings: inducing, kernel, iterations, hyperparameter_rows."""

    name = "vgp"
    mixed = False


class MVGP(VariationalGP):
    """MVGP of the paper. Settings: those of VGP, and latents (processes that are mixed)."""

    name = "mvgp"
    mixed = True
