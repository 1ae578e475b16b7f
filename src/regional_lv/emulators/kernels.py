"""Stationary kernels of unit variance, as GPyTorch modules.

Those of the paper are the library's. The rational quadratic ones are a class of ours, the same
function in fewer operations (benchmarks/kernels.py).
"""

import math
from collections.abc import Sequence

import gpytorch
import torch
from gpytorch.constraints import Positive

from regional_lv.emulators.base import row_jacobian

ZONAL = "zonal_rq"
"""The product over the zones of rational quadratic kernels of their factors, one alpha."""

IN_CACHE = 400_000
"""Correlations that are computed at a time, 3 MB."""

Blocks = Sequence[slice]
"""Slices that share out the P inputs, in their order."""


def positive() -> Positive:
    """Constraint of a parameter whose logarithm is what is optimised."""
    return Positive(transform=torch.exp, inv_transform=torch.log)


class BlockRQKernel(gpytorch.kernels.Kernel):
    """Product over blocks of inputs of rational quadratic kernels with one alpha.

    The same as a `ProductKernel` of GPyTorch's `RQKernel` over the blocks' `active_dims`, with ARD
    and a shared alpha. One matrix product for each block and no distances in between: values and
    derivatives take a third of the time (benchmarks/kernels.py).

    blocks: slices that share out the P inputs, in their order; one block of all is the usual
    kernel.
    """

    has_lengthscale = True

    def __init__(self, blocks: Sequence[slice], batch_shape: torch.Size | None = None):
        super().__init__(
            ard_num_dims=blocks[-1].stop,
            batch_shape=torch.Size() if batch_shape is None else batch_shape,
            lengthscale_constraint=positive(),
        )
        self.blocks = list(blocks)
        raw = torch.nn.Parameter(torch.zeros(*self.batch_shape, 1))
        self.register_parameter("raw_alpha", raw)
        self.register_constraint("raw_alpha", positive())

    @property
    def alpha(self) -> torch.Tensor:
        return self.raw_alpha_constraint.transform(self.raw_alpha)

    @alpha.setter
    def alpha(self, value) -> None:
        value = torch.as_tensor(value).to(self.raw_alpha).expand_as(self.raw_alpha)
        self.initialize(raw_alpha=self.raw_alpha_constraint.inverse_transform(value))

    def bases(self, x1: torch.Tensor, x2: torch.Tensor) -> list[torch.Tensor]:
        """1 + r_b^2 / (2 alpha) (..., M, N) of each block."""
        scale = (2 * self.alpha[..., None]).rsqrt() / self.lengthscale
        a, b = x1 * scale, x2 * scale
        one_a, one_b = torch.ones_like(a[..., :1]), torch.ones_like(b[..., :1])
        found = []
        for part in self.blocks:
            # (1 + |a|^2) 1 + 1 |b|^2 - 2 a b' as one product
            u, v = a[..., part], b[..., part]
            left = torch.cat([-2 * u, 1 + u.square().sum(-1, keepdim=True), one_a], -1)
            right = torch.cat([v, one_b, v.square().sum(-1, keepdim=True)], -1)
            found.append(left @ right.mT)
        return found

    def of_bases(self, bases: Sequence[torch.Tensor]) -> torch.Tensor:
        """Correlations (..., M, N)."""
        return torch.exp(-self.alpha[..., None] * math.prod(bases[1:], start=bases[0]).log())

    def with_slopes(self, x1, x2) -> tuple[torch.Tensor, list[torch.Tensor]]:
        """Correlations K (M, N), and for each block K / (1 + r_b^2 / (2 alpha)): times
        (x2_p - x1_p) / l_p^2 this is dK/dx1_p, and minus dK/dx2_p."""
        bases = self.bases(x1, x2)
        k = self.of_bases(bases)
        return k, [k / base for base in bases]

    def weighted_slopes(self, x1, x2, weights) -> tuple[torch.Tensor, torch.Tensor]:
        """K(x1, x2) times weights (N, D), (M, D), and its derivative (M, D, P) with respect to
        x1."""
        k, slopes = self.with_slopes(x1, x2)
        by_x = k.new_empty(len(x1), weights.shape[1], x1.shape[1])
        for part, slope in zip(self.blocks, slopes, strict=True):
            plain = slope @ weights
            for p in range(part.start, part.stop):
                moment = slope @ (x2[:, p, None] * weights)
                by_x[:, :, p] = moment - x1[:, p, None] * plain
        return k @ weights, by_x / self.lengthscale[0] ** 2

    def forward(self, x1, x2, diag=False, last_dim_is_batch=False, **params):
        if diag:
            return torch.ones(x1.shape[:-1], dtype=x1.dtype)
        # In pieces whose products stay in the processor's cache: half the time with 5,661 points.
        rows = max(1, IN_CACHE // x2.shape[-2])
        parts = x1.split(rows, dim=-2)
        return torch.cat([self.of_bases(self.bases(part, x2)) for part in parts], dim=-2)


class Matern52Kernel(gpytorch.kernels.MaternKernel):
    """The library's, with distances that have forward derivatives: `torch.cdist` has none."""

    def covar_dist(self, x1, x2, square_dist=False, **params):
        squared = super().covar_dist(x1, x2, square_dist=True, **params)
        # The square root has no derivative at zero, the kernel has: 0 in every direction.
        return squared if square_dist else squared.clamp(min=1e-30).sqrt()


def weighted_slopes(
    kernel: gpytorch.kernels.Kernel, x1: torch.Tensor, x2: torch.Tensor, weights: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """K(x1, x2) times weights (N, D), (M, D), and its derivative (M, D, P) with respect to x1 (M,
    P)."""
    if isinstance(kernel, BlockRQKernel):
        return kernel.weighted_slopes(x1, x2, weights)

    def weighted(at):
        return kernel(at, x2).to_dense() @ weights

    return weighted(x1), row_jacobian(weighted, x1)


def make_kernel(
    name: str, inputs: int, blocks: Blocks = (), batch: Sequence[int] = ()
) -> gpytorch.kernels.Kernel:
    """A kernel of unit variance with a length scale for each of the `inputs`, double precision.

    blocks: of a zonal kernel, the factors of each zone. batch: as many kernels side by side.
    """
    shape = torch.Size(batch)
    if name in ("rq", ZONAL):
        parts = blocks if name == ZONAL else [slice(0, inputs)]
        return BlockRQKernel(parts, shape).double()
    options = {
        "ard_num_dims": inputs,
        "batch_shape": shape,
        "lengthscale_constraint": positive(),
    }
    if name == "rbf":
        return gpytorch.kernels.RBFKernel(**options).double()
    if name == "matern52":
        return Matern52Kernel(nu=2.5, **options).double()
    raise KeyError(name)
