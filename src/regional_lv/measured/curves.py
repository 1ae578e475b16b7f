"""Strain curves over the frames of a cine, as strain software exports them, as a measured table.

A wide CSV: a column `frame` or a time, and a column per direction and AHA segment
(`circumferential_01`, `radial_17`, ...). A curve is the strain of a material line relative to its
own length at a reference frame, end diastole or end systole. What the study observes looks back:
it is the strain of the stretch l = length(unloaded) / length(end diastole). Curves that refer to
end diastole give l at the unloaded frame; for any other reference the stretches of the two frames
are divided. Green's strain (l^2 - 1) / 2 of the line is the component of (F^-T F^-1 - I) / 2 along
its direction at end diastole.

A file may begin anywhere in the cycle: frames are compared in their order from end diastole on, and
the first frame of the file follows the last.
"""

import re
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, Literal, NamedTuple

import numpy as np
import pandas as pd

from regional_lv.channels import Channel, Channels
from regional_lv.csv_lines import error_at, number_at, read_lines
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.measured.segment_models import check_segment, to_aha
from regional_lv.measured.tables import (
    MeasuredWarning,
    check_sd,
    check_values,
    make_table,
    shortcomings,
    write_measured,
)
from regional_lv.quantities import QUANTITIES, seth_hill

DIRECTIONS = ("circumferential", "radial", "longitudinal")
CLOCKS = ("frame", "time", "time_ms", "time_s")
"""Names that the column of the frames, or of their times, may have."""

READING_KEYS = ("reference", "measure", "frame", "end_diastole_frame")
"""Keys of a subject, in the order in which `find_unloading` takes them."""

EARLIEST_DIASTOLE: Final = "earliest_diastole"
"""The word for the first frame in which the ventricle fills."""
FILLING = 0.1
"""Share of the greatest contraction that is gone when the ventricle fills."""

LARGEST_FRACTION = 1.5
"""Strains of a heart as fractions are smaller everywhere; in percent, some are larger."""

SPIKE_SHARE, SPIKE_NOISE = 0.25, 12.0
"""A value is a spike if it is off by this share of the range of its direction, and by so many times
what is usual there. In the published cine no value is off by more than 0.18 of the range."""

AT_REFERENCE = 0.1
"""A curve is at its reference where it is within this share of its range from zero."""
ALL_ZERO = 1e-3
"""In the frame of reference itself all curves are within this share of the largest strain."""

LARGEST_STEP = 2.0
"""Between the last and the first frame of a file the contraction changes by at most so many times
its largest step from frame to frame; otherwise frames are missing there."""

_NAME = re.compile(rf"({'|'.join(DIRECTIONS)})[ _-]*0*(\d+)", re.IGNORECASE)


class Curves(NamedTuple):
    """Strain curves: numbers of the frames (T,), their lines in the file, the channels (D) with the
    segments that the file counts, and the strains (T, D) as fractions."""

    frames: list[int]
    lines: list[int]
    channels: Channels
    strains: np.ndarray


STILL_CONTRACTED = 0.95
"""Share of the greatest contraction, above which the muscle may not be relaxed yet."""


class Unloading(NamedTuple):
    """Stretches (D,) l = length(unloaded) / length(end diastole), the rows of both frames and of
    the greatest contraction, the share of this contraction that is left when unloaded, and the row
    of the largest ventricle with the share by which it is beyond end diastole."""

    stretches: np.ndarray
    unloaded: int
    end_diastole: int
    end_systole: int
    contraction_left: float
    largest: int = 0
    beyond: float = 0.0

    def doubts(self, frames: Sequence) -> list[str]:
        """What is odd about the frames (labels `frames`, of all rows), in sentences."""
        unloaded, systole = frames[self.unloaded], frames[self.end_systole]
        found = []
        if self.beyond > AT_REFERENCE:
            found.append(
                f"in frame {frames[self.largest]} the ventricle is larger than in frame "
                f"{frames[self.end_diastole]}, taken as end diastole, by {100 * self.beyond:.0f} % "
                "of the greatest contraction: name the frame of end diastole (end_diastole_frame)"
            )
        after = [
            (row - self.end_diastole) % len(frames) for row in (self.unloaded, self.end_systole)
        ]
        if after[0] <= after[1]:
            found.append(
                f"frame {unloaded} is no later than the greatest contraction (frame {systole}): "
                "the muscle is active there, where the simulation needs it relaxed; take a frame "
                "of early diastole, and mind whether frames count from 0 or 1"
            )
        elif self.contraction_left > STILL_CONTRACTED:
            found.append(
                f"in frame {unloaded} {100 * self.contraction_left:.0f} % of the greatest "
                "contraction is left: relaxation may not be complete; take a later frame"
            )
        return found


