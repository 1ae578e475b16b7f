"""The scale on which an extended model differs from the base model.

Differences are emulated as changes d of the logarithm of the volume, of the logarithmic stretch
that belongs to a strain E of the exponent n, log(1 + n E) / n, and of all other quantities as they
are:

    V' = V exp(d),     E' = ((1 + n E) exp(n d) - 1) / n,     q' = q + d.

Soft walls thin out, their radial strains grow without bound and so do differences of them; changes
of the logarithms stay alike from stiff to soft, and the emulator's errors are two to four times
smaller. Where the effect is another exponent of the strains, little is left to emulate.
"""

import numpy as np
import torch

from regional_lv.channels import Channels

LEAST_STRETCH = 1e-3
"""Least 1 + n E of which a logarithm is taken: emulators that extrapolate may go below."""


class Scale:
    """Of the D `channels`, whose strains have the `exponent` n in the base model.

    Torch and NumPy alike, in natural units.
    """

    def __init__(self, channels: Channels, exponent: float):
        self.channels, self.exponent = channels, float(exponent)
        self.is_strain = channels.is_strain
        self.is_volume = channels.of_quantity("volume")

    def logarithms(
        self, outputs: np.ndarray, sensitivity: np.ndarray, exponent: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Outputs (n, D) on this scale, and their d/dtheta (n, D, P).

        exponent: of the strains among `outputs`.
        """
        power = np.where(self.is_strain, exponent, 1.0)
        stretched = self.is_strain & (power != 0)
        inner = np.where(stretched, 1 + power * outputs, np.where(self.is_volume, outputs, 1.0))
        value = np.where(
            stretched | self.is_volume, np.log(inner) / np.where(stretched, power, 1.0), outputs
        )
        return value, sensitivity / inner[..., None]

    def differences(self, mean, change, exponent) -> tuple[torch.Tensor, torch.Tensor]:
        """Differences (..., D) from outputs `mean` (..., D) whose logarithms change by `change`
        (..., D), and their derivatives about the change; exactly zero where nothing changes.

        exponent: of the strains with the effect: the study's own (float), or (...).
        """
        found, slope = self._differences(mean, change)
        if isinstance(exponent, float) or not self.is_strain.any():
            # The study's own: the effect leaves the measure as it is.
            return found, slope
        n = torch.as_tensor(exponent, dtype=mean.dtype)[..., None]
        strain, own = torch.as_tensor(self.is_strain), torch.full_like(n, self.exponent)
        before = _log_stretch(torch.where(strain, mean, 0.0), self.exponent)
        after = before + change
        other = _strain(after, n) - _strain(before, own)
        return torch.where(strain, other, found), torch.where(strain, torch.exp(n * after), slope)

    def _differences(self, mean, change):
        """With the strains' own exponent: size (exp(power change) - 1) / power."""
        n = self.exponent
        strain, volume = torch.as_tensor(self.is_strain), torch.as_tensor(self.is_volume)
        plain = ~(strain | volume) if n else ~volume
        one = torch.ones_like(mean)
        size = torch.where(volume, mean, torch.where(plain, one, 1 + n * mean))
        power = torch.where(volume | plain, 1.0, n).to(mean.dtype)
        grown = torch.where(plain, change, torch.expm1(power * change) / power)
        slope = torch.where(plain, one, size * torch.exp(power * change))
        return size * grown, slope


def _log_stretch(strain: torch.Tensor, exponent: float) -> torch.Tensor:
    if exponent == 0:
        return strain
    return (1 + exponent * strain).clamp(min=LEAST_STRETCH).log() / exponent


def _strain(log_stretch: torch.Tensor, exponent: torch.Tensor) -> torch.Tensor:
    """(exp(n log l) - 1) / n, and its limit about n = 0."""
    flat = exponent.abs() < 1e-6
    power = torch.where(flat, 1.0, exponent)
    limit = log_stretch * (1 + exponent * log_stretch / 2)
    return torch.where(flat, limit, torch.expm1(power * log_stretch) / power)
