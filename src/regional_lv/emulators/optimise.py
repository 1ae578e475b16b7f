"""L-BFGS, deterministic; for losses of the whole data at hand."""

import logging
from collections.abc import Callable, Iterable, Mapping

import numpy as np
import torch
from scipy.optimize import minimize
from torch.nn.utils import parameters_to_vector, vector_to_parameters

log = logging.getLogger(__name__)

TOO_FAR = 1e12
"""Loss of a step that cannot be evaluated."""


def fit(
    parameters: Iterable[tuple[str, torch.nn.Parameter]],
    loss: Callable[[], torch.Tensor],
    bounds: Mapping[str, tuple[float, float]],
    iterations: int,
) -> float:
    """Minimise `loss` over the parameters of a module, in place; the value at the minimum.

    parameters: as `named_parameters` of a module gives them. bounds: by the last part of a name
    (`raw_lengthscale`), for all entries of the parameter; what has none is free. A loss that is not
    finite, or that fails for want of a Cholesky factor, counts as a step too far; where it is
    that from the start, the parameters stay as they are, with a warning.
    """
    names, tensors = zip(*parameters, strict=True)
    limits = [
        bounds.get(name.rpartition(".")[2], (None, None))
        for name, tensor in zip(names, tensors, strict=True)
        for _ in range(tensor.numel())
    ]

    def put(vector: np.ndarray) -> None:
        with torch.no_grad():
            vector_to_parameters(torch.as_tensor(vector.copy()), tensors)

    def evaluate(vector: np.ndarray) -> tuple[float, np.ndarray]:
        put(vector)
        try:
            with torch.enable_grad():
                value = loss()
        except torch.linalg.LinAlgError:
            return TOO_FAR, np.zeros_like(vector)
        slopes = torch.autograd.grad(value, tensors)
        gradient = torch.cat([slope.reshape(-1) for slope in slopes])
        if not (torch.isfinite(value) and torch.isfinite(gradient).all()):
            return TOO_FAR, np.zeros_like(vector)
        return value.item(), gradient.numpy()

    first = parameters_to_vector(tensors).detach().numpy()
    low, high = (
        np.array([pair[i] if pair[i] is not None else sign * np.inf for pair in limits])
        for i, sign in ((0, -1), (1, 1))
    )
    found = minimize(
        evaluate,
        np.clip(first, low, high),
        jac=True,
        method="L-BFGS-B",
        bounds=limits,
        options={"maxiter": iterations, "maxfun": 2 * iterations},
    )
    if found.fun >= TOO_FAR:
        log.warning("the loss cannot be evaluated where its parameters start; they stay there")
    put(found.x)
    return float(found.fun)
