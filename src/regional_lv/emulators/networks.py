"""Feed-forward networks: a plain list of layers, and their training as regressions."""

import copy
import itertools
import logging
import math

import torch

from regional_lv.emulators.reduced import held_out
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

BATCH = 64
HELD_OUT = 0.1
CHECKS = 40
"""How often the held-out error is looked at, evenly over the epochs."""

Layers = list[tuple[torch.Tensor, torch.Tensor]]
"""Weights (..., in, out) and biases (..., 1, out) of each layer."""


def forward(layers: Layers, x: torch.Tensor) -> torch.Tensor:
    """Outputs (..., M, K) at `x` (..., M, P): SiLU between the layers, none after the last.

    Smooth where the paper's networks have corners (ReLU): samplers follow the derivative.
    """
    for weight, bias in layers[:-1]:
        x = torch.nn.functional.silu(x @ weight + bias)
    weight, bias = layers[-1]
    return x @ weight + bias


def initial(sizes: list[int], seed: int) -> Layers:
    """Random layers of the widths `sizes`, inputs first: what goes through keeps its variance."""
    generator = torch.Generator().manual_seed(derive(seed, "weights"))
    layers = []
    for i, (fan_in, fan_out) in enumerate(itertools.pairwise(sizes)):
        # SiLU halves the second moment of what comes out of a layer.
        scale = math.sqrt((1 if i == 0 else 2) / fan_in)
        weight = scale * torch.randn(fan_in, fan_out, generator=generator)
        layers.append((weight, torch.zeros(1, fan_out)))
    return layers


def train(
    x: torch.Tensor, z: torch.Tensor, hidden: list[int], epochs: int, rate: float, seed: int
) -> tuple[Layers, torch.Tensor]:
    """Least-squares network from inputs (N, P) to outputs (N, K), and its held-out errors (H, K).

    Adam (AdamW without decay) on mini-batches, the rate falling to zero along a cosine; a tenth of
    the rows is held out, and the state with the least error on it is kept. In single precision:
    the noise of mini-batches is far larger.
    """
    generator = torch.Generator().manual_seed(derive(seed, "batches"))
    inside, outside = held_out(len(x), HELD_OUT, seed)
    x, z = x.float(), z.float()
    layers = initial([x.shape[1], *hidden, z.shape[1]], seed)
    parameters = [parameter for layer in layers for parameter in layer]
    for parameter in parameters:
        parameter.requires_grad_(True)
    optimiser = torch.optim.Adam(parameters, lr=rate)
    batches = -(-len(inside) // BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, max_lr=rate, total_steps=epochs * batches, pct_start=0.1
    )
    best, kept = float("inf"), None
    for epoch in range(epochs):
        order = inside[torch.randperm(len(inside), generator=generator)]
        for rows in order.split(BATCH):
            optimiser.zero_grad()
            (forward(layers, x[rows]) - z[rows]).square().mean().backward()
            optimiser.step()
            schedule.step()
        if (epoch + 1) % max(1, epochs // CHECKS) == 0 or epoch + 1 == epochs:
            with torch.no_grad():
                error = (forward(layers, x[outside]) - z[outside]).square().mean().item()
            if error < best:
                best, kept = error, copy.deepcopy([p.detach().double() for p in parameters])
    kept = list(zip(kept[::2], kept[1::2], strict=True))
    log.info("network: held-out mean squared error %.5f", best)
    return kept, forward(kept, x[outside].double()) - z[outside].double()
