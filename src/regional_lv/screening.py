"""Which simulations enter the study, and where in the parameter box the others lie."""

from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.errors import InputError


def screen(batches: list[Path], lower: float, upper: float):
    """Merge batch tables; return (converged, excluded, summary).

    `converged` holds the simulations to learn from, sorted by sample. `excluded` lists the rest
    with reason, last converged pressure and, per parameter, the place in the box: 0 at `lower`,
    1 at `upper` on the log scale. `summary` is one row of counts and costs.

    Raises InputError if nothing converged.
    """
    table = pd.concat([pd.read_parquet(path) for path in batches], ignore_index=True)
    table = table.sort_values("sample", ignore_index=True)
    finite = np.isfinite(table[list(aha.OUTPUTS)].to_numpy(dtype=float)).all(axis=1)
    kept = (table["status"] == "converged") & finite
    if not kept.any():
        raise InputError(
            f"{batches[0]}: none of {len(table)} simulations converged; see the column `reason`, "
            "then check `material`, `loading.pressure_mmhg` and the mesh"
        )
    excluded = table.loc[
        ~kept, ["sample", "scale", "reason", "last_pressure_mmhg", "newton_steps", "cpu_s"]
    ].copy()
    span = np.log(upper / lower)
    for name in aha.PARAMETERS:
        excluded[name] = table.loc[~kept, name]
        excluded[f"place_{name}"] = np.log(table.loc[~kept, name] / lower) / span
    cost = table["cpu_s"]
    summary = pd.DataFrame(
        {
            "simulations": [len(table)],
            "converged": [int(kept.sum())],
            "converged_percent": [100 * kept.mean()],
            "cpu_s_mean": [cost.mean()],
            "cpu_s_median": [cost.median()],
            "cpu_s_p95": [cost.quantile(0.95)],
            "newton_steps_median": [table["newton_steps"].median()],
            "newton_steps_p95": [table["newton_steps"].quantile(0.95)],
            "volume_ml_min": [table.loc[kept, "volume_ml"].min()],
            "volume_ml_max": [table.loc[kept, "volume_ml"].max()],
        }
    )
    return table[kept].reset_index(drop=True), excluded.reset_index(drop=True), summary
