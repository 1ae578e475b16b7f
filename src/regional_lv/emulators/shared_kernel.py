"""One kernel for all outputs: its likelihood, its maximum, and which kernel to take.

Intrinsic coregionalisation (Bonilla et al. 2007): cov(y_k(x), y_l(x')) = b_kl K(x, x'). With all
outputs seen at all inputs the maximum-likelihood B has a closed form given K, so that the
hyperparameters are those of K alone.
"""

import logging
import math

import gpytorch
import numpy as np
import torch
from gpytorch.constraints import GreaterThan

from regional_lv.emulators.kernels import Blocks, make_kernel
from regional_lv.emulators.optimise import fit
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

CHOICE_ROWS, CHOICE_FOLDS, CHOICE_ITERATIONS = 300, 3, 40
"""Cross-validation of the kernels: rows used at most, folds, iterations per fit. Kernels differ by
far more than this leaves uncertain."""

OFFERED = ("rq", "rbf", "matern52")
"""Kernels among which cross-validation chooses, those of the paper."""

MOST_NUGGET = 1e-2
"""Largest nugget that is tried for a Cholesky factor: beyond it the matrix is wrong, not stiff."""


class SharedKernelGP(gpytorch.models.ExactGP):
    """Processes of all outputs with one kernel K, cov(y_k(x), y_l(x')) = b_kl K(x, x').

    kernel: one of `kernels.make_kernel`. inputs: their number P. nugget: the least that is added to
    the diagonal of the correlations; more is learnt, as the likelihood's noise, where the data ask
    for it. blocks: of a zonal kernel. x (N, P), y (N, D): training set, for `loss`.
    """

    def __init__(
        self, kernel: str, inputs: int, nugget: float, blocks: Blocks = (), x=None, y=None
    ):
        noise = GreaterThan(nugget, transform=torch.exp, inv_transform=torch.log)
        super().__init__(x, y, gpytorch.likelihoods.GaussianLikelihood(noise_constraint=noise))
        self.mean_module = gpytorch.means.ZeroMean()  # a constant is projected out
        self.covar_module = make_kernel(kernel, inputs, blocks)
        self.double()

    def forward(self, x):
        return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))

    @property
    def of_values(self) -> gpytorch.kernels.Kernel:
        return self.covar_module

    @property
    def length_scales(self) -> torch.Tensor:
        """(P,)"""
        return self.covar_module.lengthscale.detach()[0]

    @property
    def alpha(self) -> float:
        """Exponent of a rational quadratic kernel, 1 of others."""
        alpha = getattr(self.covar_module, "alpha", None)
        return 1.0 if alpha is None else alpha.item()

    @property
    def nugget(self) -> float:
        return self.likelihood.noise.item()

    def start_at(self, logs: np.ndarray) -> None:
        """Set the logarithms of length scales, alpha and what is added to the least nugget."""
        *scales, alpha, nugget = torch.as_tensor(logs)
        self.covar_module.initialize(raw_lengthscale=torch.stack(scales)[None])
        if hasattr(self.covar_module, "raw_alpha"):
            self.covar_module.initialize(raw_alpha=alpha)
        self.likelihood.noise_covar.initialize(raw_noise=nugget)

    def loss(self) -> torch.Tensor:
        """Minus the restricted log likelihood of the training set, with B at its maximum.

        (N - 1)/2 log|B| + D/2 (log|K| + log(1' K^-1 1)), B = Y' Q Y / (N - 1), Q the precision with
        the constant mean projected out; up to constants.
        """
        (x,), y = self.train_inputs, self.train_targets
        n, d = y.shape
        matrix = self.covar_module(x).to_dense()
        matrix = matrix + self.likelihood.noise * torch.eye(n, dtype=x.dtype)
        factor = torch.linalg.cholesky(matrix)
        b, _, _, total = profile(factor, y)
        value = (n - 1) * torch.linalg.cholesky(b).diagonal().log().sum()
        return value + d * (factor.diagonal().log().sum() + 0.5 * total[0].log())


BOUNDS = {"raw_lengthscale": (-2.0, 6.0), "raw_alpha": (-3.0, 5.0), "raw_noise": (-30.0, 0.0)}
"""Of the logarithms of length scales, of alpha and of what is added to the least nugget."""


def subset(rows: int, most: int, seed: int) -> torch.Tensor:
    """At most `most` of `rows` row numbers, chosen at random, ascending."""
    if rows <= most:
        return torch.arange(rows)
    shuffled = np.random.default_rng(derive(seed, "rows")).permutation(rows)
    return torch.as_tensor(np.sort(shuffled[:most]))


def fit_hyperparameters(
    x: torch.Tensor,
    y: torch.Tensor,
    kernel: str,
    nugget: float,
    iterations: int,
    restarts: int,
    seed: int,
    blocks: Blocks = (),
) -> SharedKernelGP:
    """Most likely of `restarts` seeded starts, for inputs (N, P) and outputs (N, D) of unit scale.

    nugget: the least; more is learnt where the data ask for it. blocks: of a zonal kernel.
    """
    inputs = x.shape[1]
    rng = np.random.default_rng(derive(seed, "hyperparameters"))
    first = np.concatenate([np.full(inputs, math.log(5.0)), [0.0, math.log(1e-6)]])
    best, least = None, math.inf
    for start in range(restarts):
        model = SharedKernelGP(kernel, inputs, nugget, blocks, x, y)
        model.start_at(first + (rng.normal(0, 0.7, len(first)) if start else 0.0))
        loss = fit(model.named_parameters(), model.loss, BOUNDS, iterations)
        log.debug(
            "%s kernel: start %d of %d, negative log likelihood %.2f",
            kernel,
            start + 1,
            restarts,
            loss,
        )
        if best is None or loss < least:
            best, least = model, loss
    assert best is not None  # there is a first start
    return best


