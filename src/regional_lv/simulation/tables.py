"""Finished simulations from tables, in place of the simulator: read, checked, split, kept."""

import logging
from collections.abc import Collection
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from regional_lv import aha
from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.input_files import reading
from regional_lv.inputs.stiffness import StiffnessInputs, repeated
from regional_lv.seeds import derive
from regional_lv.typed_tables import require_columns

log = logging.getLogger(__name__)

SENSITIVITY = "sensitivity"
"""Optional column of an outputs table (Parquet): d(outputs)/d(theta), D x P numbers, row by row."""

ZONE = "zone"
"""Column of a scenario's inputs table: the stiff zone of each row, or `all`."""


def published_order(parameters: StiffnessInputs, channels: Channels) -> bool:
    """Whether they are the paper's, for which there are tables without a header."""
    return parameters.of_paper and channels == Channels.of()


def read_tables(
    inputs: str | Path,
    outputs: str | Path,
    parameters: StiffnessInputs,
    channels: Channels,
    stiff: Collection[str] = (),
) -> pd.DataFrame:
    """The simulations of two tables with as many rows: `sample`, the P parameters, the D outputs
    and, if the outputs have it, `sensitivity`.

    stiff: of a scenario, what the column `zone` of its inputs may hold (`stiff_zones`); the table
    then has it, too.

    A table is Parquet or CSV with columns named as the parameters and the channels (others are
    ignored; one file may be both). Where these are the paper's, it may be CSV without a header in
    the published order: C_a, C_b of anterior, inferior, lateral, septal, apical; volume, then 17
    circumferential, radial and longitudinal strains in the published order of the segments.

    Raises InputError, with file and row or column, for a table that has other columns, cells that
    are no finite numbers, parameters outside their bounds, zones that are none of `stiff`, or
    another number of rows.
    """
    published = published_order(parameters, channels)
    x = _read(inputs, parameters.names, published, ZONE)
    y = _read(outputs, channels.names, published, SENSITIVITY)
    theta = x[list(parameters.names)].to_numpy()
    if len(theta) != len(y):
        raise InputError(
            f"{outputs}: {len(y)} rows of outputs to {len(theta)} rows of inputs ({inputs}); give "
            "one row of each per simulation, in the same order"
        )
    outside = (theta < parameters.lower) | (theta > parameters.upper)
    if outside.any():
        row, column = np.argwhere(outside)[0]
        at = parameters[column]
        raise InputError(
            f"{inputs}: row {row + 1}, {at.name}: {theta[row, column]:g} lies outside "
            f"[{at.low:g}, {at.high:g}] ({int(outside.any(axis=1).sum())} such rows); remove "
            "them, or set design.lower and design.upper (or parameters.bounds) to what was "
            "simulated"
        )
    twins = repeated(theta)
    if twins is not None:
        raise InputError(
            f"{inputs}: rows {twins[0] + 1} and {twins[1] + 1} have the same parameters; keep each "
            "simulation once (are files joined that share rows?)"
        )
    if SENSITIVITY in y:
        _check_sensitivities(outputs, y[SENSITIVITY], len(channels) * len(parameters))
    table = pd.DataFrame({"sample": np.arange(len(theta))})
    table[list(parameters.names)] = theta
    if stiff:
        _check_zones(inputs, x, stiff)
        table[ZONE] = x[ZONE]
    return table.join(y)


def _check_zones(path: str | Path, table: pd.DataFrame, stiff: Collection[str]) -> None:
    remedy = f"name the stiff zone of every row ({', '.join(stiff)})"
    require_columns(path, table, (ZONE,), remedy)
    for row, zone in enumerate(table[ZONE], start=1):
        if zone not in stiff:
            raise InputError(
                f"{path}: row {row}, column {ZONE}: {zone!r} is no such zone; {remedy}"
            )


def _check_sensitivities(path: str | Path, rows: pd.Series, size: int) -> None:
    for number, row in enumerate(rows, start=1):
        try:
            values = np.asarray(row, dtype=float)
        except (TypeError, ValueError):
            values = np.array([np.nan])
        if values.shape != (size,) or not np.isfinite(values).all():
            raise InputError(
                f"{path}: row {number}, column {SENSITIVITY}: is not {size} finite numbers; "
                "correct it, or leave the column out"
            )