def read_curves(path: str | Path, unit: str, segments: int = 17) -> Curves:
    """Read and check a file of curves.

    unit: `percent` or `fraction`. segments: how many the model has whose segments the columns count
    (`segment_models`). Frames have the numbers of the column `frame`, wherever it stands, and
    without one they are counted from 1. Raises InputError that names the file, the line or column,
    and the remedy.
    """
    header, columns, rows = read_lines(path, others=True)
    clocks = [name for name in columns if name.lower() in CLOCKS]
    if not clocks:
        raise error_at(
            path,
            header,
            "no column `frame` nor `time`; the first column has to say which frame a row is (save "
            "the file with commas between the fields)",
        )
    named = {name: _channel(path, header, name, segments) for name in columns if name not in clocks}
    channels = list(named.values())
    if not channels:
        raise error_at(path, header, f"no curves; {_NAMES}")
    for name, channel in named.items():
        if channels.count(channel) > 1:
            raise error_at(path, header, f"column `{name}`: {channel.name} occurs twice; keep one")
    if len(rows) < 3:
        raise error_at(path, None, f"{len(rows)} frames are no curve; export the whole cycle")
    for name in named:
        _check_length(path, name, rows)
    strains = np.array([[number_at(path, n, name, row[name]) for name in named] for n, row in rows])
    lines = [line for line, _ in rows]
    clock = next((name for name in clocks if name.lower() == "frame"), clocks[0])
    frames = _frames(path, clock, rows)
    factor = _check_unit(path, strains, unit)
    return Curves(frames, lines, Channels(channels), factor * strains)


_NAMES = (
    "name the columns by direction and AHA segment, circumferential_01 to _17, radial_01 to _17, "
    "longitudinal_01 to _17, and remove all others"
)


def _channel(path: str | Path, header: int, name: str, segments: int) -> Channel:
    found = _NAME.fullmatch(name)
    if not found:
        raise error_at(path, header, f"column `{name}` is not known; {_NAMES}")
    where = f"column `{name}`"
    segment = check_segment(path, header, where, int(found[2]), segments)
    return Channel(found[1].lower(), f"{segment:02d}")


def _check_length(path: str | Path, name: str, rows: list[tuple[int, dict]]) -> None:
    """Raise for a curve that ends before the others do."""
    given = [line for line, row in rows if row[name]]
    if not given:
        raise error_at(path, None, f"column `{name}` is empty; remove it if it was not measured")
    if len(given) < len(rows):
        gap = next(line for line, row in rows if not row[name])
        raise error_at(
            path,
            gap,
            f"column `{name}` has {len(given)} values for {len(rows)} frames; all curves need a "
            "value in every frame: export them over the same cycle, or remove the column",
        )


def _frames(path: str | Path, clock: str, rows: list[tuple[int, dict]]) -> list[int]:
    """Numbers of the frames: those of the column `frame`, or counted from 1. Numbers of a cine may
    go on from its last frame to its first."""
    times = [number_at(path, line, clock, row[clock]) for line, row in rows]
    pairs = zip(rows[1:], times, times[1:], strict=False)
    back = [(line, before, after) for (line, _), before, after in pairs if after <= before]
    around = clock.lower() == "frame" and len(back) == 1 and times[-1] < times[0]
    if back and not around:
        line, before, after = back[0]
        raise error_at(path, line, f"{clock} {after:g} does not follow {before:g}; sort the frames")
    if clock.lower() != "frame":
        return list(range(1, len(rows) + 1))
    for (line, _), frame in zip(rows, times, strict=True):
        if frame != round(frame):
            raise error_at(path, line, f"frame {frame:g} is no whole number; name the column time")
    return [round(frame) for frame in times]


