"""L-BFGS on a list of tensors, deterministic; for losses of the whole data at hand."""

from collections.abc import Callable

import numpy as np
import torch
from scipy.optimize import minimize


def lbfgs(
    loss: Callable[[list[torch.Tensor]], torch.Tensor],
    start: list[torch.Tensor],
    bounds: list[tuple[float, float] | None],
    iterations: int,
) -> tuple[list[torch.Tensor], float]:
    """Minimise `loss` from `start`; (the tensors at the minimum, its value).

    bounds: one pair for all entries of a tensor, or None. A loss that is not finite, or that fails
    for want of a Cholesky factor, counts as a step too far.
    """
    shapes = [tensor.shape for tensor in start]
    limits = [
        pair or (None, None)
        for tensor, pair in zip(start, bounds, strict=True)
        for _ in range(tensor.numel())
    ]
    sizes = [tensor.numel() for tensor in start]

    def split(vector: torch.Tensor) -> list[torch.Tensor]:
        parts = vector.split(sizes)
        return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]

    def evaluate(vector: np.ndarray) -> tuple[float, np.ndarray]:
        point = torch.tensor(vector, requires_grad=True)
        try:
            with torch.enable_grad():
                value = loss(split(point))
        except torch.linalg.LinAlgError:
            return 1e12, np.zeros_like(vector)
        (gradient,) = torch.autograd.grad(value, point)
        if not (torch.isfinite(value) and torch.isfinite(gradient).all()):
            return 1e12, np.zeros_like(vector)
        return value.item(), gradient.numpy()

    first = torch.cat([tensor.detach().reshape(-1) for tensor in start]).numpy()
    found = minimize(
        evaluate,
        first,
        jac=True,
        method="L-BFGS-B",
        bounds=limits,
        options={"maxiter": iterations, "maxfun": 2 * iterations},
    )
    return split(torch.as_tensor(found.x)), float(found.fun)
