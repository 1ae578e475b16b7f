"""What the emulator's outputs have to do with a wall whose surfaces are known, where it has seen
the segment table that describes them (`geometry.described`).

By the table, parts of segments have other volumes: its base is flat, its wall does not thin there,
and it changes otherwise within a segment. What that does to an output is about linear in the
logarithms of these volumes (`shape_of`), with slopes that are linear in those of the stiffness
(`stiffness_of`), for all segments of a level alike.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pandas as pd
import torch

from regional_lv.aha import LEVELS, beside, level_of
from regional_lv.channels import Channels
from regional_lv.data import path
from regional_lv.geometry.described import HALVES
from regional_lv.inputs.space import Inputs
from regional_lv.inputs.stiffness import StiffnessInputs

BY_SURFACES = path("described_surfaces.csv")
"""Of the outputs of a quantity and level, what they are by the segment table less what they are by
the surfaces: slopes with respect to `OF_SHAPE` (`by` is `ONE`), and by how much these grow with
each of the logarithms `stiffness_of`. Of `SHARES`, shares of what the table gives. `sd` is the root
mean square of what is left of hearts that this is not learnt from. Of twelve real hearts (MESA) at
twelve stiffnesses each, and of 40 drawn ones (`verification.shapes`) at six. Written by
`benchmarks/described_surfaces.py`."""

ONE = "one"

SHARES = ("volume", "radial")
"""What surfaces change in proportion to its size; other strains, alike at any size."""

PLACES = ("own", "within", "level", "below", "above", "around", "around_above")
FACTORS = ("C_a", "C_b")
OF_SHAPE = tuple(f"{place}_{half}" for place in PLACES for half in HALVES)

BELOW = {s: s + 6 for s in LEVELS["basal"]}
BELOW |= {7: 13, 8: 14, 9: 14, 10: 15, 11: 16, 12: 16}
BELOW |= dict.fromkeys(LEVELS["apical"], LEVELS["apex"][0])
"""The segment under each one."""


def shape_of(log_volumes: np.ndarray, segment: int | None) -> np.ndarray:
    """`OF_SHAPE` (28,), of `geometry.described.log_volumes` (17, 8): of a segment, how that changes
    within it, the mean of its level, the segment below, those above it, and how that changes around
    the axis from one neighbour to the other, in its level and in that above; of the whole heart,
    means of the four levels."""
    halves, within = np.hsplit(log_volumes, 2)
    none = np.zeros(len(HALVES))

    def mean(rows: Iterable[np.ndarray]) -> np.ndarray:
        return np.mean([*rows] or [none], axis=0)

    def of(segments: Iterable[int]) -> np.ndarray:
        return mean(halves[s - 1] for s in segments)

    def around(of_level: int) -> np.ndarray:
        after, before = beside(of_level)
        return (halves[after - 1] - halves[before - 1]) / 2

    if segment is None:
        levels = [of(LEVELS[name]) for name in LEVELS]
        return np.concatenate([*levels, *[none] * (len(PLACES) - len(levels))])
    above = [s for s, other in BELOW.items() if other == segment]
    below = [BELOW[segment]] if segment in BELOW else []
    places = (of([segment]), within[segment - 1], of(LEVELS[level_of(segment)]))
    return np.concatenate(
        [*places, of(below), of(above), around(segment), mean(map(around, above))]
    )


def stiffness_of(zones: Mapping[str, Sequence[int]], segment: int | None) -> dict[str, np.ndarray]:
    """Weights (2 Z,) of the logarithms of the zones' C_a and C_b, zone by zone, in the mean of all
    zones; of a segment, also in its zone's, in the mean of its neighbours' and in what the next one
    has more than the one before."""

    def of(one: int) -> np.ndarray:
        return np.array([float(one in at) for at in zones.values()])

    means = {"mean": np.full(len(zones), 1 / len(zones))}
    if segment is not None:
        after, before = map(of, beside(segment))
        means |= {"own": of(segment), "beside": (after + before) / 2, "across": after - before}
    return {
        f"{factor}_{name}": np.kron(weights, own)
        for name, weights in means.items()
        for factor, own in zip(FACTORS, np.eye(2), strict=True)
    }


@cache
def _table() -> pd.DataFrame:
    table = pd.read_csv(BY_SURFACES, keep_default_na=False)
    return table.set_index(["quantity", "level", "by"]).sort_index()


@dataclass(frozen=True)
class BySurfaces:
    """Outputs (D,) of a heart by its surfaces, of those by its table.

    relative (D,): of which outputs differences are shares of what the table gives. shift (D,);
    by_log (D, S): about the logarithms of the emulator's inputs at the places `at` (S,). sd (D,):
    of what is not known.
    """

    relative: torch.Tensor
    shift: torch.Tensor
    by_log: torch.Tensor
    at: torch.Tensor
    sd: torch.Tensor

    @classmethod
    def of(cls, channels: Channels, known: Inputs, log_volumes: np.ndarray) -> "BySurfaces":
        """known: the emulator's inputs. log_volumes (17, 8): of `geometry.described`."""
        stiffness = StiffnessInputs.from_spec(known.base["parameters"])
        at = [k for k, name in enumerate(stiffness.names) if name in known.names]
        shift, by_log, sd = [], [], []
        for channel in channels:
            rows = _table().loc[channel.quantity, channel.level]
            slopes = rows[list(OF_SHAPE)] @ shape_of(log_volumes, channel.segment)
            weights = stiffness_of(stiffness.zones, channel.segment)
            shift.append(slopes[ONE])
            by_log.append(sum(slopes[by] * weight[at] for by, weight in weights.items()))
            sd.append(rows.loc[ONE, "sd"])
        return cls(
            torch.tensor([channel.quantity in SHARES for channel in channels]),
            torch.tensor(shift),
            torch.as_tensor(np.stack(by_log)),
            torch.tensor([known.names.index(stiffness.names[k]) for k in at]),
            torch.tensor(sd),
        )

    def correction(self, there: torch.Tensor) -> torch.Tensor:
        """Outputs by the table less those by the surfaces (M, D), as shares of the former where
        they are `relative`, at the emulator's inputs (M, E)."""
        return self.shift + there[:, self.at].log() @ self.by_log.T

    def __call__(self, y: torch.Tensor, there: torch.Tensor) -> torch.Tensor:
        """Outputs (M, D) by the surfaces, of those by the table."""
        return y - self.correction(there) * self._size(y)

    def slopes(self, y: torch.Tensor, slopes: torch.Tensor, there: torch.Tensor) -> torch.Tensor:
        """What becomes of the derivatives (M, D, E) of outputs by the table."""
        found = slopes * self.factor(there)[..., None]
        by_log = self._size(y)[..., None] * self.by_log
        found[:, :, self.at] -= by_log / there[:, None, self.at]
        return found

    def factor(self, there: torch.Tensor) -> torch.Tensor:
        """What errors of outputs by the table are multiplied by, (M, D)."""
        correction = self.correction(there)
        return torch.where(self.relative, 1 - correction, torch.ones_like(correction))

    def unknown(self, y: torch.Tensor) -> torch.Tensor:
        """Standard deviations (M, D) of what the table leaves open."""
        return self.sd * self._size(y)

    def _size(self, y: torch.Tensor) -> torch.Tensor:
        """What differences are in units of, (M, D)."""
        return torch.where(self.relative, y, torch.ones_like(y))

    def select(self, kept: Sequence[int]) -> "BySurfaces":
        """For some of the outputs, by place."""
        rows = {name: getattr(self, name)[kept] for name in ("relative", "shift", "by_log", "sd")}
        return replace(self, **rows)