def _check_unit(path: str | Path, strains: np.ndarray, unit: str) -> float:
    """The factor from `unit` to fractions; raises where the values are in the other unit."""
    largest = np.abs(strains).max()
    if largest == 0:
        raise error_at(path, None, "all strains are zero; export them again")
    if unit == "fraction" and largest > LARGEST_FRACTION:
        raise error_at(
            path, None, f"strains up to {largest:g} are not fractions; set unit: percent"
        )
    if unit == "percent" and largest < LARGEST_FRACTION:
        raise error_at(
            path,
            None,
            f"no strain is larger than {largest:.3g}, which is no heart in percent; set unit: "
            "fraction",
        )
    return 0.01 if unit == "percent" else 1.0


def spikes(curves: Curves) -> list[str]:
    """Curves that jump in a single frame, in sentences: such a value counts for the frame that is
    chosen as much as a true one. (A median over the segments would hide it, and with it walls that
    contract at another time: the published cine would be taken one frame earlier.)

    A value's distance from the mean of the two frames beside it is compared with that of the other
    segments of its direction in the same frame. It takes three segments, and the first and the last
    frame are left out.
    """
    found = []
    for quantity in dict.fromkeys(channel.quantity for channel in curves.channels):
        own = [i for i, channel in enumerate(curves.channels) if channel.quantity == quantity]
        if len(own) < 3:
            continue
        strains = curves.strains[:, own]
        beside = (strains[:-2] + strains[2:]) / 2
        jump = strains[1:-1] - beside
        off = np.abs(jump - np.median(jump, axis=1, keepdims=True))
        usual, extent = np.median(off), np.ptp(np.median(strains, axis=1))
        # The frames beside a spike are off, too, by half as much.
        for column, row in enumerate(off.argmax(axis=0)):
            if off[row, column] > max(SPIKE_SHARE * extent, SPIKE_NOISE * usual):
                found.append(
                    f"{curves.channels[own[column]].name} is {100 * strains[row + 1, column]:.1f} "
                    f"% in frame {curves.frames[row + 1]}, and {100 * beside[row, column]:.1f} % "
                    "by the frames beside it; correct the value, or remove the column: a spike "
                    "can move the frame of the greatest contraction and the unloaded one"
                )
    return found


def find_unloading(
    path: str | Path,
    curves: Curves,
    reference: str,
    measure: str,
    frame: int | Literal["earliest_diastole"],
    end_diastole_frame: int | None = None,
) -> Unloading:
    """Stretches from end diastole back to the unloaded frame.

    Parameters
    ----------
    path: of the curves, for messages.
    reference: `end_diastole` or `end_systole`, where the curves are zero.
    measure: `engineering` (stretch - 1) or `green` ((stretch^2 - 1) / 2).
    frame: number of the unloaded frame, or `earliest_diastole`: the first one after the greatest
        contraction in which a tenth (`FILLING`) of it is gone. The contraction is the mean over all
        curves of the logarithm of the stretch, shortening and thickening counted positive.
    end_diastole_frame: number of the frame of end diastole. None: with the reference
        `end_diastole` the one in which all curves are zero, otherwise the first one.

    Raises
    ------
    InputError: a wrong reference, a wrong sign, a frame that there is not or that is no diastole.
    """
    stretches = _stretches(path, curves, measure)
    signs = np.array([channel.kind.sign for channel in curves.channels])
    contraction = signs * np.log(stretches)
    if end_diastole_frame is not None:
        end_diastole = _row(path, curves, end_diastole_frame)
    else:
        at_rest = reference == "end_diastole"
        end_diastole = _zero_row(curves.strains, contraction.mean(1)) if at_rest else 0
    _check_directions(path, curves, contraction, end_diastole, reference)
    stretches = stretches / stretches[end_diastole]
    contraction = (signs * np.log(stretches)).mean(1)
    end_systole, largest = int(contraction.argmax()), int(contraction.argmin())
    if frame == EARLIEST_DIASTOLE:
        unloaded = _first_filling(path, curves, contraction, end_diastole)
    else:
        unloaded = _row(path, curves, frame)
    left, beyond = contraction[[unloaded, largest]] / contraction[end_systole]
    if left < AT_REFERENCE:
        raise error_at(
            path,
            curves.lines[unloaded],
            f"in frame {curves.frames[unloaded]} the ventricle is as large as at end diastole; the "
            f"unloaded frame lies soon after frame {curves.frames[end_systole]}, the greatest "
            f"contraction: choose one there, or {EARLIEST_DIASTOLE}",
        )
    rows = (unloaded, end_diastole, end_systole)
    return Unloading(stretches[unloaded], *rows, float(left), largest, float(-beyond))


