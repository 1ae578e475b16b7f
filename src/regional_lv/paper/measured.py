"""Measured tables of published subjects: the paper's healthy volunteer, and its simulations as if
they had been measured."""

from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.channels import Channel, Channels
from regional_lv.csv_lines import error_at
from regional_lv.data.published import SLICES_OF_LEVEL
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.measured.tables import make_table, observed, write_measured

Frame: TypeAlias = int | Literal["extrema"]
"""Number of a cine frame (1, 2, ...), or the largest strains, whenever they occur."""


def published_volunteer(
    case: str | Path,
    slices: list[str | Path] | None = None,
    frame: Frame | None = None,
    chosen: list[int] | None = None,
) -> pd.DataFrame:
    """The healthy volunteer of the paper as a measured table.

    `case`: header-less CSV, one row of 33: volume (mL), then 16 circumferential and 16 radial
    strains in the published order of segments, without the apex. `slices`: CSVs with a row per
    cine frame, one for each short-axis slice; if given, the strains are those of frame
    number `frame` (1, 2, ...), or with "extrema" the largest of each segment in each slice,
    whenever they occur; `chosen`, numbers of the slices that count, all if None. Raises InputError
    otherwise.
    """
    try:
        row = np.loadtxt(case, delimiter=",", ndmin=2)
    except (OSError, ValueError) as error:
        raise error_at(case, None, f"cannot be read ({error}); fetch it again") from error
    if row.shape != (1, 33):
        raise error_at(case, None, f"shape {row.shape} instead of (1, 33); fetch it again")
    values, source = row[0], "published volunteer"
    if slices is not None:
        assert frame is not None
        values = np.concatenate([values[:1], _slice_strains(slices, frame, chosen)])
        source += f", frame {frame}"
        if chosen:
            source += f", slices {', '.join(map(str, chosen))}"
    order = sorted(aha.SEGMENTS, key=lambda segment: segment.published_order)[:16]
    channels = [Channel("volume")]
    channels += [
        Channel(quantity, f"{segment.number:02d}")
        for quantity in ("circumferential", "radial")
        for segment in order
    ]
    return _published(channels, values, source)


def import_volunteer(
    case: str | Path,
    frame: Frame | None,
    chosen: list[int] | None,
    channels: Channels,
    measured: str | Path,
    slices: list[str | Path] | None = None,
) -> None:
    """Write what the study observes of the volunteer to `measured`; the rest is as in
    `published_volunteer`."""
    write_measured(observed(published_volunteer(case, slices, frame, chosen), channels), measured)


_SECTORS = ((0,), (1,), (2,), (3,), (4,), (5,))
"""A slice's columns, each direction: the six sectors of the published order of segments."""

_APICAL_SECTORS = ((0, 1), (2,), (3, 4), (5,))
"""Septal, anterior, lateral, inferior: means of the sectors that they contain."""


def _slice_strains(slices, frame: Frame, chosen: list[int] | None) -> np.ndarray:
    """The 32 strains of one frame, in published order: per level the mean over its slices."""
    tables = [_slice(path, frame) for path in slices]
    values = []
    for direction in (0, 1):
        for numbers, sectors in zip(
            SLICES_OF_LEVEL, (_SECTORS, _SECTORS, _APICAL_SECTORS), strict=True
        ):
            used = [n for n in numbers if chosen is None or n in chosen]
            mean = np.mean([tables[n - 1][direction] for n in used], axis=0)
            values += [mean[list(columns)].mean() for columns in sectors]
    return np.array(values)


def _slice(path: str | Path, frame: Frame) -> np.ndarray:
    """Circumferential and radial strains (2, 6) of one slice."""
    try:
        curves = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    except (OSError, ValueError) as error:
        raise error_at(path, None, f"cannot be read ({error}); fetch it again") from error
    if curves.shape[1] != 12 or len(curves) < 2:
        raise error_at(path, None, f"{curves.shape} instead of 12 columns; fetch it again")
    # The first row is the reference: end-diastole, no strain.
    curves = curves[1:].reshape(-1, 2, 6)
    if frame == "extrema":
        return np.stack([curves[:, 0].min(0), curves[:, 1].max(0)])
    if not 1 <= frame <= len(curves):
        raise error_at(path, None, f"no frame {frame}; choose 1 to {len(curves)}, or extrema")
    return curves[frame - 1]


def published_simulation(
    inputs: str | Path, outputs: str | Path, row: int
) -> tuple[pd.DataFrame, pd.Series]:
    """A published simulation as if it had been measured, and its theta by the paper's parameters.

    inputs, outputs: header-less CSV, N rows of 10 and of 52 (volume, then 17 strains for each
    direction in the published order of segments). row: 1, 2, ..., N. Raises InputError otherwise.
    """
    channels, parameters, values = Channels.of(), StiffnessInputs(), []
    for path, width in ((inputs, len(parameters)), (outputs, len(channels))):
        table = pd.read_csv(path, header=None)
        if table.shape[1] != width:
            raise error_at(
                path, None, f"{table.shape[1]} columns instead of {width}; fetch it again"
            )
        if not 1 <= row <= len(table):
            raise error_at(path, row, f"there are {len(table)} rows; choose one of them")
        values.append(table.to_numpy(float)[row - 1])
    theta, published = values
    observed = aha.outputs_from_published(published)
    return _published(channels, observed, f"published simulation, row {row}"), pd.Series(
        theta, index=list(parameters.names)
    )


def import_published_simulation(
    inputs: str | Path,
    outputs: str | Path,
    row: int,
    subject: str,
    channels: Channels,
    measured: str | Path,
    theta: str | Path,
) -> None:
    """Write what the study observes of a published simulation to `measured`, and its theta (CSV: a
    row called `subject`) apart; the rest is as in `published_simulation`."""
    table, known = published_simulation(inputs, outputs, row)
    write_measured(observed(table, channels), measured)
    known.to_frame(subject).T.to_csv(theta, index_label="subject")


def _published(channels, values: np.ndarray, source: str) -> pd.DataFrame:
    table = make_table(channels, values)
    table["source"] = source
    order = Channels.of().names
    return table.sort_values("output", key=lambda names: names.map(order.index), ignore_index=True)
