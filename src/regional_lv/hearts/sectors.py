"""Hearts whose segments lie otherwise around the axis than those of the emulator of any heart.

The same smooth wall has other means over other segments: of its figures, which are computed from
its surfaces, and of its strains, which are interpolated around the axis from the segments that the
emulator has. Where one zone is all around, strains are smooth and so is the interpolation; where
zones meet, strains jump, and a segment has its share of each that it lies in.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import torch

from regional_lv.aha import LEVELS, SEGMENTS
from regional_lv.channels import Channel, Channels
from regional_lv.geometry.surfaces import Surfaces
from regional_lv.hearts.by_surfaces import BySurfaces
from regional_lv.hearts.population import SHAPE
from regional_lv.inputs.stiffness import StiffnessInputs

WAVES = np.arange(1, 25)
"""Around the axis, of the interpolation."""

SAME_DEG = 3.0
"""Sectors that begin no further apart, once the table is turned as a whole, count as the same.
Every sector's 3 degrees off, its neighbours' the other way, changes strains by 0.0002 to 0.0006
(medians; 0.002 at most) and the volume by 0.3 mL."""

UNKNOWN = 0.4
"""Standard deviation of what is interpolated, as a share of what the interpolation changes at that
level: 0.25 to 0.5 where apical segments of three simulated hearts are turned by 15 and 30 degrees.
"""

BY_SECTORS = {"volume": 0.002, "circumferential": 0.003, "longitudinal": 0.003, "radial": 0.008}
"""Standard deviations of outputs, of a volume as a share of it, by which hearts differ whose walls
have the same means over some segments (root mean squares, as simulated): the volunteer's surfaces
and those through their means over the AHA's sectors."""


def turn_deg(own: pd.DataFrame, other: pd.DataFrame) -> tuple[float, np.ndarray]:
    """By how much sectors (17 rows each) are turned as a whole against others, as the basal and mid
    levels say, and how far each of the sixteen then begins from its other (degrees)."""
    gap = np.radians((own["angle_from_deg"] - other["angle_from_deg"]).to_numpy()[:-1])
    upper = gap[: LEVELS["apical"][0] - 1]
    mean = np.angle(np.exp(1j * upper).mean())
    # The median: a wall that is divided elsewhere turns nothing else.
    turn = mean + np.median(np.angle(np.exp(1j * (upper - mean))))
    return float(np.degrees(turn)), np.degrees(np.angle(np.exp(1j * (gap - turn))))


def weights(other: pd.DataFrame, own: pd.DataFrame, zone: Sequence[str]) -> np.ndarray:
    """Weights (17, 17) of the means over other sectors, of which the mean over each own one is
    made, level by level. zone: of each segment."""
    found = np.eye(len(SEGMENTS))
    for numbers in LEVELS.values():
        at = [s - 1 for s in numbers]
        if len(at) > 1:
            mix = _interpolated if len({zone[a] for a in at}) == 1 else _overlapping
            found[np.ix_(at, at)] = mix(*(_ends(table, at) for table in (other, own)))
    return found


def _ends(table: pd.DataFrame, rows: Sequence[int]) -> np.ndarray:
    """Where sectors begin and end (m, 2), in radians."""
    return np.radians(table[["angle_from_deg", "angle_to_deg"]].to_numpy(float)[rows])


def _overlapping(other: np.ndarray, own: np.ndarray) -> np.ndarray:
    shares = np.zeros((len(own), len(other)))
    for turn in 2 * np.pi * np.arange(-2, 3):
        low = np.maximum(own[:, None, 0], other[:, 0] + turn)
        high = np.minimum(own[:, None, 1], other[:, 1] + turn)
        shares += np.maximum(high - low, 0)
    return shares / shares.sum(axis=1, keepdims=True)


