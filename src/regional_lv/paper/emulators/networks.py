"""Feed-forward networks, and their training as regressions."""

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


def build(sizes: list[int], seed: int = 0) -> torch.nn.Sequential:
    """Random layers of the widths `sizes`, inputs first, which pass on most of the variance: 0.7 of
    it after one hidden layer, 0.3 after three.

    SiLU between the layers: smooth where the paper's networks have corners (ReLU), as samplers
    follow the derivative.
    """
    generator = torch.Generator().manual_seed(derive(seed, "weights"))
    layers: list[torch.nn.Module] = []
    for widths in itertools.pairwise(sizes):
        linear = torch.nn.Linear(*widths)
        # As for ReLU, which halves a second moment (He et al. 2015); SiLU leaves 0.36 of it.
        scale = math.sqrt((2 if layers else 1) / widths[0])
        linear.weight.data = (scale * torch.randn(*widths, generator=generator)).T.contiguous()
        linear.bias.data.zero_()
        layers += [linear, torch.nn.SiLU()]
    return torch.nn.Sequential(*layers[:-1])


def train(
    x: torch.Tensor, z: torch.Tensor, hidden: list[int], epochs: int, rate: float, seed: int
) -> tuple[torch.nn.Sequential, torch.Tensor]:
    """Least-squares network from inputs (N, P) to outputs (N, K), and its held-out errors (H, K).

    Adam (AdamW without decay) on mini-batches, the rate falling to zero along a cosine; a tenth of
    the rows is held out, and the state with the least error on it is kept. In single precision:
    the noise of mini-batches is far larger.
    """
    generator = torch.Generator().manual_seed(derive(seed, "batches"))
    inside, outside = held_out(len(x), HELD_OUT, seed)
    targets = z[outside]
    x, z = x.float(), z.float()
    network = build([x.shape[1], *hidden, z.shape[1]], seed)
    optimiser = torch.optim.Adam(network.parameters(), lr=rate)
    batches = -(-len(inside) // BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, max_lr=rate, total_steps=epochs * batches, pct_start=0.1
    )
    best, kept = float("inf"), None
    for epoch in range(epochs):
        order = inside[torch.randperm(len(inside), generator=generator)]
        for rows in order.split(BATCH):
            optimiser.zero_grad()
            torch.nn.functional.mse_loss(network(x[rows]), z[rows]).backward()
            optimiser.step()
            schedule.step()
        if (epoch + 1) % max(1, epochs // CHECKS) == 0 or epoch + 1 == epochs:
            with torch.no_grad():
                error = torch.nn.functional.mse_loss(network(x[outside]), z[outside]).item()
            if error < best:
                best, kept = error, copy.deepcopy(network.state_dict())
    network.load_state_dict(kept)
    network.double().requires_grad_(False)
    log.info("network: held-out mean squared error %.5f", best)
    return network, network(x[outside].double()) - targets
