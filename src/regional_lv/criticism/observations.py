"""What was observed of one heart, or of several that are criticised together."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd
import torch

from regional_lv import aha
from regional_lv.emulators.base import Emulator
from regional_lv.errors import InputError
from regional_lv.inference.likelihood import Noise
from regional_lv.measured import read_measured

VOLUME_GROUP = 0
"""Where the volume stands among the segment numbers: it is left out as a group of its own."""


@dataclass(frozen=True)
class Observations:
    """Observed outputs of S hearts, of D different kinds.

    y: (S, D), 0 where absent. present: (S, D). sd: (S, D) known noise, natural units. directions,
    units (G, D) and prior_scale: noise that is inferred, one scale per direction, the same in all
    hearts (`likelihood.Noise`).
    """

    subjects: tuple[str, ...]
    outputs: tuple[str, ...]
    y: torch.Tensor
    present: torch.Tensor
    sd: torch.Tensor
    directions: tuple[str, ...]
    units: torch.Tensor
    prior_scale: float

    @property
    def groups(self) -> dict[int, torch.Tensor]:
        """Segment number (`VOLUME_GROUP` for the volume) -> its channels (D,), where observed."""
        numbers = torch.tensor([segment_or_volume(name) for name in self.outputs])
        seen = numbers[self.present.any(0)]
        return {int(g): numbers == g for g in seen.unique()}

    def apart(self) -> list["Observations"]:
        """Each heart by itself."""
        return [
            replace(self, subjects=(name,), **{k: getattr(self, k)[i : i + 1] for k in _PER_HEART})
            for i, name in enumerate(self.subjects)
        ]

    def with_values(self, y: torch.Tensor) -> "Observations":
        """The same channels with other values (S, D)."""
        return replace(self, y=torch.where(self.present, y, 0.0))


_PER_HEART = ("y", "present", "sd")


def segment_or_volume(output: str) -> int:
    return VOLUME_GROUP if output == "volume_ml" else int(output.split("_")[1])


def observe(
    tables: dict[str, pd.DataFrame], emulator: Emulator, prior_scale: float
) -> Observations:
    """Observations of measured tables (as `read_measured` returns them), by subject.

    Raises InputError if some of several subjects have a known noise and others none.
    """
    tables = {name: table.set_index("output") for name, table in tables.items()}
    outputs = tuple(o for o in emulator.outputs if any(o in t.index for t in tables.values()))
    emulator = emulator.select(outputs)
    y = torch.zeros(len(tables), len(outputs), dtype=torch.float64)
    present, sd = torch.zeros_like(y, dtype=torch.bool), torch.zeros_like(y)
    unknown = set()
    for i, table in enumerate(tables.values()):
        names = [name for name in outputs if name in table.index]
        at = [outputs.index(name) for name in names]
        table = table.loc[names]
        noise = Noise.of_subject(emulator.select(names), table["sd"], prior_scale)
        y[i, at] = torch.as_tensor(table["value"].to_numpy(float))
        present[i, at] = True
        sd[i, at] = noise.sd
        unknown.add(bool(noise.groups))
    if len(unknown) > 1:
        raise InputError(
            f"criticism of {', '.join(tables)}: some come with `sd` and others without; give all "
            "of them one or none, or criticise them apart"
        )
    groups = Noise.inferred(emulator, prior_scale).groups if unknown.pop() else {}
    units = torch.stack([*groups.values()]) if groups else torch.zeros(0, len(outputs)).double()
    return Observations(
        tuple(tables), outputs, y, present, sd, tuple(groups), units, float(prior_scale)
    )


def read_observations(
    paths: dict[str, str | Path], emulator: Emulator, prior_scale: float
) -> Observations:
    """Observations of measured files by subject. Raises InputError for a file of no use."""
    tables = {name: read_measured(path) for name, path in paths.items()}
    return observe(tables, emulator, prior_scale)


def channels_of(outputs: Sequence[str], direction: str, segments: Sequence[int]) -> torch.Tensor:
    """Mask (D,) of one direction's channels in some segments."""
    wanted = {f"{direction}_{s:02d}" for s in segments}
    return torch.tensor([name in wanted for name in outputs])


WALLS = {
    "anterior": (1, 7, 13),
    "septal": (2, 3, 8, 9, 14),
    "inferior": (4, 10, 15),
    "lateral": (5, 6, 11, 12, 16),
}
"""Segments of the walls from base to apex; the apex (17) belongs to none."""


def contrasts(observations: Observations) -> dict[str, dict[str, torch.Tensor]]:
    """Families of structured departures: family -> name -> pattern (D,) of ones.

    Only patterns of at least two observed channels: one channel is a test of its own.
    """
    outputs, seen = observations.outputs, observations.present.any(0)
    segments = {"all": [s.number for s in aha.SEGMENTS]}
    families = {"direction": segments, "level": aha.LEVELS, "wall": WALLS}
    found: dict[str, dict[str, torch.Tensor]] = {}
    for family, places in families.items():
        found[family] = {}
        for place, numbers in places.items():
            for direction in aha.DIRECTIONS:
                mask = channels_of(outputs, direction, numbers) & seen
                if mask.sum() >= 2:
                    name = direction if place == "all" else f"{place} {direction}"
                    found[family][name] = mask.double()
    return {family: patterns for family, patterns in found.items() if patterns}
