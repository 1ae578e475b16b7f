"""Estimates passed back through the simulator: do they give the outputs they were made from?"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.simulation.batches import make_runner
from regional_lv.study.progress import Progress


def simulate_estimates(
    mesh: Path, physics: dict, predictor: Path, estimates: Path, cases: int | None, checked: Path
) -> None:
    """Simulate the estimates of the first `cases` samples (all if None); write a table (Parquet).

    Columns: sample, estimator, status, checked_by (`simulator`), the outputs (NaN where the
    simulation did not converge).
    """
    table = first_cases(pd.read_parquet(estimates), cases)
    runner = make_runner(mesh, physics, predictor, sensitivities=False)
    progress = Progress("simulations of estimates", len(table))
    status, values = [], []
    outputs = runner.channels.names
    nothing = np.full(len(outputs), np.nan)
    for theta in table[list(runner.parameters.names)].to_numpy():
        result = runner.run(theta)
        status.append(result.status)
        observed = result.observables if result.status == "converged" else None
        values.append(nothing if observed is None else observed)
        progress.step(failed=observed is None)
    write_checked(table, status, "simulator", np.stack(values), outputs, checked)


def first_cases(estimates: pd.DataFrame, cases: int | None) -> pd.DataFrame:
    """Rows of the first `cases` samples, in the order in which they first appear."""
    names = estimates["sample"].drop_duplicates()
    return estimates[estimates["sample"].isin(names.iloc[:cases])]


def write_checked(
    estimates: pd.DataFrame,
    status: str | Sequence[str],
    checked_by: str,
    values: np.ndarray,
    outputs: Sequence[str],
    path: Path,
) -> None:
    """Write the table that `simulate_estimates` describes; `values` (rows, D) of the `outputs`."""
    table = estimates[["sample", "estimator"]].reset_index(drop=True)
    table["status"], table["checked_by"] = status, checked_by
    table.join(pd.DataFrame(values, columns=list(outputs))).to_parquet(path, index=False)