def _interpolated(other: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Means over own sectors of the wave of least squared curvature that has the means over the
    others."""
    roughness = np.concatenate([[1e-6], WAVES**2.0, WAVES**2.0])
    there, here = (_means(ends) for ends in (other, own))
    gram = (there / roughness) @ there.T
    return np.linalg.solve(gram, (there / roughness) @ here.T).T


def _means(ends: np.ndarray) -> np.ndarray:
    """Means (m, 1 + 2 waves) over sectors of 1, the cosines and the sines."""
    low, high = ends.T[..., None] * WAVES
    width = high - low
    means = (np.sin(high) - np.sin(low)) / width, (np.cos(low) - np.cos(high)) / width
    return np.concatenate([np.ones((len(ends), 1)), *means], axis=1)


@dataclass(frozen=True)
class SegmentMeans:
    """Means of thickness or radius over the emulator's segments, of a heart's own x (M, 17):
    `means` at `own`, both (17,), and their derivatives `slopes` (17, 17)."""

    own: torch.Tensor
    means: torch.Tensor
    slopes: torch.Tensor

    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        return self.means + (x - self.own) @ self.slopes.T


class Sectors:
    """What other sectors make of the shape and outputs of a heart.

    Attributes: means, by column of the segment table; weights (17, 17) of the strains.

    Parameters
    ----------
    known, model: the emulator's model, and that of the heart.
    """

    def __init__(self, known: Mapping, model: Mapping):
        shape, other = model["geometry"], known["geometry"]["table"]
        table, apex = shape["table"], -shape["length_mm"]
        turn, _ = turn_deg(table, other)
        there = table.assign(**(other[["angle_from_deg", "angle_to_deg"]] + turn))
        surfaces = Surfaces(table, apex, apex - shape["apex_mm"], sharp=True)
        self.means = {
            column: SegmentMeans(*map(torch.as_tensor, (table[column].to_numpy(float), *found)))
            for column, found in zip(SHAPE, surfaces.segment_means(there), strict=True)
        }
        zone_of = StiffnessInputs.from_spec(model["parameters"]).zone_of
        self.weights = weights(there, table, [zone_of(s.number) for s in SEGMENTS])

    @classmethod
    def between(cls, known: Mapping, model: Mapping) -> "Sectors | None":
        """None if the sectors are the same, turned as a whole."""
        tables = (each["geometry"]["table"] for each in (model, known))
        return cls(known, model) if np.abs(turn_deg(*tables)[1]).max() > SAME_DEG else None


def _level_of_channel(channel: Channel) -> tuple:
    """What channels of segments have in common that are all around the axis."""
    return channel.quantity, channel.load_fraction, channel.level


@dataclass(frozen=True)
class Mixing:
    """Outputs of a heart, of those of the emulator's segments.

    channels: of the heart, d of them. weights (D, D) of the emulator's outputs, of which `kept`
    (d,) are the heart's. interpolation_weights (D, D): of squared changes at a level in the
    variance of what is interpolated there. table_sd (2, D): standard deviations, as they are and as
    shares, of what means over other segments leave open. surfaces: of a heart whose table describes
    them.
    """

    channels: Channels
    weights: torch.Tensor
    interpolation_weights: torch.Tensor
    table_sd: torch.Tensor
    kept: torch.Tensor
    surfaces: BySurfaces | None = None

    @classmethod
    def of(
        cls, channels: Channels, sectors: Sectors | None, surfaces: BySurfaces | None = None
    ) -> "Mixing":
        """Of the emulator's channels; of the same segments without `sectors`."""
        size, mixed = len(channels), np.eye(len(SEGMENTS)) if sectors is None else sectors.weights
        weights = torch.eye(size, dtype=torch.float64)
        of_changes, table_sd = torch.zeros_like(weights), torch.zeros(2, size, dtype=torch.float64)
        for d, one in enumerate(channels):
            if surfaces is None:
                table_sd[int(one.kind.is_positive), d] = BY_SECTORS[one.quantity]
            for e, other in enumerate(channels):
                if (
                    one.segment
                    and other.segment
                    and _level_of_channel(one) == _level_of_channel(other)
                ):
                    weights[d, e] = mixed[one.segment - 1, other.segment - 1]
                    of_changes[d, e] = UNKNOWN**2
        of_changes /= (of_changes > 0).sum(dim=1, keepdim=True).clamp(min=1)
        return cls(channels, weights, of_changes, table_sd, torch.arange(size), surfaces)

    def mixed(self, outputs: torch.Tensor) -> torch.Tensor:
        """What is interpolated (..., d) of the emulator's outputs, or derivatives, (..., D)."""
        return outputs @ self.weights[self.kept].T

    def __call__(self, outputs: torch.Tensor, there: torch.Tensor) -> torch.Tensor:
        """Outputs (M, d) of the emulator's (M, D), at its inputs (M, E)."""
        y = self.mixed(outputs)
        return y if self.surfaces is None else self.surfaces(y, there)

    def slopes(
        self, outputs: torch.Tensor, slopes: torch.Tensor, there: torch.Tensor
    ) -> torch.Tensor:
        """What becomes of the outputs' derivatives (M, D, E): (M, d, E)."""
        found = self.mixed(slopes.mT).mT
        if self.surfaces is None:
            return found
        return self.surfaces.slopes(self.mixed(outputs), found, there)

    def covariance(
        self, mean: torch.Tensor, covariance: torch.Tensor, there: torch.Tensor
    ) -> torch.Tensor:
        """Covariance (M, d, d), of the emulator's mean (M, D) and covariance (M, D, D), and of what
        the interpolation does not know."""
        unknown = (mean @ self.weights.T - mean).square() @ self.interpolation_weights.T
        unknown += (self.table_sd[0] + self.table_sd[1] * mean).square()
        unknown = unknown[:, self.kept]
        kept = self.weights[self.kept]
        found = kept @ covariance @ kept.T
        if self.surfaces is not None:
            factor = self.surfaces.factor(there)
            found = factor[:, :, None] * found * factor[:, None]
            unknown = unknown + self.surfaces.unknown(self.mixed(mean)).square()
        return found + torch.diag_embed(unknown)

    @property
    def known(self) -> "Mixing":
        """The same where simulations tell what means over segments leave open."""
        nothing = {
            name: torch.zeros_like(getattr(self, name))
            for name in ("interpolation_weights", "table_sd")
        }
        surfaces = self.surfaces
        if surfaces is not None:
            surfaces = replace(surfaces, sd=torch.zeros_like(surfaces.sd))
        return replace(self, **nothing, surfaces=surfaces)

    def select(self, outputs: Sequence[str]) -> "Mixing":
        """For some outputs."""
        at = [self.channels.names.index(name) for name in outputs]
        channels = Channels([self.channels[a] for a in at])
        surfaces = None if self.surfaces is None else self.surfaces.select(at)
        return replace(self, channels=channels, kept=self.kept[at], surfaces=surfaces)