def _stretches(path: str | Path, curves: Curves, measure: str) -> np.ndarray:
    """Lengths (T, D) over those at the reference of the curves."""
    base = 1 + (2 if measure == "green" else 1) * curves.strains
    row, column = np.unravel_index(base.argmin(), base.shape)
    if base[row, column] <= 0:
        raise error_at(
            path,
            curves.lines[row],
            f"{curves.channels[column].name} is {curves.strains[row, column]:g}: no {measure} "
            "strain is so low; check unit and measure",
        )
    return np.sqrt(base) if measure == "green" else base


def _check_directions(
    path: str | Path, curves: Curves, contraction: np.ndarray, end_diastole: int, reference: str
) -> None:
    """Raise for directions whose curves refer to another frame than `reference`, or have the wrong
    sign. contraction (T, D): logarithms of the stretches, shortening and thickening positive."""
    where = f"frame {curves.frames[end_diastole]} (end diastole)"
    line = curves.lines[end_diastole]
    for quantity in dict.fromkeys(channel.quantity for channel in curves.channels):
        own = [channel.quantity == quantity for channel in curves.channels]
        mean = contraction[:, own].mean(1)
        at_zero = abs(mean[end_diastole]) <= AT_REFERENCE * np.ptp(mean)
        if at_zero != (reference == "end_diastole"):
            raise error_at(
                path,
                line,
                f"the {quantity} curves are {'' if at_zero else 'not '}zero in {where}, and the "
                f"reference is {reference}; "
                + (
                    "set reference: end_diastole"
                    if at_zero
                    else "set reference: end_systole, name the frame of end diastole "
                    "(end_diastole_frame), or add its row of zeros"
                ),
            )
        back = mean - mean[end_diastole]
        if back.max() < -back.min():
            does = "lengthens" if QUANTITIES[quantity].sign < 0 else "becomes thinner"
            raise error_at(
                path,
                line,
                f"the wall {does} after {where} by its {quantity} curves, so that they have the "
                "wrong sign: shortening is negative, thickening positive; turn it, or name the "
                "frame of end diastole (end_diastole_frame)",
            )


def _zero_row(strains: np.ndarray, contraction: np.ndarray) -> int:
    """The row of end diastole of curves (T, D) that refer to it: the last of those in sequence in
    which all are zero, or the first row if there is none that the ventricle contracts from.

    contraction (T,): mean over the curves, at zero where these are.
    """
    size = np.abs(strains).max(1)
    zero = size <= ALL_ZERO * size.max()
    last = zero & ~np.roll(zero, -1)
    return int(last.argmax()) if contraction.max() > -contraction.min() else 0


def _row(path: str | Path, curves: Curves, frame: int) -> int:
    if frame not in curves.frames:
        raise error_at(
            path,
            None,
            f"there is no frame {frame}; the frames go from {min(curves.frames)} to "
            f"{max(curves.frames)}",
        )
    return curves.frames.index(frame)


