"""What the emulator's outputs have to do with a wall whose surfaces are known, where it has seen
the segment table that describes them (`geometry.described`).

By the table, halves of segments have other volumes, and its base is flat and its wall does not thin
there. What that does to an output is about linear in the logarithms of these volumes (`shape_of`),
for all segments of a level alike, in how much the basal wall thins, and in the stiffness.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pandas as pd
import torch

from regional_lv.aha import LEVELS, level_of
from regional_lv.channels import Channels
from regional_lv.data import path
from regional_lv.geometry.described import HALVES
from regional_lv.inputs.space import Inputs
from regional_lv.inputs.stiffness import StiffnessInputs

BY_SURFACES = path("described_surfaces.csv")
"""Of each output, what it is by the segment table less what it is by the surfaces, per unit of each
of the `COLUMNS`; `sd` is the root mean square of what is left of hearts that this is not learnt
from. Of twelve real hearts (MESA) at twelve stiffnesses each, and of sixteen drawn ones
(`verification.shapes`) at six; of `SHARES`, shares of what the table gives. Written by
`benchmarks/described_surfaces.py`."""

SHARES = ("volume", "radial")
"""What surfaces change in proportion to its size; other strains, alike at any size."""

PLACES = ("own", "level", "below", "above")
OF_SHAPE = tuple(f"{place}_{half.removesuffix('_ml')}" for place in PLACES for half in HALVES)
OF_STIFFNESS = ("own_C_a", "own_C_b", "mean_C_a", "mean_C_b")
COLUMNS = (*OF_SHAPE, *OF_STIFFNESS, "basal_taper")
"""Of what an output's difference is a linear function: what `shape_of` gives; `taper_of` times
logarithms of the stiffness, of the segment's zone and of the mean of all zones; and `taper_of` the
basal level. Slopes about all but the last one are those of all segments of a level."""

BELOW = {s: s + 6 for s in LEVELS["basal"]}
BELOW |= {7: 13, 8: 14, 9: 14, 10: 15, 11: 16, 12: 16}
BELOW |= dict.fromkeys(LEVELS["apical"], LEVELS["apex"][0])
"""The segment under each one."""


def shape_of(log_halves: np.ndarray, segment: int | None) -> np.ndarray:
    """`OF_SHAPE` (16,), of `geometry.described.log_halves` (17, 4): of a segment, the mean of its
    level, the segment below and those above it; of the whole heart, means of three levels."""
    if segment is None:
        levels = [[s - 1 for s in LEVELS[name]] for name in ("basal", "mid", "apical")]
        means = [log_halves[at].mean(axis=0) for at in levels]
        return np.concatenate([*means, np.zeros(len(HALVES))])
    above = [s for s, other in BELOW.items() if other == segment]
    below = [BELOW[segment]] if segment in BELOW else []
    places = ([segment], LEVELS[level_of(segment)], below, above)
    none = np.zeros((1, len(HALVES)))
    rows = (log_halves[[s - 1 for s in at]] if at else none for at in places)
    return np.concatenate([each.mean(axis=0) for each in rows])


def taper_of(shape: np.ndarray) -> np.ndarray:
    """Of a segment's wall, or of the mean one of the basal level: the lower half beside the upper
    one. shape (..., 16): as of `shape_of`."""
    return shape[..., 1] - shape[..., 0]


def stiffness_of(zones: Mapping[str, Sequence[int]], segment: int | None) -> np.ndarray:
    """Weights (4, 2 Z) of the zones' C_a and C_b, zone by zone, in `OF_STIFFNESS` but for the
    taper; of the whole heart, each is the mean."""
    mean = np.full(len(zones), 1 / len(zones))
    own = mean if segment is None else np.array([float(segment in at) for at in zones.values()])
    return np.concatenate([np.kron(each, np.eye(2)) for each in (own, mean)])


@cache
def _table() -> pd.DataFrame:
    table = pd.read_csv(BY_SURFACES, dtype={"segment": "Int64"})
    return table.set_index(["quantity", table["segment"].fillna(0)])


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
    def of(cls, channels: Channels, known: Inputs, log_halves: np.ndarray) -> "BySurfaces":
        """known: the emulator's inputs. log_halves (17, 4): of `geometry.described`."""
        zones = StiffnessInputs.from_spec(known.base["parameters"]).zones
        stiffness = [f"{factor}_{zone}" for zone in zones for factor in ("C_a", "C_b")]
        at = [k for k, name in enumerate(stiffness) if name in known.names]
        rows = _table().loc[[(channel.quantity, channel.segment or 0) for channel in channels]]
        by_shape, by_log = (rows[list(columns)].to_numpy() for columns in (OF_SHAPE, OF_STIFFNESS))
        segments = [channel.segment for channel in channels]
        shape = np.stack([shape_of(log_halves, segment) for segment in segments])
        weights = np.stack([stiffness_of(zones, segment)[:, at] for segment in segments])
        basal = rows["basal_taper"].to_numpy() * taper_of(shape_of(log_halves, None))
        return cls(
            torch.tensor([channel.quantity in SHARES for channel in channels]),
            torch.as_tensor((by_shape * shape).sum(axis=1) + basal),
            torch.as_tensor(np.einsum("d,df,dfs->ds", taper_of(shape), by_log, weights)),
            torch.tensor([known.names.index(stiffness[k]) for k in at]),
            torch.as_tensor(rows["sd"].to_numpy()),
        )

    def change(self, there: torch.Tensor) -> torch.Tensor:
        """What is subtracted (M, D), at the emulator's inputs (M, E)."""
        return self.shift + there[:, self.at].log() @ self.by_log.T

    def __call__(self, y: torch.Tensor, there: torch.Tensor) -> torch.Tensor:
        """Outputs (M, D) by the surfaces, of those by the table."""
        return y - self.change(there) * self._size(y)

    def slopes(self, y: torch.Tensor, slopes: torch.Tensor, there: torch.Tensor) -> torch.Tensor:
        """What becomes of the derivatives (M, D, E) of outputs by the table."""
        found = slopes * self.factor(there)[..., None]
        by_log = self._size(y)[..., None] * self.by_log
        found[:, :, self.at] -= by_log / there[:, None, self.at]
        return found

    def factor(self, there: torch.Tensor) -> torch.Tensor:
        """What errors of outputs by the table are multiplied by, (M, D)."""
        change = self.change(there)
        return torch.where(self.shares, 1 - change, torch.ones_like(change))

    def unknown(self, y: torch.Tensor) -> torch.Tensor:
        """Standard deviations (M, D) of what the table leaves open."""
        return self.sd * self._size(y)

    def _size(self, y: torch.Tensor) -> torch.Tensor:
        """What differences are in units of, (M, D)."""
        return torch.where(self.shares, y, torch.ones_like(y))

    def select(self, kept: Sequence[int]) -> "BySurfaces":
        """For some of the outputs, by place."""
        rows = {name: getattr(self, name)[kept] for name in ("shares", "shift", "by_log", "sd")}
        return replace(self, **rows)
