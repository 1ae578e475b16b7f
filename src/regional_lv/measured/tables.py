"""Measured files: what was observed of one ventricle, as a tidy CSV.

Columns `quantity` (a name of `QUANTITIES`, such as volume, circumferential, radial, longitudinal,
torsion, shortening), `segment` (AHA 1-17; of torsion the two levels, such as basal-apical; else
empty), `value`, `unit` (mL | 1 | % | deg/mm), optional `sd` (in the same unit), `load_fraction` or
`pressure_mmhg` (end diastole if absent or empty), `frame`, `slice` and `source`. Channels that were
not measured are absent. Strains are those of the unloaded state, with end diastole as the
reference; Green's are E = (F^-T F^-1 - I) / 2: circumferential and longitudinal ones are negative,
radial ones positive.
"""

import math
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.channels import Channel, Channels
from regional_lv.csv_lines import CsvLines, error_at, number_at, number_in, read_lines
from regional_lv.errors import closest
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.measured.segment_models import check_segment, to_aha
from regional_lv.quantities import NOWHERE, QUANTITIES, SEGMENT_PLACES, Quantity, seth_hill
from regional_lv.units import after_number

REQUIRED = ("quantity", "segment", "value", "unit")
LOADS = ("load_fraction", "pressure_mmhg")
OPTIONAL = ("sd", *LOADS, "frame", "slice", "source")
PASSED_ON = ("frame", "slice", "source")

WORDS = {"fraction": "1", "percent": "%"}
"""What a configuration of strain curves calls these units."""

LARGEST_SD = 0.5
"""Of a strain, as a fraction."""

VOLUME_SHARE = 0.005
"""Sd of a volume that comes without one, as a share of it (about 1 mL): nobody measures better."""

LEAST_VOLUME_SHARE = 0.001
"""Smallest sd of a volume, as a share of it. Beside noisy strains it leaves a posterior that is far
thinner than long: at this sd what passes the convergence check can be up to a fifth too narrow, and
the more so, the smaller the sd (LIMITATIONS.md)."""

BULGE = 0.1
"""By how much a segment may come out on the wrong side of zero, beside three `sd`: a wall that
bulges while the others fill, as a septum under a right ventricle's pressure, does."""

SAME_LOAD = 1e-3
"""Load fractions that differ by less are the same."""


class MeasuredWarning(UserWarning):
    """A measured file that can be used, but says less than it seems."""


# --------------------------------------------------------------------------------- reading


def read_measured(
    path: str | Path,
    channels: Channels | None = None,
    pressure_mmhg: float | None = None,
    strain_exponent: float | None = 2.0,
    segments: int = 17,
) -> pd.DataFrame:
    """Read and check a measured file.

    Parameters
    ----------
    channels: what the study observes; if given, nothing else may be in the file.
    pressure_mmhg: the study's end-diastolic pressure, of which pressures in the file are fractions.
    strain_exponent: of the study's strain measure (2: Green's), which bounds strains; None for a
        file that was checked with it already.
    segments: how many the model has whose segments the file counts: 16, 17 or 18
        (`segment_models`).

    Returns
    -------
    One row per channel, in the order of the file: `output` (its name), `quantity`, `place`,
    `segment` (Int64, missing for what belongs to no segment), `load_fraction`, `value` and `sd` (in
    the quantity's unit, NaN where not given), and `frame`, `slice`, `source` as text where the file
    has them.

    Raises
    ------
    InputError: names the file, the line and the remedy.

    Warns
    -----
    MeasuredWarning: no volume.
    """
    _, columns, lines = _read_columns(path)
    loads = () if channels is None else channels.load_fractions
    table = pd.DataFrame(
        [
            _read_row(path, number, fields, pressure_mmhg, loads, segments)
            for number, fields in lines
        ]
    )
    for complaints in (
        _check_frames(table),
        _check_duplicates(table),
        _check_percent(table),
        _check_signs(table),
        _check_size(table, strain_exponent),
        check_sd(table),
    ):
        for number, complaint in complaints:
            raise error_at(path, number, complaint)
    _check_noise(path, table)
    table = to_aha(path, table, segments)
    for number, complaint in () if channels is None else _check_observed(table, channels):
        raise error_at(path, number, complaint)
    for shortcoming in shortcomings(table):
        warnings.warn(f"{path}: {shortcoming}", MeasuredWarning, stacklevel=2)
    table["segment"] = table["segment"].astype("Int64")
    passed_on = [column for column in PASSED_ON if column in columns]
    return table[[*COLUMNS, *passed_on]]


COLUMNS = ("output", "quantity", "place", "segment", "load_fraction", "value", "sd")
"""Columns of every measured table."""