def _first_filling(
    path: str | Path, curves: Curves, contraction: np.ndarray, end_diastole: int
) -> int:
    """The first row after the greatest contraction in which a share `FILLING` of it is gone.

    contraction (T,): from the row of end diastole on, by row.
    """
    rows, end_systole = len(contraction), int(contraction.argmax())
    full = (1 - FILLING) * contraction[end_systole]
    fills = contraction <= full
    # Of the rows behind the greatest contraction, up to the end of the file or to end diastole.
    end = end_diastole if end_systole < end_diastole else rows
    if fills[end_systole:end].any():
        return end_systole + int(fills[end_systole:end].argmax())
    complaint = f"the curves end in frame {curves.frames[end - 1]}, before the ventricle fills"
    if end == rows and end_diastole > 0:
        # The cycle goes on at the beginning of the file, which may be contracted still or again.
        first = int(contraction[:end_diastole].argmax())
        if contraction[first] > full:
            return first + int(fills[first : end_diastole + 1].argmax())
        if contraction[-1] - contraction[0] <= LARGEST_STEP * np.abs(np.diff(contraction)).max():
            return 0
        shares = 100 * contraction[[-1, 0]] / contraction[end_systole]
        complaint = (
            f"between the last frame ({curves.frames[-1]}, {shares[0]:.0f} % of the greatest "
            f"contraction) and the first ({curves.frames[0]}, {shares[1]:.0f} %) those are missing "
            "in which the ventricle begins to fill"
        )
    raise error_at(
        path,
        None,
        f"{complaint}; export the whole cycle, or give the number of the unloaded frame (frame)",
    )


class CurveSubject(NamedTuple):
    """The curves of a subject, the frames that were taken of them, and the measured table (as of
    `read_measured`) that they give."""

    curves: Curves
    unloading: Unloading
    table: pd.DataFrame


def read_curve_subject(
    subject: Mapping, channels: Channels | None = None, strain_exponent: float = 2.0
) -> CurveSubject:
    """Read a subject whose `source` is `curves`.

    subject: the entry of the configuration (`curves`, `unit`, `reference`, `measure`, `frame`,
    `end_diastole_frame`, `volume_ml`, `sd`, and `segments` if not 17). channels: what the study
    observes; if given, nothing else may be in the file. strain_exponent: n of the strains
    (l^n - 1) / n that it observes.

    Raises InputError that names the file, the line or column, and the remedy.
    """
    path = subject["curves"]
    segments = subject.get("segments", 17)
    curves = read_curves(path, subject["unit"], segments)
    unloading = find_unloading(path, curves, *(subject[key] for key in READING_KEYS))
    table = make_table(curves.channels, unloading.stretches)
    table["sd"] = np.nan if subject["sd"]["strain"] is None else subject["sd"]["strain"]
    # Of stretches from end diastole, so that curves of either reference have the same mean.
    table = to_aha(path, table, segments)
    table["value"] = seth_hill.strain(table["value"].to_numpy(), strain_exponent)
    for name in table["output"]:
        if channels is not None and name not in channels.names:
            raise error_at(
                path,
                None,
                f"{name} is no channel that the study observes; add it to "
                "observables.quantities (observables.places), or remove the column",
            )
    check_values(path, table, curves.lines[unloading.unloaded], strain_exponent)
    if subject["volume_ml"] is not None:
        volume = make_table([Channel("volume")], np.array([subject["volume_ml"]]))
        volume["sd"] = np.nan if subject["sd"]["volume"] is None else subject["sd"]["volume"]
        for _, complaint in check_sd(volume.assign(line=None)):
            raise error_at(path, None, f"the subject's sd.volume: {complaint}")
        table = pd.concat([volume, table], ignore_index=True)
    table["source"] = f"{Path(path).name}, frame {curves.frames[unloading.unloaded]}"
    return CurveSubject(curves, unloading, table)


def import_curves(
    curves: str | Path,
    subject: Mapping,
    channels: Channels,
    strain_exponent: float,
    parameters: StiffnessInputs,
    measured: str | Path,
) -> None:
    """Write the measured table of a subject's `curves` to `measured`; the rest is as in
    `read_curve_subject`. Warns of what it cannot tell about `parameters`."""
    table = read_curve_subject({**subject, "curves": curves}, channels, strain_exponent).table
    for shortcoming in shortcomings(table, len(parameters)):
        warnings.warn(f"{curves}: {shortcoming}", MeasuredWarning, stacklevel=2)
    write_measured(table, measured)
