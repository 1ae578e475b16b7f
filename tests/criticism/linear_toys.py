"""Hearts whose outputs are linear in their inputs, and fits of their models."""

import numpy as np
import torch

from regional_lv.channels import Channels
from regional_lv.criticism.linear_model import LinearModel
from regional_lv.inference.evidence import fit
from regional_lv.inference.noise import Noise
from regional_lv.inference.observed import Observed
from regional_lv.inference.potential import Potential
from tests.inference.toys import known_noise, linear, toy_inputs

NOISE = 0.1


FEW = Channels.of(("volume", "circumferential", "radial"))
HEART = Observed.one(Channels.of())


def inferred_noise(channels, unit=NOISE) -> Noise:
    """An unknown scale for each quantity but the volume, whose noise is `unit`."""
    volume = torch.as_tensor(channels.of_quantity("volume"))
    groups = {
        quantity: torch.as_tensor(np.where(channels.of_quantity(quantity), unit, 0.0))
        for quantity in channels.quantities
        if quantity != "volume"
    }
    return Noise(torch.where(volume, unit, 0.0).double(), groups, 10.0)


class Study:
    """Data sets of one heart, and models of them."""

    def __init__(self, inputs, noise=None, observed=HEART, seed=0, error=0.03):
        self.inputs, self.observed = inputs, observed
        self.slopes, self.emulator = linear(inputs, len(observed.names), seed, error=error)
        self.noise = noise or known_noise(len(observed.names), NOISE)
        sds = [role.sd if role.kind == "measured" else 0.0 for role in inputs.roles]
        self.sds = torch.tensor(sds, dtype=torch.float64)

    def data(self, truth, count: int, seed: int) -> torch.Tensor:
        """(count, D), drawn at inputs (K,); measured ones vary about theirs with their sds."""
        generator = torch.Generator().manual_seed(seed)
        d = len(self.slopes)
        x, own, errors = (
            torch.randn(count, n, generator=generator, dtype=torch.float64)
            for n in (len(self.inputs), d, d)
        )
        x = torch.as_tensor(np.asarray(truth, dtype=float)) + x * self.sds
        half = torch.linalg.cholesky(self.emulator.error)
        return x @ self.slopes.mT + NOISE * own + errors @ half.mT

    def model(self, y, members=()) -> LinearModel:
        """Of the suspected inputs `members`, fitted to y (D,)."""
        potential = Potential(self.emulator, self.inputs, y, self.noise, observed=self.observed)
        x, zero = potential.nominal[None], torch.zeros(1).double()
        free = potential.free(members)[None]
        fitted = fit(potential, free, zero, x, potential.settle(x, zero), 60, 1e-9)
        return LinearModel.of(potential, fitted)


def heart_inputs(measured=(0.1, 0.1), suspected=6, half=1.0, ends=()):
    """Ten inferred inputs, then the suspected ones, then the measured ones."""
    return toy_inputs(10, measured, suspected, half, ends)
