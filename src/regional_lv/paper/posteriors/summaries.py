"""Tables of a set of posteriors with a known truth."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.errors import InputError
from regional_lv.paper.posteriors.correlations import correlate
from regional_lv.paper.posteriors.recovery import coverage, map_errors, recovery
from regional_lv.paper.sampler.diagnostics import diagnose
from regional_lv.paper.sampler.files import read


def summarise_posteriors(posteriors: Sequence[str | Path], tables: Sequence[str | Path]) -> None:
    """Summarise batches of posteriors with a known truth (NetCDF) in tables (CSV, in the order of
    `files.TABLES`).

    `diagnose`, `recovery`, `coverage`, `map_errors` and `correlations.correlate` say what is in
    them. Raises InputError if a file has no `theta_true`.
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
    between, zones = correlate(np.stack(draws), cases[0].parameters)
    made = (
        pd.concat(checks, ignore_index=True),
        table,
        coverage(table),
        map_errors(table),
        between,
        zones,
    )
    for path, content in zip(tables, made, strict=True):
        content.to_csv(path, index=False)
