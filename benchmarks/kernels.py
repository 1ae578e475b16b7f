"""The rational quadratic kernels of ours against GPyTorch's, in pairs.

    python benchmarks/kernels.py

Prints CPU milliseconds of both and their ratio: the likelihood of 1,500 simulations with its
gradient, and the mean of 256 points with its gradient among 5,661 simulations.
"""

import statistics
import time
from collections.abc import Callable

import gpytorch
import torch

from regional_lv.emulators.kernels import ZONAL, make_kernel, positive
from regional_lv.inputs.stiffness import StiffnessInputs

PAIRS = 7
BLOCKS = StiffnessInputs().blocks


def of_library() -> gpytorch.kernels.Kernel:
    """The same kernel as a product of the library's over `active_dims`, with one alpha."""
    parts = [
        gpytorch.kernels.RQKernel(
            ard_num_dims=part.stop - part.start,
            active_dims=tuple(range(part.start, part.stop)),
            lengthscale_constraint=positive(),
            alpha_constraint=positive(),
        )
        for part in BLOCKS
    ]
    for part in parts[1:]:
        part.raw_alpha = parts[0].raw_alpha
    return gpytorch.kernels.ProductKernel(*parts).double()


def likelihood(kernel, x: torch.Tensor, y: torch.Tensor) -> None:
    """Gaussian log likelihood of the rows, and its gradient with respect to the kernel's
    parameters."""
    matrix = kernel(x).to_dense() + 1e-4 * torch.eye(len(x), dtype=x.dtype)
    factor = torch.linalg.cholesky(matrix)
    white = torch.linalg.solve_triangular(factor, y, upper=False)
    (factor.diagonal().log().sum() + white.square().mean()).backward()


def mean(kernel, at: torch.Tensor, x: torch.Tensor, weights: torch.Tensor) -> None:
    """A mean with its gradient with respect to the points."""
    at = at.clone().requires_grad_(True)
    torch.autograd.grad((kernel(at, x).to_dense() @ weights).sum(), at)


def paired(name: str, ours: Callable[[], None], theirs: Callable[[], None]) -> None:
    """Run both in turn; print the medians and the median ratio."""
    seconds = []
    for run in (ours, theirs):
        run()
    for _ in range(PAIRS):
        pair = []
        for run in (ours, theirs):
            started = time.process_time()
            run()
            pair.append(time.process_time() - started)
        seconds.append(pair)
    a, b = (1e3 * statistics.median(column) for column in zip(*seconds, strict=True))
    ratio = statistics.median(second / first for first, second in seconds)
    print(f"{name}: ours {a:.1f} ms, GPyTorch {b:.1f} ms, ratio {ratio:.2f}")


def main() -> None:
    torch.set_num_threads(1)
    generator = torch.Generator().manual_seed(0)

    def random(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    inputs = BLOCKS[-1].stop
    kernels = make_kernel(ZONAL, inputs, BLOCKS), of_library()
    x, y = random(1500, inputs), random(1500, 52)
    paired("likelihood", *(lambda k=k: likelihood(k, x, y) for k in kernels))
    for kernel in kernels:
        kernel.requires_grad_(False)
    at, many, weights = random(256, inputs), random(5661, inputs), random(5661, 52)
    paired("mean", *(lambda k=k: mean(k, at, many, weights) for k in kernels))


if __name__ == "__main__":
    main()
