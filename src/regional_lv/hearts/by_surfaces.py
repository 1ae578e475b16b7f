"""What the emulator's outputs have to do with a wall whose surfaces are known, where it has seen
the segment table that describes them (`geometry.described`).

By the table, a heart's segments have walls of other volumes, and its base is flat: outputs differ
by what all hearts have, by what goes with a segment's own wall, and by what goes with the
stiffness. These are known from real hearts (`BY_SURFACES`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pandas as pd
import torch

from regional_lv.channels import Channels
from regional_lv.data import path
from regional_lv.inputs.space import Inputs

BY_SURFACES = path("described_surfaces.csv")
"""Of each output, what it is by the segment table less what it is by the surfaces: `shift`, of a
heart whose wall is the table's, at stiffnesses of 1; `by_wall`, its change with the logarithm of
the segment's wall (`geometry.described.log_walls`); by name of the stiffness, its change with the
logarithm of that; and `sd`, the root mean square of what is left of a heart that none of these are
learnt from. Of twelve real hearts (MESA), at twelve stiffnesses each; of `SHARES`, shares of what
the table gives. Written by `benchmarks/described_surfaces.py`."""

SHARES = ("volume", "radial")
"""What surfaces change in proportion to its size; other strains, alike at any size."""


@cache
def _table() -> pd.DataFrame:
    table = pd.read_csv(BY_SURFACES, dtype={"segment": "Int64"})
    return table.set_index(["quantity", table["segment"].fillna(0)]).drop(columns="segment")


@dataclass(frozen=True)
class BySurfaces:
    """Outputs (D,) of a heart by its surfaces, of those by its table.

    shares (D,): of which outputs differences are shares. shift (D,); by_log (D, S): about the
    logarithms of the emulator's inputs at the places `at` (S,). sd (D,): of what is not known.
    """

    shares: torch.Tensor
    shift: torch.Tensor
    by_log: torch.Tensor
    at: torch.Tensor
    sd: torch.Tensor

    @classmethod
    def of(cls, channels: Channels, known: Inputs, log_walls: np.ndarray) -> "BySurfaces":
        """known: the emulator's inputs. log_walls (17,): as `geometry.described.log_walls`."""
        keys = [(channel.quantity, channel.segment or 0) for channel in channels]
        rows = _table().loc[keys]
        walls = np.array([log_walls[segment - 1] if segment else 0.0 for _, segment in keys])
        stiffness = [name for name in known.names if name in rows]
        return cls(
            torch.tensor([quantity in SHARES for quantity, _ in keys]),
            torch.as_tensor((rows["shift"] + rows["by_wall"] * walls).to_numpy()),
            torch.as_tensor(rows[stiffness].to_numpy()),
            torch.tensor([known.names.index(name) for name in stiffness]),
            torch.as_tensor(rows["sd"].to_numpy()),
        )

    def change(self, there: torch.Tensor) -> torch.Tensor:
        """What is subtracted (M, D), at the emulator's inputs (M, E)."""
        return self.shift + there[:, self.at].log() @ self.by_log.T

    def __call__(self, y: torch.Tensor, there: torch.Tensor) -> torch.Tensor:
        """Outputs (M, D) by the surfaces, of those by the table."""
        change = self.change(there)
        return torch.where(self.shares, y * (1 - change), y - change)

    def slopes(self, y: torch.Tensor, slopes: torch.Tensor, there: torch.Tensor) -> torch.Tensor:
        """What becomes of the derivatives (M, D, E) of outputs by the table."""
        found = slopes * self.factor(there)[..., None]
        size = torch.where(self.shares, y, torch.ones_like(y))
        found[:, :, self.at] -= size[..., None] * self.by_log / there[:, None, self.at]
        return found

    def factor(self, there: torch.Tensor) -> torch.Tensor:
        """What errors of outputs by the table are multiplied by, (M, D)."""
        change = self.change(there)
        return torch.where(self.shares, 1 - change, torch.ones_like(change))

    def unknown(self, y: torch.Tensor) -> torch.Tensor:
        """Standard deviations (M, D) of what the table leaves open."""
        return self.sd * torch.where(self.shares, y, torch.ones_like(y))

    def select(self, kept: torch.Tensor | Sequence[int]) -> "BySurfaces":
        """For some of the outputs, by place."""
        rows = {name: getattr(self, name)[kept] for name in ("shares", "shift", "by_log", "sd")}
        return replace(self, **rows)