def choose_kernel(x: torch.Tensor, y: torch.Tensor, nugget: float, seed: int) -> tuple[str, dict]:
    """The kernel with the least K-fold cross-validated error, and the errors (root mean square).

    Inputs (N, P) and outputs (N, D) of unit scale. On a subsample: `CHOICE_ROWS`.
    """
    rows = subset(len(x), CHOICE_ROWS, derive(seed, "choice"))
    x, y = x[rows], y[rows]
    order = np.random.default_rng(derive(seed, "folds")).permutation(len(x))
    fold = torch.as_tensor(order % CHOICE_FOLDS)
    errors = {}
    for kernel in OFFERED:
        total = 0.0
        for k in range(CHOICE_FOLDS):
            inside, outside = fold != k, fold == k
            model = fit_hyperparameters(
                x[inside], y[inside], kernel, nugget, CHOICE_ITERATIONS, restarts=1, seed=seed
            )
            with torch.no_grad():
                matrix = model.covar_module(x[inside]).to_dense()
                factor, _ = cholesky(matrix, model.nugget, "choice of the kernel")
                mean, weights = condition(factor, y[inside], torch.ones_like(matrix[:, :1]))
                cross = model.covar_module(x[outside], x[inside]).to_dense()
            total += float((mean + cross @ weights - y[outside]).square().sum())
        errors[kernel] = math.sqrt(total / y.numel())
    best = min(errors, key=errors.__getitem__)
    log.info(
        "kernel %s: cross-validated errors %s",
        best,
        ", ".join(f"{name} {error:.4f}" for name, error in errors.items()),
    )
    return best, errors


# ------------------------------------------------------------------------------ linear algebra


def cholesky(matrix: torch.Tensor, nugget: float, who: str) -> tuple[torch.Tensor, float]:
    """Lower factor of `matrix` (..., N, N) + nugget I, and the nugget: raised, and logged, until
    there is a factor. Changes `matrix`. Raises ArithmeticError beyond `MOST_NUGGET`."""
    matrix.diagonal(dim1=-2, dim2=-1).add_(nugget)
    factor, failed = torch.linalg.cholesky_ex(matrix)
    while failed.any():
        if nugget > MOST_NUGGET:
            raise ArithmeticError(f"{who}: no Cholesky factor with a nugget of {nugget:.1e}")
        matrix.diagonal(dim1=-2, dim2=-1).add_(9 * nugget)
        nugget *= 10
        log.warning("%s: nugget raised to %.1e for a Cholesky factor", who, nugget)
        factor, failed = torch.linalg.cholesky_ex(matrix)
    return factor, nugget


def projected_precision(factor: torch.Tensor, constant: torch.Tensor) -> torch.Tensor:
    """Q = K^-1 - K^-1 c c' K^-1 / (c' K^-1 c), of a factor (N, N).

    constant: c (N, 1), what each observation sees of the unknown constant mean. Training needs
    all of K^-1; predictions never use it.
    """
    precision = torch.cholesky_inverse(factor)
    sums = precision @ constant
    # In place: it is as large as all else together.
    return precision.addmm_(sums, sums.T, alpha=-1 / float(constant.T @ sums))


def condition(
    factor: torch.Tensor, y: torch.Tensor, constant: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Generalised least-squares mean (..., D) and weights K^-1 (y - c mean) (..., N, D)."""
    solved = torch.cholesky_solve(constant.expand(*factor.shape[:-1], 1), factor)
    mean = solved.mT @ y / (solved.mT @ constant)
    return mean[..., 0, :], torch.cholesky_solve(y - constant * mean, factor)


def profile(factor: torch.Tensor, y: torch.Tensor) -> tuple[torch.Tensor, ...]:
    """What is most likely given the Cholesky factor (..., N, N) of the covariance matrix K: B
    (..., D, D), constants (..., 1, D), outputs (..., N, D) whitened and less these, and 1' K^-1 1
    (..., 1)."""
    both = torch.cat([y, torch.ones_like(y[..., :1])], -1)
    white = torch.linalg.solve_triangular(factor, both, upper=False)
    white, one = white[..., :-1], white[..., -1:]
    total = one.square().sum(-2)
    constant = (one.mT @ white) / total[..., None]
    white = white - one * constant
    n, d = y.shape[-2:]
    b = white.mT @ white / (n - 1)
    if n <= d:
        # No more simulations than outputs leave B singular, and the likelihood without bound.
        b = torch.diag_embed(b.diagonal(dim1=-2, dim2=-1))
    return regular(b), constant, white, total


def regular(b: torch.Tensor) -> torch.Tensor:
    """`b` with a little on its diagonal, for outputs that depend on one another exactly."""
    size = b.diagonal(dim1=-2, dim2=-1).mean(-1)[..., None, None]
    return b + 1e-9 * size * torch.eye(b.shape[-1], dtype=b.dtype)
