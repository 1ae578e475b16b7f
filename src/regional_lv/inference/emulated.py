"""The emulator over all inputs as a posterior sees it (`potential.Emulated`)."""

from collections.abc import Sequence
from typing import Protocol, Self

import torch

from regional_lv.channels import Channels
from regional_lv.emulators.base import Prediction
from regional_lv.inputs.coordinates import Coordinates
from regional_lv.inputs.evaluation import AllInputs
from regional_lv.inputs.space import Inputs


class InputEmulator(Protocol):
    """An emulator of D outputs over the k simulated inputs of a study, as an `Emulator` is:
    `JointGP`, or the one of any heart in the coordinates of one."""

    @property
    def outputs(self) -> tuple[str, ...]: ...
    @property
    def channels(self) -> Channels: ...
    @property
    def output_sd(self) -> torch.Tensor: ...
    @property
    def coordinates(self) -> Coordinates: ...
    @property
    def jacobian_factor(self) -> float: ...
    def select(self, outputs: Sequence[str]) -> Self: ...
    def predict(self, theta: torch.Tensor) -> Prediction: ...
    def predict_mean(self, theta: torch.Tensor) -> torch.Tensor: ...
    def linearise(self, theta: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]: ...


class EmulatedInputs:
    """D observed outputs at scaled coordinates x (M, K) of all inputs of a study, closed forms and
    directions among them.

    emulator: of the simulated inputs and the observed channels. inputs: all K.
    """

    def __init__(self, emulator: InputEmulator, inputs: Inputs):
        self.emulator, self.inputs, self.coordinates = emulator, inputs, inputs.coordinates
        self._outputs = AllInputs(inputs, emulator.channels)

    def mean(self, x: torch.Tensor) -> torch.Tensor:
        """(M, D), natural units."""
        return self._outputs.values(self.emulator.predict_mean, self.coordinates.natural(x))

    def linearise(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean (M, D) and its derivatives (M, D, K) with respect to the scaled coordinates."""
        return self._outputs(self.emulator.linearise, self.coordinates.natural(x))

    @property
    def simulated_names(self) -> tuple[str, ...]:
        """Of the inputs that the simulator has."""
        return self.emulator.coordinates.names

    def of_each(self, x: torch.Tensor) -> torch.Tensor:
        """Scaled coordinates (M, 1, K): of the only heart."""
        return x[:, None]

    def simulated_at(self, x: torch.Tensor) -> torch.Tensor:
        """Values (M, k) of the simulated inputs at which most of the channels are looked up."""
        return self._outputs.most_looked_up(self.coordinates.natural(x))

    @torch.no_grad()
    def predict(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean (M, D) and the covariance (M, D, D) of its errors."""
        values = self.coordinates.natural(x)
        return self._outputs.predict(self._predict, self.emulator.predict_mean, values)

    def _predict(self, at: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        found = self.emulator.predict(at)
        return found.mean, self.emulator.jacobian_factor * found.covariance