def states_noise(path: str | Path, pressure_mmhg: float | None = None, segments: int = 17) -> bool:
    """Whether a measured file gives the sd of all but the volume. Raises as `read_measured`."""
    with warnings.catch_warnings():
        # Whoever uses the file says what it lacks.
        warnings.simplefilter("ignore", MeasuredWarning)
        table = read_measured(path, None, pressure_mmhg, None, segments)
    return bool(table.loc[table["quantity"] != "volume", "sd"].notna().all())


def shortcomings(measured: pd.DataFrame, parameters: int = 0) -> list[str]:
    """What a measured table cannot tell of a number of `parameters`, in sentences."""
    found = []
    if "volume" not in set(measured["quantity"]):
        found.append(
            "no volume: nothing but the other channels sets the overall stiffness, so expect it to "
            "stay uncertain; add the end-diastolic volume if there is one"
        )
    if len(measured) < parameters:
        found.append(
            f"{len(measured)} channels for {parameters} parameters: the data cannot tell "
            "all of them apart, and what they leave open, the posterior takes from the prior; add "
            "channels"
        )
    return found


def _read_columns(path: str | Path) -> CsvLines:
    """The lines of a measured file, with the columns that it has to have and no others."""
    table = read_lines(path, REQUIRED, OPTIONAL)
    if all(name in table.columns for name in LOADS):
        raise error_at(
            path, table.header, f"columns {' and '.join(LOADS)} say the same; keep one of them"
        )
    if not table.rows:
        raise error_at(path, None, "no measurements; add one row per channel")
    return table


def _read_row(
    path: str | Path,
    number: int,
    fields: dict,
    pressure: float | None,
    loads: tuple[float, ...],
    segments: int,
) -> dict:
    """One line as numbers in the units used inside; `line`, `unit` and `raw` serve the checks."""
    quantity, unit = fields["quantity"], WORDS.get(fields["unit"], fields["unit"])
    if quantity not in QUANTITIES:
        close = closest(quantity.lower(), QUANTITIES)
        hint = f"did you mean {close}?" if close else f"use one of {', '.join(QUANTITIES)}"
        raise error_at(path, number, f"quantity `{quantity}` is not known; {hint}")
    kind = QUANTITIES[quantity]
    if unit not in kind.units:
        raise error_at(
            path,
            number,
            f"unit `{unit}` does not go with {quantity}; convert to and write "
            f"{' or '.join(kind.units)}",
        )
    channel = Channel(
        quantity,
        _place(path, number, kind, fields["segment"], segments),
        _load_fraction(path, number, fields, pressure, loads),
    )
    raw = number_at(path, number, "value", fields["value"])
    sd = number_at(path, number, "sd", fields["sd"]) if fields.get("sd") else math.nan
    if sd <= 0:
        raise error_at(path, number, f"sd {sd:g} is not positive; correct it, or leave it empty")
    return fields | {
        "line": number,
        "unit": unit,
        "output": channel.name,
        "place": channel.place,
        "segment": channel.segment,
        "load_fraction": channel.load_fraction,
        "raw": raw,
        "value": raw * kind.units[unit],
        "sd": sd * kind.units[unit],
    }


def _place(path: str | Path, number: int, kind: type[Quantity], text: str, segments: int) -> str:
    """The place that the column `segment` names."""
    if kind.places == NOWHERE:
        if text:
            raise error_at(path, number, f"the {kind.name} has segment `{text}`; leave it empty")
        return ""
    if kind.places == SEGMENT_PLACES:
        where = f"segment `{text}`"
        return f"{check_segment(path, number, where, number_in(text), segments):02d}"
    if text not in kind.places:
        two = "needs two levels" if text in aha.LEVELS or not text else f"has no place `{text}`"
        raise error_at(
            path,
            number,
            f"{kind.name} {two}; write one of {', '.join(kind.places)} as its segment",
        )
    return text


def _load_fraction(
    path: str | Path,
    number: int,
    fields: dict,
    pressure: float | None,
    loads: tuple[float, ...],
) -> float:
    """Share of the end-diastolic pressure at which the row was measured."""
    column = next((name for name in LOADS if fields.get(name)), None)
    if column is None:
        return 1.0
    value = number_at(path, number, column, fields[column])
    whole, unit = 1.0, ""
    if column == "pressure_mmhg":
        if pressure is None:
            raise error_at(
                path,
                number,
                "a pressure says nothing without the end-diastolic one; give load_fraction instead",
            )
        whole, unit = pressure, " mmHg"
    fraction = value / whole
    if not 0 < fraction <= 1 + SAME_LOAD:
        raise error_at(
            path,
            number,
            f"{column} {value:g} lies outside (0, {whole:g}{unit}]; end diastole is {whole:g}{unit}"
            + (", the study's loading.pressure_mmhg" if unit else "")
            + ": correct it, or leave it empty for end diastole",
        )
    nearest = min((1.0, *loads), key=lambda load: abs(load - fraction))
    return nearest if abs(nearest - fraction) < SAME_LOAD else round(fraction, 6)


