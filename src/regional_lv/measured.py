"""Measured files: what was observed of one ventricle, as a tidy CSV.

Columns `quantity` (volume | circumferential | radial | longitudinal), `segment` (AHA 1-17, empty
for the volume), `value`, `unit` (mL | 1 | %), optional `sd` (in the same unit), `frame`, `slice`
and `source`. Channels that were not measured are absent. Strains are Green strains relative to
end-diastole that look back to the unloaded state, E = (F^-T F^-1 - I) / 2: circumferential and
longitudinal ones are negative, radial ones positive.
"""

import csv
import difflib
import json
import math
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.errors import InputError
from regional_lv.resources import SLICES_OF_LEVEL

REQUIRED = ("quantity", "segment", "value", "unit")
OPTIONAL = ("sd", "frame", "slice", "source")
QUANTITIES = ("volume", *aha.DIRECTIONS)
UNITS = {"mL": 1.0, "1": 1.0, "%": 0.01}
"""Factor to the unit used inside: mL for the volume, 1 for strains."""

SIGN = {"circumferential": -1, "radial": 1, "longitudinal": -1}
SIGN_TOLERANCE = 0.05
"""A noisy channel near zero may come out on the wrong side by this much, or by three `sd`."""

LARGEST_STRAIN = {"circumferential": 1.5, "radial": 3.0, "longitudinal": 1.5}
"""Larger numbers are percent: soft walls reach radial strains of 2 (published simulations)."""

VOLUME_RANGE_ML = (20.0, 600.0)


class MeasuredWarning(UserWarning):
    """A measured file that can be used, but says less than it seems."""


def output_name(quantity: str, segment: int | None = None) -> str:
    """Name in `aha.OUTPUTS` of a quantity and its AHA segment."""
    return "volume_ml" if quantity == "volume" else f"{quantity}_{segment:02d}"


# --------------------------------------------------------------------------------- reading


def read_measured(path: str | Path) -> pd.DataFrame:
    """Read and check a measured file.

    Returns
    -------
    One row per channel, in the order of the file: `output` (a name of `aha.OUTPUTS`), `quantity`,
    `segment` (Int64, missing for the volume), `value` and `sd` (mL or strain, NaN where not
    given), and `frame`, `slice`, `source` as text where the file has them.

    Raises
    ------
    InputError: names the file, the line and the remedy.

    Warns
    -----
    MeasuredWarning: no volume, or fewer channels than parameters.
    """
    columns, lines = _read_lines(Path(path))
    table = pd.DataFrame([_read_row(path, number, fields) for number, fields in lines])
    for check in (_check_frames, _check_duplicates, _check_percent, _check_size, _check_signs):
        for number, complaint in check(table):
            raise _error(path, number, complaint)
    _check_noise(path, table)
    for shortcoming in shortcomings(table):
        warnings.warn(f"{path}: {shortcoming}", MeasuredWarning, stacklevel=2)
    table["segment"] = table["segment"].astype("Int64")
    passed_on = [column for column in ("frame", "slice", "source") if column in columns]
    return table[["output", "quantity", "segment", "value", "sd", *passed_on]]


def states_noise(path: str | Path) -> bool:
    """Whether a measured file gives the sd of its strains. Raises InputError as `read_measured`."""
    with warnings.catch_warnings():
        # Whoever uses the file says what it lacks.
        warnings.simplefilter("ignore", MeasuredWarning)
        table = read_measured(path)
    return bool(table.loc[table["quantity"] != "volume", "sd"].notna().all())


def shortcomings(measured: pd.DataFrame) -> list[str]:
    """What a measured table cannot tell, in sentences."""
    found = []
    if "volume" not in set(measured["quantity"]):
        found.append(
            "no volume: nothing but the strains sets the overall stiffness, so expect it to stay "
            "uncertain; add the end-diastolic volume if there is one"
        )
    if len(measured) < len(aha.PARAMETERS):
        found.append(
            f"{len(measured)} channels for {len(aha.PARAMETERS)} parameters: the data cannot tell "
            "all of them apart, and what they leave open, the posterior takes from the prior; add "
            "channels"
        )
    return found


def _error(path: str | Path, number: int | None, complaint: str) -> InputError:
    where = f"{path}, line {number}" if number else f"{path}"
    return InputError(f"{where}: {complaint}")


