"""What was observed of one heart, or of several that are criticised together."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
import torch

from regional_lv import aha
from regional_lv.channels import Channels, at_load
from regional_lv.emulators.base import Emulator
from regional_lv.errors import InputError
from regional_lv.inference.likelihood import Noise
from regional_lv.inference.target import BLUR


@dataclass(frozen=True)
class Observations:
    """Observed outputs of S hearts, of D different kinds.

    y: (S, D), 0 where absent. present: (S, D). noise: with sd (S, D); scales that are inferred are
    the same in all hearts.
    """

    subjects: tuple[str, ...]
    outputs: tuple[str, ...]
    y: torch.Tensor
    present: torch.Tensor
    noise: Noise

    def blurred(self, emulator: Emulator) -> "Observations":
        """With noise of `BLUR` training sd, about 1 mL of volume, on outputs that have less beside
        noisy ones: they would confine a posterior to a thin curved layer, whose ends importance
        sampling does not reach."""
        exact = self.noise.exact_beside(BLUR, emulator.output_sd)
        sd = torch.where(exact, BLUR * emulator.output_sd, self.noise.sd)
        return replace(self, noise=replace(self.noise, sd=sd))

    @cached_property
    def channels(self) -> Channels:
        """The channels of `outputs`."""
        return Channels.parse(self.outputs)

    @cached_property
    def group_names(self) -> dict[int, str]:
        """Number of each group that is left out together -> its name.

        A segment is a group, numbered and named by its AHA number; so is a quantity without
        segments at one load, numbered 0, -1, ... and named like `volume` or `torsion@0.5`.
        """
        seen = self.present.any(0).tolist()
        here = [channel for channel, s in zip(self.channels, seen, strict=True) if s]
        elsewhere = dict.fromkeys(_elsewhere(c) for c in here if c.segment is None)
        names = {-i: name for i, name in enumerate(elsewhere)}
        segments = sorted({c.segment for c in here} - {None})
        return names | {number: str(number) for number in segments}

    @cached_property
    def groups(self) -> dict[int, torch.Tensor]:
        """Number of each group of `group_names` -> its channels, mask (D,)."""
        own = [str(c.segment) if c.segment else _elsewhere(c) for c in self.channels]
        return {
            number: torch.tensor([name == mine for mine in own])
            for number, name in self.group_names.items()
        }

    def apart(self) -> list["Observations"]:
        """Each heart by itself."""
        return [
            replace(
                self,
                subjects=(name,),
                y=self.y[i : i + 1],
                present=self.present[i : i + 1],
                noise=replace(self.noise, sd=self.noise.sd[i : i + 1]),
            )
            for i, name in enumerate(self.subjects)
        ]


def _elsewhere(channel) -> str:
    """Name of the group of a channel without a segment."""
    return at_load(channel.quantity, channel.load_fraction)


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
            "of them one or none, or criticise them separately"
        )
    groups = Noise.inferred(emulator, prior_scale).groups if unknown.pop() else {}
    return Observations(tuple(tables), outputs, y, present, Noise(sd, groups, float(prior_scale)))


def contrasts(observations: Observations) -> dict[str, dict[str, torch.Tensor]]:
    """Families of structured departures: family -> name -> pattern (D,) of ones.

    Of quantities that segments have, at all loads together. Only patterns of at least two observed
    channels: one channel is a test of its own.
    """
    channels, seen = observations.channels, observations.present.any(0)
    segmental = dict.fromkeys(c.quantity for c in channels if c.segment is not None)
    segments = {"all": [s.number for s in aha.SEGMENTS]}
    families: dict[str, Mapping[str, Iterable[int]]] = {
        "direction": segments,
        "level": aha.LEVELS,
        "wall": aha.WALLS,
    }
    found: dict[str, dict[str, torch.Tensor]] = {}
    for family, places in families.items():
        found[family] = {}
        for place, numbers in places.items():
            inside = np.isin(channels.segments, list(numbers))
            for quantity in segmental:
                mask = torch.as_tensor(channels.of_quantity(quantity) & inside) & seen
                if mask.sum() >= 2:
                    name = quantity if place == "all" else f"{place} {quantity}"
                    found[family][name] = mask.double()
    return {family: patterns for family, patterns in found.items() if patterns}
