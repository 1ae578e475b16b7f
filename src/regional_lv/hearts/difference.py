"""What simulations of one heart differ by from what the emulator of any heart says of it.

The emulator's errors about one heart, and what its segment table or its sectors leave open, are
smooth functions of the heart's inputs. They are a process of their own, learnt from simulations of
this heart, that is added (Kennedy and O'Hagan 2000, doi 10.1093/biomet/87.1.1).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch

from regional_lv.emulators.base import Prediction
from regional_lv.emulators.finer import process_of
from regional_lv.emulators.gradient_gp import GradientGP
from regional_lv.emulators.output_scale import OutputScale
from regional_lv.inputs.coordinates import Coordinates

Outputs = tuple[torch.Tensor, torch.Tensor]
"""Outputs (n, D), and their derivatives (n, D, k)."""


@dataclass(frozen=True)
class Difference:
    """`process` of simulated less emulated outputs on their `scale`, over the k inputs x of a
    heart's study."""

    scale: OutputScale
    process: GradientGP

    @classmethod
    def of(
        cls,
        x: torch.Tensor,
        emulated: Outputs,
        simulated: Outputs,
        coordinates: Coordinates,
        outputs: Sequence[str],
        settings: Mapping,
        seed: int,
    ) -> "Difference":
        """Learnt from n simulations at x (n, k); settings: of the emulator.

        Raises InputError for too few of them, numbers that are not finite, and what no volume or
        strain can be.
        """
        scale = OutputScale.of(outputs, coordinates)
        changes = _between(scale, x, emulated, simulated)
        return cls(scale, process_of(x, changes, coordinates, outputs, settings, seed))

    def condition(self, x: torch.Tensor, emulated: Outputs, simulated: Outputs) -> "Difference":
        """The same given further simulations."""
        changes = _between(self.scale, x, emulated, simulated)
        given = (each.numpy() for each in (x, *changes))
        return Difference(self.scale, self.process.condition(*given))

    def mean(self, x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        """Outputs (M, D) at x (M, k), of emulated ones y (M, D)."""
        v = self.scale.of_outputs(y, x) + self.process.predict_mean(x)
        return self.scale.outputs(v, x)

    def linearise(self, x: torch.Tensor, y: torch.Tensor, slopes: torch.Tensor) -> Outputs:
        """The same with derivatives, of emulated y (M, D) and `slopes` (M, D, k)."""
        v = self.scale.of_outputs(y, x)
        added, its_slopes = self.process.linearise(x)
        slopes = self.scale.to_scale(slopes, v, x) + its_slopes
        return self.scale.outputs(v + added, x), self.scale.from_scale(slopes, v + added, x)

    def predict(self, x: torch.Tensor, y: torch.Tensor) -> Prediction:
        """`mean`, with the covariance (M, D, D) of the difference."""
        found = self.process.predict(x)
        v = self.scale.of_outputs(y, x) + found.mean
        by_v, _ = self.scale.slopes(v, x)
        covariance = by_v[:, :, None] * found.covariance * by_v[:, None]
        return Prediction(self.scale.outputs(v, x), self.process.jacobian_factor * covariance)

    def select(self, outputs: Sequence[str]) -> "Difference":
        """For some outputs."""
        at = torch.tensor([self.process.outputs.index(name) for name in outputs])
        return Difference(self.scale.select(at), self.process.select(outputs))


def _between(scale: OutputScale, x: torch.Tensor, emulated: Outputs, simulated: Outputs) -> Outputs:
    """Simulated less emulated, on the scale."""
    (y, by_x), (above, above_by_x) = emulated, simulated
    v, above_v = scale.of_outputs(y, x), scale.of_outputs(above, x)
    return above_v - v, scale.to_scale(above_by_x, above_v, x) - scale.to_scale(by_x, v, x)