# ---------------------------------------------------------------------------------- checks
# Each yields (line, complaint); reading stops at the first.

Complaints = Iterator[tuple[int, str]]


def check_values(path: str | Path, table: pd.DataFrame, line: int, strain_exponent: float) -> None:
    """Raise InputError for sizes and signs that no strains have; all stand in one `line`."""
    at = table.assign(line=line)
    for complaints in (_check_size(at, strain_exponent), _check_signs(at)):
        for number, complaint in complaints:
            raise error_at(path, number, complaint)


def _check_frames(table: pd.DataFrame) -> Complaints:
    """Strains of one load are of one frame. The volume is that of end diastole, whose frame is
    another one than the unloaded frame of the strains."""
    if "frame" not in table:
        return
    named = table[(table["frame"] != "") & (table["quantity"] != "volume")]
    for load, rows in named.groupby("load_fraction", sort=False):
        frames = list(dict.fromkeys(rows["frame"]))
        if len(frames) > 1:
            line = rows.loc[rows["frame"] == frames[1], "line"].iloc[0]
            which = "end-diastolic one" if load == 1 else f"one at load fraction {load:g}"
            yield (
                line,
                f"several frames ({', '.join(frames)}); keep the {which} only, or say in a column "
                "load_fraction at which load each was taken",
            )


def _check_duplicates(table: pd.DataFrame) -> Complaints:
    for _, row in table[table.duplicated("output")].iterrows():
        first = table.loc[table["output"] == row["output"], "line"].iloc[0]
        yield (
            row["line"],
            f"{row['output']} is in line {first} already; keep one of them, or their mean",
        )


def _check_percent(table: pd.DataFrame) -> Complaints:
    may = table["quantity"].map(lambda name: "%" in QUANTITIES[name].units)
    plain, percent = table[may & (table["unit"] == "1")], table[may & (table["unit"] == "%")]
    limit = plain["quantity"].map(lambda name: QUANTITIES[name].limits[1])
    for _, row in plain[plain["raw"].abs() > limit].iterrows():
        yield (
            row["line"],
            f"{QUANTITIES[row['quantity']].words()} {row['raw']:g} with unit 1 looks like percent; "
            "write unit %",
        )
    if len(percent) and (percent["raw"].abs() < 1).all():
        yield (
            percent["line"].iloc[0],
            f"values with unit % are all below 1 (here {percent['raw'].iloc[0]:g}) and look like "
            "fractions; write unit 1",
        )


def _check_size(table: pd.DataFrame, strain_exponent: float | None) -> Complaints:
    for _, row in table.iterrows():
        value, kind = row["value"], QUANTITIES[row["quantity"]]
        low, high = kind.limits
        if kind.is_strain:
            yield from _check_strain(row, high, strain_exponent)
        elif not low <= value <= high:
            litres = kind.unit == "mL" and low <= 1000 * value <= high
            if litres:
                remedy = "looks like litres; give mL"
            else:
                remedy = f"it lies between {low:g} and {high:g}; check value and unit"
            yield (
                row["line"],
                f"{kind.name} {value:g}{after_number(kind.unit)} is not one of a left ventricle; "
                f"{remedy}",
            )


def check_sd(table: pd.DataFrame) -> Complaints:
    """An sd beyond what a value of its quantity can be is one in another unit; a volume with hardly
    any leaves a posterior that cannot be sampled."""
    for _, row in table[table["sd"].notna()].iterrows():
        kind = QUANTITIES[row["quantity"]]
        least = math.ceil(100 * LEAST_VOLUME_SHARE * row["value"]) / 100
        if row["quantity"] == "volume" and row["sd"] < least:
            yield (
                row["line"],
                f"sd {row['sd']:g} mL of a volume of {row['value']:g} mL: nobody measures it that "
                f"well; give at least {least:g} mL, or leave it empty (an sd of "
                f"{100 * VOLUME_SHARE:g} % then)",
            )
        if kind.is_strain and row["sd"] > LARGEST_SD:
            yield (
                row["line"],
                f"sd {row['sd']:g} of a {row['quantity']} strain (as a fraction): it counts in the "
                "unit of its value, and is too large; correct it, or leave the column empty",
            )


