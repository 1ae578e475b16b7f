"""Several hearts side by side as one, so that what a simulator has wrong may be common to them."""

from dataclasses import replace

import torch

from regional_lv.criticism.model import Model

MOST_CHANNELS = 1500
"""Of all hearts together: their covariance has as many rows."""


class Together(Model):
    """The same model, with the S x D channels of all hearts as those of one, (1, S D).

    hearts: the model, of known noise. common: covariance (D, D) of a discrepancy that is the same
    in every heart.
    """

    def __init__(self, hearts: Model, common: torch.Tensor):
        own = hearts.observations
        observations = replace(
            own,
            subjects=("together",),
            y=own.y.reshape(1, -1),
            present=own.present.reshape(1, -1),
            noise=replace(own.noise, sd=own.noise.sd.reshape(1, -1)),
        )
        super().__init__(observations, hearts.emulator, hearts.layout)
        present = observations.present[0]
        count = len(own.subjects)
        both = present[:, None] & present
        self._hearts, self._common = hearts, torch.where(both, common.repeat(count, count), 0.0)

    @staticmethod
    def possible(model: Model) -> bool:
        """Whether there are several hearts, and not too many channels."""
        o = model.observations
        return len(o.subjects) > 1 and not o.noise.groups and o.y.numel() <= MOST_CHANNELS

    def mean(self, x: torch.Tensor) -> torch.Tensor:
        return self._hearts.mean(x).flatten(1)[:, None]

    def linearise(
        self, x: torch.Tensor, active: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        mean, slopes = self._hearts.linearise(x, active)
        return mean.flatten(1)[:, None], slopes.flatten(1, 2)[:, None]

    def settle(self, x: torch.Tensor) -> "Together":
        error = torch.block_diag(*self._hearts.settle(x).error)
        self.error = (error + self._common)[None]
        return self
