"""Tables of a set of posteriors with a known truth."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.errors import InputError
from regional_lv.inference.diagnostics import diagnose
from regional_lv.inference.posteriors import read
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.posteriors.correlations import correlate
from regional_lv.paper.posteriors.recovery import coverage, map_errors, recovery


def hpd_widths(table: pd.DataFrame, parameters: StiffnessInputs) -> pd.DataFrame:
    """Widths of the 95 % HPD intervals, apart for the stiffened zone's parameters and the others.

    table: of `recovery`. Columns: parameter (P, then `all`), zone (the parameter's), stiffened
    (bool), cases, mean, median, q25, q75, min, max.
    """
    zone_of = {p.name: p.zone for p in parameters} | {"all": "all"}
    zone = table["parameter"].map(zone_of)
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
    order = {name: i for i, name in enumerate(zone_of)}
    widths = widths.sort_values(
        ["parameter", "stiffened"],
        key=lambda column: column.map(order) if column.name == "parameter" else column,
        ignore_index=True,
    )
    widths.insert(1, "zone", widths["parameter"].map(zone_of))
    return widths


TABLES = (
    "diagnostics",
    "recovery",
    "coverage",
    "map_mse",
    "hpd",
    "correlations",
    "zone_correlations",
)
"""Tables of a set of posteriors, in the order in which `summarise_posteriors` writes them."""


def summarise_posteriors(posteriors: Sequence[str | Path], tables: Sequence[str | Path]) -> None:
    """Summarise batches of posteriors with a known truth (NetCDF) in the files (CSV) of `TABLES`.

    `diagnose`, `recovery`, `coverage`, `map_errors`, `hpd_widths` and `correlations.correlate` say
    what is in them. Raises InputError if a file has no `theta_true`.
    """
    checks, recovered, draws = [], [], []
    for path in posteriors:
        cases = read(path)
        if not all(one.truth for one in cases):
            raise InputError(f"{path}: no `theta_true`; summarise posteriors of simulated cases")
        check = diagnose(cases)
        recovered.append(recovery(cases, check))
        checks.append(check)
        draws += [np.stack([*map(np.ravel, one.theta.values())], axis=-1) for one in cases]
    table = pd.concat(recovered, ignore_index=True)
    parameters = cases[0].parameters
    between, zones = correlate(np.stack(draws), parameters)
    made = (
        pd.concat(checks, ignore_index=True),
        table,
        coverage(table),
        map_errors(table),
        hpd_widths(table, parameters),
        between,
        zones,
    )
    for path, content in zip(tables, made, strict=True):
        content.to_csv(path, index=False)