def _check_strain(row: pd.Series, largest: float, exponent: float | None) -> Complaints:
    """A strain (stretch^n - 1) / n lies above -1 / n for n above zero, below it for n below."""
    value, end = row["value"], -1 / exponent if exponent else math.nan
    # Where the exponent is 0 or not known, nothing is beyond the end.
    if exponent and (value - end) * exponent <= 0:
        measure = seth_hill.measure_name(exponent)
        yield (
            row["line"],
            f"{row['quantity']} strain {value:g}: no {measure} strain reaches {end:g}; check value "
            "and unit, and whether it is another strain measure (observables.strain_exponent)",
        )
    elif abs(value) > largest:
        yield row["line"], f"{row['quantity']} strain {value:g} is absurd; check value and unit"


def _check_signs(table: pd.DataFrame) -> Complaints:
    for (quantity, _), rows in table.groupby(["quantity", "load_fraction"], sort=False):
        sign = QUANTITIES[quantity].sign
        wrong = rows[rows["value"] * sign < 0]
        word = "negative" if sign < 0 else "positive"
        if len(wrong) > max(len(rows) / 2, 1):
            yield (
                wrong["line"].iloc[0],
                f"{len(wrong)} of {len(rows)} {quantity} values have the wrong sign; with end "
                f"diastole as the reference, as here, {quantity} values are {word}. A Green strain "
                "e with the unloaded state as its reference becomes -e / (1 + 2 e)",
            )
        tolerance = BULGE + 3 * wrong["sd"].fillna(0.0)
        for _, row in wrong[wrong["value"].abs() > tolerance].iterrows():
            yield (
                row["line"],
                f"{row['output']} is {row['value']:g}, and {quantity} values are {word} (end "
                "diastole is the reference); correct the sign, or remove the channel",
            )


def _check_observed(table: pd.DataFrame, channels: Channels) -> Complaints:
    """Rows that the study does not observe, and where it would learn to."""
    for _, row in table[~table["output"].isin(channels.names)].iterrows():
        if row["quantity"] not in channels.quantities:
            remedy = f"add {row['quantity']} to observables.quantities"
        elif row["load_fraction"] not in channels.load_fractions:
            remedy = f"add {row['load_fraction']:g} to loading.frames"
        else:
            remedy = f"add {row['place']} to observables.places.{row['quantity']}"
        yield (
            row["line"],
            f"{row['output']} is no channel that the study observes; {remedy}, or remove the row",
        )


def _check_noise(path: str | Path, table: pd.DataFrame) -> None:
    others = table[table["quantity"] != "volume"]
    without = others["sd"].isna()
    if without.any() and not without.all():
        raise error_at(
            path,
            others.loc[without, "line"].iloc[0],
            "no sd, where other channels have one; give all of them one (known noise) or none "
            "(noise is inferred)",
        )


# ------------------------------------------------------------------------ writing and making


def write_measured(table: pd.DataFrame, path: str | Path) -> None:
    """Write a table as returned by `read_measured` in the tidy form, in the quantities' units."""
    kinds = table["quantity"].map(QUANTITIES.__getitem__)
    tidy = table.assign(
        segment=table["place"].map(lambda place: str(int(place)) if place.isdigit() else place),
        unit=[kind.unit for kind in kinds],
    )
    optional = [name for name in ("sd", *PASSED_ON) if name in tidy and tidy[name].notna().any()]
    if (tidy["load_fraction"] < 1).any():
        optional.append("load_fraction")
    tidy[[*REQUIRED, *optional]].to_csv(path, index=False)


def import_measured(
    file: str | Path,
    channels: Channels,
    pressure_mmhg: float,
    strain_exponent: float,
    parameters: StiffnessInputs,
    measured: str | Path,
    segments: int = 17,
) -> None:
    """Check a user's `file` and write it to `measured` in the units used inside.

    Raises InputError as `read_measured`; warns of what it cannot tell about `parameters`.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeasuredWarning)
        table = read_measured(file, channels, pressure_mmhg, strain_exponent, segments)
    for shortcoming in shortcomings(table, len(parameters)):
        warnings.warn(f"{file}: {shortcoming}", MeasuredWarning, stacklevel=2)
    write_measured(table, measured)


def make_table(channels, values: np.ndarray) -> pd.DataFrame:
    """A measured table without noise."""
    return pd.DataFrame(
        {
            "output": [channel.name for channel in channels],
            "quantity": [channel.quantity for channel in channels],
            "place": [channel.place for channel in channels],
            "segment": pd.array([channel.segment for channel in channels], dtype="Int64"),
            "load_fraction": [channel.load_fraction for channel in channels],
            "value": values,
            "sd": np.nan,
        }
    )


def observed(table: pd.DataFrame, channels: Channels) -> pd.DataFrame:
    """The rows of the channels that a study observes."""
    return table[table["output"].isin(channels.names)].reset_index(drop=True)
