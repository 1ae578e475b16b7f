"""Tables of a set of posteriors with a known truth."""

from collections.abc import Sequence
from pathlib import Path

import arviz as az
import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.errors import InputError
from regional_lv.inference.correlations import correlate
from regional_lv.inference.diagnostics import coverage, diagnose, map_errors, recovery


def hpd_widths(table: pd.DataFrame) -> pd.DataFrame:
    """Widths of the 95 % HPD intervals, apart for the stiffened zone's parameters and the others.

    table: of `recovery`. Columns: parameter (ten, then `all`), zone (the parameter's), stiffened
    (bool), cases, mean, median, q25, q75, min, max.
    """
    zone = table["parameter"].str[4:]
    stiffened = (table["zone"] == zone) | (table["zone"] == "all")
    each = pd.concat([table, table.assign(parameter="all")], ignore_index=True)
    each["stiffened"] = pd.concat([stiffened, stiffened], ignore_index=True)
    groups = each.groupby(["parameter", "stiffened"])["hpd_width95"]
    widths = groups.agg(
        cases="size",
        mean="mean",
        median="median",
        q25=lambda values: values.quantile(0.25),
        q75=lambda values: values.quantile(0.75),
        min="min",
        max="max",
    ).reset_index()
    order = {name: i for i, name in enumerate((*aha.PARAMETERS, "all"))}
    widths = widths.sort_values(
        ["parameter", "stiffened"],
        key=lambda column: column.map(order) if column.name == "parameter" else column,
        ignore_index=True,
    )
    is_all = widths["parameter"] == "all"
    widths.insert(1, "zone", widths["parameter"].str[4:].where(~is_all, "all"))
    return widths


TABLES = (
    *("diagnostics", "recovery", "coverage", "map_mse", "hpd"),
    *("correlations", "zone_correlations"),
)
"""Tables of a set of posteriors; each is a CSV file of that name."""


def summarise_posteriors(posteriors: Sequence[str | Path], folder: str | Path) -> None:
    """Summarise batches of posteriors with a known truth (NetCDF) in the CSV files `TABLES`.

    `diagnose`, `recovery`, `coverage`, `map_errors`, `hpd_widths` and `correlations.correlate` say
    what is in them. Raises InputError if a file has no `theta_true`.
    """
    checks, recovered, draws = [], [], []
    for path in posteriors:
        data = az.from_netcdf(path)
        if "theta_true" not in data.constant_data:
            raise InputError(f"{path}: no `theta_true`; summarise posteriors of simulated cases")
        check = diagnose(data)
        bounds = (data.posterior.attrs["lower"], data.posterior.attrs["upper"])
        recovered.append(recovery(data, check, *bounds))
        checks.append(check)
        theta = data.posterior["theta"].transpose("case", "chain", "draw", "parameter").to_numpy()
        draws.append(theta.reshape(len(theta), -1, theta.shape[-1]))
    table = pd.concat(recovered, ignore_index=True)
    between, zones = correlate(np.concatenate(draws))
    made = (
        *(pd.concat(checks, ignore_index=True), table, coverage(table), map_errors(table)),
        *(hpd_widths(table), between, zones),
    )
    for name, content in zip(TABLES, made, strict=True):
        content.to_csv(Path(folder) / f"{name}.csv", index=False)
