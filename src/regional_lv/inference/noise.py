"""Measurement noise: known, or of a scale that is inferred."""

import math
from dataclasses import dataclass, field

import numpy as np
import torch

from regional_lv.emulators.base import Emulator, Prediction
from regional_lv.emulators.reduction import VOLUME
from regional_lv.errors import InputError
from regional_lv.inference.emulated import InputEmulator
from regional_lv.measured.tables import VOLUME_SHARE

LOG_SIGMA_BOUNDS = (-7.0, 3.0)
"""Of the logarithm of a noise scale in units of its sd."""


@dataclass(frozen=True)
class Noise:
    """Measurement noise, independent between outputs.

    sd: (D,) known standard deviations in natural units, 0 where there is none or it is unknown.
    groups: quantity -> (D,) unit of the noise that is unknown there, 0 elsewhere: the noise of an
    output is sigma (one per quantity, the same at all loads, inferred) times its unit, the training
    sd.
    prior_scale: scale of the half-normal prior on each sigma.
    """

    sd: torch.Tensor
    groups: dict[str, torch.Tensor] = field(default_factory=dict)
    prior_scale: float = 1.0

    @classmethod
    def none(cls, emulator: Emulator) -> "Noise":
        """Simulated data: the emulator's error is all there is."""
        return cls(torch.zeros_like(emulator.output_sd))

    @classmethod
    def known(cls, sd: torch.Tensor) -> "Noise":
        """Standard deviations (D,) that come with the data; NaN counts as 0."""
        return cls(torch.nan_to_num(torch.as_tensor(sd, dtype=torch.float64)))

    @classmethod
    def of_subject(
        cls, emulator: InputEmulator, y: np.ndarray, sd: np.ndarray, prior_scale: float
    ) -> "Noise":
        """Of measured values `y` (D,) whose `sd` (D,), in natural units, is NaN where not given.

        Volumes without sd are known to `VOLUME_SHARE`; each other quantity with such channels has
        an unknown scale. Raises InputError for an sd that is not above 0.
        """
        channels = emulator.channels
        volumes = channels.of_quantity(VOLUME)
        known = np.where(volumes & np.isnan(sd), VOLUME_SHARE * np.abs(y), sd)
        for name, value in zip(channels.names, known, strict=True):
            if value <= 0 or np.isinf(value):
                raise InputError(
                    f"{name}: noise of standard deviation {value:g}; give a number above 0 in the "
                    "column sd, or leave it empty"
                )
        unknown = np.isnan(known)
        groups = {
            quantity: torch.where(
                torch.as_tensor(unknown & channels.of_quantity(quantity)), emulator.output_sd, 0.0
            )
            for quantity in channels.quantities
            if unknown[channels.of_quantity(quantity)].any()
        }
        return cls(torch.as_tensor(np.nan_to_num(known)), groups, float(prior_scale))

    @classmethod
    def shared(cls, emulator: Emulator, prior_scale: float) -> "Noise":
        """One unknown scale for all outputs, in training sd: the paper's network."""
        return cls(
            torch.zeros_like(emulator.output_sd),
            {"all": emulator.output_sd.clone()},
            float(prior_scale),
        )

    @property
    def present(self) -> bool:
        """Whether there is any."""
        return bool(self.groups) or bool((self.sd > 0).any())

    @property
    def units(self) -> torch.Tensor:
        """Of all groups, (G, D)."""
        empty = self.sd.new_zeros(0, self.sd.shape[-1])
        return torch.stack([*self.groups.values()]) if self.groups else empty

    def freedom_beside(self, prediction: Prediction) -> float:
        """Degrees of freedom with which the emulator's errors count beside this noise."""
        return math.inf if self.present else prediction.freedom

    def variance(self, log_sigma: torch.Tensor) -> torch.Tensor:
        """Variance of each output, (..., D), at `log_sigma` (..., G)."""
        total = self.sd.square() + log_sigma.new_zeros(*log_sigma.shape[:-1], 1)
        for i, unit in enumerate(self.groups.values()):
            total = total + torch.exp(2 * log_sigma[..., i, None]) * unit.square()
        return total

    def log_prior(self, log_sigma: torch.Tensor) -> torch.Tensor:
        """Log density of the half-normal prior of sigma (not of its logarithm), (...)."""
        s = self.prior_scale
        constant = 0.5 * math.log(2 / math.pi) - math.log(s)
        return (constant - 0.5 * torch.exp(2 * log_sigma) / s**2).sum(-1)