def _read_lines(path: Path) -> tuple[list[str], list[tuple[int, dict]]]:
    """Column names, and per line that is not empty its number and fields."""
    try:
        # utf-8-sig: spreadsheet programs begin a CSV with a byte order mark.
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise _error(path, None, f"cannot be read ({error}); check path and encoding") from error
    reader = csv.reader(text.splitlines())
    columns = [name.strip() for name in next(reader, [])]
    for name in REQUIRED:
        if name not in columns:
            raise _error(path, 1, f"no column `{name}`; {_column_remedy(name, columns)}")
    for name in columns:
        if name not in REQUIRED + OPTIONAL or columns.count(name) > 1:
            raise _error(
                path,
                1,
                f"column `{name}` is not known or stands twice; remove it, or rename it to one of "
                f"{', '.join(REQUIRED + OPTIONAL)}",
            )
    lines = []
    for fields in reader:
        if not any(field.strip() for field in fields):
            continue
        if len(fields) != len(columns):
            raise _error(
                path,
                reader.line_num,
                f"{len(fields)} fields for {len(columns)} columns; separate fields by commas and "
                "write decimals with a point",
            )
        cells = (field.strip() for field in fields)
        lines.append((reader.line_num, dict(zip(columns, cells, strict=True))))
    if not lines:
        raise _error(path, None, "no measurements; add one row per channel")
    return columns, lines


def _column_remedy(name: str, columns: list[str]) -> str:
    if len(columns) == 1 and (";" in columns[0] or "\t" in columns[0]):
        return "save the file with commas between the fields"
    close = difflib.get_close_matches(name, columns, n=1)
    if close:
        return f"rename `{close[0]}`"
    return f"the first line has to name the columns {', '.join(REQUIRED)}"


def _read_row(path: str | Path, number: int, fields: dict) -> dict:
    """One line as numbers in the units used inside; `line`, `unit` and `raw` serve the checks."""
    quantity, unit = fields["quantity"], fields["unit"]
    if quantity not in QUANTITIES:
        close = difflib.get_close_matches(quantity.lower(), QUANTITIES, n=1)
        hint = f"did you mean {close[0]}?" if close else f"use one of {', '.join(QUANTITIES)}"
        raise _error(path, number, f"quantity `{quantity}` is not known; {hint}")
    expected = ("mL",) if quantity == "volume" else ("1", "%")
    if unit not in expected:
        raise _error(
            path,
            number,
            f"unit `{unit}` does not go with {quantity}; convert to and write "
            f"{' or '.join(expected)}",
        )
    segment = _segment(path, number, quantity, fields["segment"])
    raw = _number(path, number, "value", fields["value"])
    sd = _number(path, number, "sd", fields["sd"]) if fields.get("sd") else math.nan
    if sd <= 0:
        raise _error(path, number, f"sd {sd:g} is not positive; correct it, or leave it empty")
    return fields | {
        "line": number,
        "output": output_name(quantity, segment),
        "segment": segment,
        "raw": raw,
        "value": raw * UNITS[unit],
        "sd": sd * UNITS[unit],
    }


def _segment(path: str | Path, number: int, quantity: str, text: str) -> int | None:
    if quantity == "volume":
        if text:
            raise _error(path, number, f"the volume has segment `{text}`; leave it empty")
        return None
    try:
        segment = float(text)
    except ValueError:
        segment = math.nan
    if segment not in range(1, len(aha.SEGMENTS) + 1):
        raise _error(
            path, number, f"segment `{text}` is not an AHA segment; use its number, 1 to 17"
        )
    return int(segment)