def _read(path: str | Path, names: tuple[str, ...], published: bool, also: str) -> pd.DataFrame:
    """The columns `names` as numbers, and the column `also` as it is, if there is one.

    published: whether the file may be without a header, in the published order.
    """
    table = _load(Path(path))
    outputs = names == Channels.of().names
    if all(isinstance(name, str) for name in table.columns):
        remedy = f"name the columns {', '.join(names[:2])}, ..." + (
            ", or give CSV without a header in the published order" if published else ""
        )
        require_columns(path, table, names, remedy)
        values = table[list(names)]
    elif not published:
        raise InputError(
            f"{path}: has no header, and the published order is that of the paper's parameters and "
            f"channels only; name the columns {', '.join(names[:2])}, ..."
        )
    elif table.shape[1] != len(names):
        raise InputError(
            f"{path}: {table.shape[1]} columns without a header; the published order has "
            f"{len(names)} ({names[0]}, {names[1]}, ...); add what is missing or name the columns"
        )
    else:
        values = table
    numbers = values.apply(_numbers).to_numpy(float)
    if not len(numbers):
        raise InputError(f"{path}: holds no rows; give finished simulations")
    bad = ~np.isfinite(numbers)
    if bad.any():
        row, column = np.argwhere(bad)[0]
        raise InputError(
            f"{path}: row {row + 1}, column {values.columns[column]}: "
            f"{values.iloc[row, column]!r} is not a finite number ({int(bad.any(axis=1).sum())} "
            "such rows); remove failed simulations from both tables"
        )
    if values is table and outputs:
        numbers = aha.outputs_from_published(numbers)
    read = pd.DataFrame(numbers, columns=list(names))
    return read.join(table[also]) if also in table else read


def _numbers(column: pd.Series) -> pd.Series:
    """NaN for what is no number; pandas would make nanoseconds of a date."""
    plain = pd.api.types.is_numeric_dtype(column)
    return pd.to_numeric(column if plain else column.map(str), errors="coerce")


def _load(path: Path) -> pd.DataFrame:
    """Columns are named by numbers where the file has no header."""
    with reading(path, "give Parquet, or CSV in UTF-8 with as many cells in every row"):
        if path.suffix == ".parquet":
            # What pandas notes in the file, such as its index, is not needed and may be wrong.
            return pq.ParquetFile(path).read().to_pandas(ignore_metadata=True)
        with path.open(encoding="utf-8-sig") as lines:
            first = lines.readline().split(",")
        return pd.read_csv(path, header=None if all(map(_is_number, first)) else 0)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def split(rows: int, holdout: int, most: int | None, seed: int) -> dict[str, np.ndarray]:
    """Row numbers, ascending, of `holdout` and `train`: a random `holdout` of `rows`, and at most
    `most` of the others (all of them if None). What is held out does not depend on `most`.

    Raises InputError if nothing is left to train on.
    """
    if holdout >= rows:
        raise InputError(
            f"simulations.holdout: {holdout} of {rows} simulations leave none to train on; lower "
            "it, or set it to 0 and give a test table (simulations.tables.test)"
        )
    order = np.random.default_rng(derive(seed, "holdout")).permutation(rows)
    held_out, train = order[:holdout], order[holdout:]
    return {"holdout": np.sort(held_out), "train": np.sort(train[:most])}


def import_simulations(
    set: str,
    inputs: str | Path,
    outputs: str | Path,
    own_test: bool,
    holdout: int,
    rows: int | None,
    parameters: StiffnessInputs,
    channels: Channels,
    seed: int,
    kept: str | Path,
    stiff: Collection[str] = (),
) -> None:
    """Write the set `set` in the form of screened simulations (Parquet).

    inputs, outputs: the set's own tables, or those of `train` for what is held out of it: the set
    `holdout`, or `test` unless the test set has tables of its own (`own_test`). rows: how many
    training simulations to keep at most. stiff: as in `read_tables`. `sample` is the row in the
    tables, from 0.

    Raises InputError as `read_tables` and `split` do.
    """
    table = read_tables(inputs, outputs, parameters, channels, stiff)
    part = "holdout" if set == "test" and not own_test else set
    if part in ("train", "holdout"):
        table = table.iloc[split(len(table), holdout, rows, seed)[part]]
    table.to_parquet(kept, index=False)
    log.info("%s: %d simulations from %s and %s", set, len(table), inputs, outputs)
