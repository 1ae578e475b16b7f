"""Finished simulations from tables, in place of the simulator: read, checked, split, kept."""

import logging
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.errors import InputError
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

SENSITIVITY = "sensitivity"
"""Optional column of an outputs table (Parquet): 520 numbers, d(outputs)/d(theta), row by row."""


def read_tables(
    inputs: str | Path, outputs: str | Path, lower: float, upper: float
) -> pd.DataFrame:
    """The simulations of two tables with as many rows: `sample`, the ten parameters, the 52 outputs
    and, if the outputs have it, `sensitivity`.

    A table is Parquet or CSV with columns named as in `aha.PARAMETERS` and `aha.OUTPUTS` (others
    are ignored; one file may be both), or CSV without a header in the published order: C_a, C_b of
    anterior, inferior, lateral, septal, apical; volume, then 17 circumferential, radial and
    longitudinal strains in the published order of the segments.

    Raises InputError, with file and row or column, for a table that has other columns, cells that
    are no finite numbers, parameters outside [lower, upper], or another number of rows.
    """
    theta, _ = _read(inputs, aha.PARAMETERS)
    y, extra = _read(outputs, aha.OUTPUTS)
    if len(theta) != len(y):
        raise InputError(
            f"{outputs}: {len(y)} rows of outputs to {len(theta)} rows of inputs ({inputs}); give "
            "one row of each per simulation, in the same order"
        )
    outside = (theta < lower) | (theta > upper)
    if outside.any():
        row, column = np.argwhere(outside)[0]
        raise InputError(
            f"{inputs}: row {row + 1}, {aha.PARAMETERS[column]}: {theta[row, column]:g} lies "
            f"outside [{lower:g}, {upper:g}] ({int(outside.any(axis=1).sum())} such rows); "
            "remove them, or set design.lower and design.upper to what was simulated"
        )
    table = pd.DataFrame({"sample": np.arange(len(theta))})
    table[list(aha.PARAMETERS)] = theta
    table = table.join(pd.DataFrame(y, columns=list(aha.OUTPUTS)))
    return table.join(extra)


def _read(path: str | Path, names: tuple[str, ...]) -> tuple[np.ndarray, pd.DataFrame]:
    """Numbers (N, len(names)) in the order of `names`, and the sensitivities if there are any."""
    table = _load(Path(path))
    if all(isinstance(name, str) for name in table.columns):
        missing = [name for name in names if name not in table]
        if missing:
            raise InputError(
                f"{path}: no column {', '.join(missing[:5])} ({len(missing)} missing); name the "
                f"columns {names[0]}, {names[1]}, ..., or give CSV without a header in the "
                "published order"
            )
        values = table[list(names)]
    elif table.shape[1] != len(names):
        raise InputError(
            f"{path}: {table.shape[1]} columns without a header; the published order has "
            f"{len(names)} ({names[0]}, {names[1]}, ...); add what is missing or name the columns"
        )
    else:
        values = table
    numbers = values.apply(pd.to_numeric, errors="coerce").to_numpy(float)
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
    if values is table and names == aha.OUTPUTS:
        numbers = aha.outputs_from_published(numbers)
    kept = [SENSITIVITY] if SENSITIVITY in table and names == aha.OUTPUTS else []
    return numbers, table[kept]


def _load(path: Path) -> pd.DataFrame:
    """Columns are named by numbers where the file has no header."""
    try:
        if path.suffix == ".parquet":
            return pd.read_parquet(path)
        with path.open() as lines:
            first = lines.readline().split(",")
        return pd.read_csv(path, header=None if all(map(_is_number, first)) else 0)
    except (OSError, ValueError, pd.errors.ParserError) as error:
        raise InputError(
            f"{path}: cannot be read as a table ({error}); give Parquet, or CSV with as many cells "
            "in every row"
        ) from error


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def split(rows: int, holdout: int, most: int | None, seed: int) -> dict[str, np.ndarray]:
    """Row numbers, ascending, of `train` and `test`: a random `holdout` of `rows`, and at most
    `most` of the others (all of them if None). The test set does not depend on `most`.

    Raises InputError if nothing is left to train on.
    """
    if holdout >= rows:
        raise InputError(
            f"simulations.holdout: {holdout} of {rows} simulations leave none to train on; lower "
            "it, or give a test table (simulations.tables.test)"
        )
    order = np.random.default_rng(derive(seed, "holdout")).permutation(rows)
    test, train = order[:holdout], order[holdout:]
    return {"test": np.sort(test), "train": np.sort(train[:most])}


def import_simulations(
    name: str,
    inputs: str | Path,
    outputs: str | Path,
    own_test: bool,
    holdout: int,
    rows: int | None,
    bounds: tuple[float, float],
    seed: int,
    kept: str | Path,
) -> None:
    """Write the set `name` in the form of screened simulations (Parquet).

    inputs, outputs: the set's own tables, or those of `train` for a held-out `test`. own_test:
    whether the test set has tables of its own, so that nothing is held out. rows: how many
    training simulations to keep at most. `sample` is the row in the tables, from 0.

    Raises InputError as `read_tables` and `split` do.
    """
    table = read_tables(inputs, outputs, *bounds)
    if name in ("train", "test") and not (name == "test" and own_test):
        table = table.iloc[split(len(table), 0 if own_test else holdout, rows, seed)[name]]
    table.to_parquet(kept, index=False)
    log.info("%s: %d simulations from %s and %s", name, len(table), inputs, outputs)