def _number(path: str | Path, number: int, column: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        remedy = "write decimals with a point" if "," in text else "give a number"
        raise _error(path, number, f"{column} `{text}` is not a number; {remedy}") from None
    if not math.isfinite(value):
        raise _error(
            path,
            number,
            f"{column} `{text}` is not finite; remove the row if the channel was not measured",
        )
    return value


# ---------------------------------------------------------------------------------- checks
# Each yields (line, complaint); reading stops at the first.

Complaints = Iterator[tuple[int, str]]


def _check_frames(table: pd.DataFrame) -> Complaints:
    frames = list(dict.fromkeys(table.get("frame", ())))
    if len(frames) > 1:
        line = table.loc[table["frame"] == frames[1], "line"].iloc[0]
        yield line, f"several frames ({', '.join(frames)}); keep the end-diastolic one only"


def _check_duplicates(table: pd.DataFrame) -> Complaints:
    for _, row in table[table.duplicated("output")].iterrows():
        first = table.loc[table["output"] == row["output"], "line"].iloc[0]
        yield (
            row["line"],
            f"{row['output']} stands in line {first} already; keep one of them, or their mean",
        )


def _check_percent(table: pd.DataFrame) -> Complaints:
    plain, percent = table[table["unit"] == "1"], table[table["unit"] == "%"]
    limit = plain["quantity"].map(LARGEST_STRAIN)
    for _, row in plain[plain["raw"].abs() > limit].iterrows():
        yield (
            row["line"],
            f"{row['quantity']} strain {row['raw']:g} with unit 1 looks like percent; write unit %",
        )
    if len(percent) and (percent["raw"].abs() < 1).all():
        yield (
            percent["line"].iloc[0],
            f"strains with unit % are all below 1 (here {percent['raw'].iloc[0]:g}) and look like "
            "fractions; write unit 1",
        )


def _check_size(table: pd.DataFrame) -> Complaints:
    low, high = VOLUME_RANGE_ML
    for _, row in table.iterrows():
        value = row["value"]
        if row["quantity"] == "volume":
            if not low <= value <= high:
                litres = low <= 1000 * value <= high
                remedy = "looks like litres; give mL" if litres else "check value and unit"
                yield row["line"], f"volume {value:g} mL is not one of a left ventricle; {remedy}"
        elif value <= -0.5:
            yield (
                row["line"],
                f"{row['quantity']} strain {value:g}: no Green strain reaches -0.5; check value "
                "and unit, and whether it is another strain measure",
            )
        elif abs(value) > LARGEST_STRAIN[row["quantity"]]:
            yield row["line"], f"{row['quantity']} strain {value:g} is absurd; check value and unit"


def _check_signs(table: pd.DataFrame) -> Complaints:
    for quantity, sign in SIGN.items():
        rows = table[table["quantity"] == quantity]
        wrong = rows[rows["value"] * sign < 0]
        word = "negative" if sign < 0 else "positive"
        if len(wrong) > max(len(rows) / 2, 1):
            yield (
                wrong["line"].iloc[0],
                f"{len(wrong)} of {len(rows)} {quantity} strains have the wrong sign; strains here "
                f"look back from end-diastole to the unloaded state, {quantity} ones are {word}. A "
                "strain e that looks forward becomes -e / (1 + 2 e)",
            )
        tolerance = np.fmax(SIGN_TOLERANCE, 3 * wrong["sd"])
        for _, row in wrong[wrong["value"].abs() > tolerance].iterrows():
            yield (
                row["line"],
                f"{row['output']} is {row['value']:g}, and {quantity} strains are {word} (looking "
                "back from end-diastole); correct the sign, or remove the channel",
            )


def _check_noise(path: str | Path, table: pd.DataFrame) -> None:
    strains = table[table["quantity"] != "volume"]
    without = strains["sd"].isna()
    if without.any() and not without.all():
        raise _error(
            path,
            strains.loc[without, "line"].iloc[0],
            "no sd, where other strains have one; give all of them one (known noise) or none "
            "(noise is inferred)",
        )


# ------------------------------------------------------------------------ writing and making


def write_measured(table: pd.DataFrame, path: str | Path) -> None:
    """Write a table as returned by `read_measured` in the tidy form, in mL and strains."""
    tidy = table.assign(unit=np.where(table["quantity"] == "volume", "mL", "1"))
    optional = [name for name in OPTIONAL if name in tidy and tidy[name].notna().any()]
    tidy[[*REQUIRED, *optional]].to_csv(path, index=False)


def published_volunteer(
    case: str | Path,
    slices: list[str | Path] | None = None,
    frame: int | str | None = None,
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
        raise _error(case, None, f"cannot be read ({error}); fetch it again") from error
    if row.shape != (1, 33):
        raise _error(case, None, f"shape {row.shape} instead of (1, 33); fetch it again")
    values, source = row[0], "published volunteer"
    if slices is not None:
        values = np.concatenate([values[:1], _slice_strains(slices, frame, chosen)])
        source += f", frame {frame}"
        if chosen:
            source += f", slices {', '.join(map(str, chosen))}"
    order = sorted(aha.SEGMENTS, key=lambda segment: segment.published_order)[:16]
    channels = [("volume", None)]
    channels += [(q, s.number) for q in ("circumferential", "radial") for s in order]
    return _published(channels, values, source)


_SECTORS = ((0,), (1,), (2,), (3,), (4,), (5,))
"""A slice's columns, each direction: the six sectors of the published order of segments."""

_APICAL_SECTORS = ((0, 1), (2,), (3, 4), (5,))
"""Septal, anterior, lateral, inferior: means of the sectors that they contain."""


def _slice_strains(slices, frame: int | str, chosen: list[int] | None) -> np.ndarray:
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


def _slice(path: str | Path, frame: int | str) -> np.ndarray:
    """Circumferential and radial strains (2, 6) of one slice."""
    try:
        curves = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    except (OSError, ValueError) as error:
        raise _error(path, None, f"cannot be read ({error}); fetch it again") from error
    if curves.shape[1] != 12 or len(curves) < 2:
        raise _error(path, None, f"{curves.shape} instead of 12 columns; fetch it again")
    # The first row is the reference: end-diastole, no strain.
    curves = curves[1:].reshape(-1, 2, 6)
    if frame == "extrema":
        return np.stack([curves[:, 0].min(0), curves[:, 1].max(0)])
    if frame > len(curves):
        raise _error(path, None, f"no frame {frame}; choose 1 to {len(curves)}, or extrema")
    return curves[frame - 1]


def published_simulation(
    inputs: str | Path, outputs: str | Path, row: int
) -> tuple[pd.DataFrame, pd.Series]:
    """A published simulation as if it had been measured, and its theta by parameter.

    inputs, outputs: header-less CSV, N rows of 10 and of 52 (volume, then 17 strains for each
    direction in the published order of segments). row: 1, 2, ..., N. Raises InputError otherwise.
    """
    values = []
    for path, width in ((inputs, len(aha.PARAMETERS)), (outputs, len(aha.OUTPUTS))):
        table = pd.read_csv(path, header=None)
        if table.shape[1] != width:
            raise _error(path, None, f"{table.shape[1]} columns instead of {width}; fetch it again")
        if not 1 <= row <= len(table):
            raise _error(path, row, f"there are {len(table)} rows; choose one of them")
        values.append(table.to_numpy(float)[row - 1])
    theta, published = values
    channels = [("volume", None), *((q, s.number) for q in aha.DIRECTIONS for s in aha.SEGMENTS)]
    observed = aha.outputs_from_published(published)
    return _published(channels, observed, f"published simulation, row {row}"), pd.Series(
        theta, index=list(aha.PARAMETERS)
    )


def _published(channels: list, values: np.ndarray, source: str) -> pd.DataFrame:
    table = _table(channels, values)
    table["source"] = source
    return table.sort_values(
        "output", key=lambda names: names.map(aha.OUTPUTS.index), ignore_index=True
    )


def synthetic_subject(outputs: np.ndarray, noise: dict, unit_noise: np.ndarray) -> pd.DataFrame:
    """Measured table of a simulated ventricle: `outputs` plus noise.

    outputs: (52,) in the order of `aha.OUTPUTS`; noise: `strain` and `volume` (mL), its scales,
    which also become the `sd` of the table; unit_noise: (52,) of unit scale.
    """
    is_volume = np.array([name == "volume_ml" for name in aha.OUTPUTS])
    sd = np.where(is_volume, noise["volume"], noise["strain"])
    value = np.asarray(outputs) + sd * unit_noise
    channels = [("volume", None)]
    channels += [(q, s.number) for q in aha.DIRECTIONS for s in aha.SEGMENTS]
    table = _table(channels, value)
    table["sd"] = sd
    table["source"] = "synthetic"
    return table


def write_truth(path: str | Path, theta: dict, effects: dict, noise: dict, seed: int) -> None:
    """Write what a synthetic subject was made from, as JSON."""
    truth = {"theta": theta, "effects": effects, "noise": noise, "seed": seed}
    Path(path).write_text(json.dumps(truth, indent=2) + "\n")


def _table(channels: list[tuple[str, int | None]], values: np.ndarray) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "output": [output_name(*channel) for channel in channels],
            "quantity": [quantity for quantity, _ in channels],
            "segment": pd.array([segment for _, segment in channels], dtype="Int64"),
            "value": values,
            "sd": np.nan,
        }
    )
