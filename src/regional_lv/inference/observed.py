"""What the outputs of a posterior are, of one heart or of several."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from regional_lv.channels import Channel, Channels


@dataclass(frozen=True)
class Observed:
    """The D outputs that were observed, heart by heart.

    names (D,), of several hearts with the heart's before it; channels (D,); heart (D,), the number
    of its heart. hearts (S,): their names.

    Hearts err independently: the covariance of several comes as blocks (M or 1, S, U, U) over the
    U channels of all hearts, zero where a channel is absent, and that of one heart as it is, (M or
    1, D, D). present (S, U): which channels each heart has; None for one heart. Outputs (..., D)
    are (..., S, U) then when they are `split`, and the same for one heart.
    """

    names: tuple[str, ...]
    channels: tuple[Channel, ...]
    heart: np.ndarray
    hearts: tuple[str, ...] = ("",)
    present: torch.Tensor | None = None

    @classmethod
    def one(cls, channels: Channels) -> "Observed":
        """Those of one heart."""
        return cls(channels.names, tuple(channels), np.zeros(len(channels), dtype=int))

    @classmethod
    def unnamed(cls, count: int) -> "Observed":
        """Outputs that are no channels."""
        names = tuple(f"output {number}" for number in range(count))
        return cls(names, (), np.zeros(count, dtype=int))

    @classmethod
    def several(cls, hearts: Mapping[str, Sequence[str]], channels: Channels) -> "Observed":
        """Those of `hearts`, by name, with the names of the channels of each; `channels`: the U of
        all."""
        present = np.array([[name in own for name in channels.names] for own in hearts.values()])
        heart, place = np.nonzero(present)
        of_heart = [*hearts]
        return cls(
            tuple(f"{of_heart[s]}: {channels[u].name}" for s, u in zip(heart, place, strict=True)),
            tuple(channels[u] for u in place),
            heart,
            tuple(hearts),
            torch.as_tensor(present),
        )

    @property
    def count(self) -> int:
        """Of the hearts."""
        return len(self.hearts)

    def split(self, values: torch.Tensor, absent: float = 0.0) -> torch.Tensor:
        """(..., D) by heart, (..., S, U), with the value `absent` where a channel is."""
        if self.present is None:
            return values
        found = values.new_full((*values.shape[:-1], *self.present.shape), absent)
        found[..., self.present] = values
        return found

    def join(self, values: torch.Tensor) -> torch.Tensor:
        """(..., D) of what is split, (..., S, U)."""
        return values if self.present is None else values[..., self.present]

    def columns(self, values: torch.Tensor) -> torch.Tensor:
        """Derivatives (..., D, K) by heart, (..., S, U, K)."""
        return self.split(values.mT).movedim(values.dim() - 2, -1)

    def dense(self, blocks: torch.Tensor) -> torch.Tensor:
        """(M, D, D) of blocks, for few rows."""
        if self.present is None:
            return blocks
        own = [[b[p][:, p] for b, p in zip(row, self.present, strict=True)] for row in blocks]
        return torch.stack([torch.block_diag(*parts) for parts in own])
