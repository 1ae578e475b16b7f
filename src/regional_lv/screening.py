"""Which simulations enter the study, and where in the parameter box the others lie."""

from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.inputs.coordinates import Coordinates
from regional_lv.parameters import Parameterisation


def screen(batches: list[Path], parameters: Parameterisation | Coordinates, channels: Channels):
    """Merge batch tables; return (converged, excluded, summary).

    `converged` holds the simulations to learn from, sorted by sample. `excluded` lists the rest
    with reason, last converged pressure and, per parameter, the place in the box: 0 at its lower
    bound, 1 at its upper one on its scale. `summary` is one row of counts, costs and the range
    of the channels that are no wall strain.

    Raises InputError if nothing converged.
    """
    table = pd.concat([pd.read_parquet(path) for path in batches], ignore_index=True)
    table = table.sort_values("sample", ignore_index=True)
    finite = np.isfinite(table[list(channels.names)].to_numpy(dtype=float)).all(axis=1)
    kept = (table["status"] == "converged") & finite
    if not kept.any():
        raise InputError(
            f"{batches[0]}: none of {len(table)} simulations converged; see the column `reason`, "
            "then check `material`, `loading.pressure_mmhg` and the mesh"
        )
    excluded = table.loc[
        ~kept, ["sample", "scale", "reason", "last_pressure_mmhg", "newton_steps", "cpu_s"]
    ].copy()
    lost, space = table.loc[~kept, list(parameters.names)].to_numpy(float), parameters.coordinates
    low, high = space.scaled(space.lower), space.scaled(space.upper)
    place = (space.scaled(lost) - low) / (high - low)
    for name, value, share in zip(space.names, lost.T, place.T, strict=True):
        excluded[name], excluded[f"place_{name}"] = value, share
    cost = table["cpu_s"]
    summary = {
        "simulations": len(table),
        "converged": int(kept.sum()),
        "converged_percent": 100 * kept.mean(),
        "cpu_s_mean": cost.mean(),
        "cpu_s_median": cost.median(),
        "cpu_s_p95": cost.quantile(0.95),
        "newton_steps_median": table["newton_steps"].median(),
        "newton_steps_p95": table["newton_steps"].quantile(0.95),
    }
    for channel in channels:
        if not channel.kind.is_strain:
            values = table.loc[kept, channel.name]
            summary |= {f"{channel.name}_min": values.min(), f"{channel.name}_max": values.max()}
    return (
        table[kept].reset_index(drop=True),
        excluded.reset_index(drop=True),
        pd.DataFrame([summary]),
    )


def screen_simulations(
    batches: list[Path],
    parameters: Parameterisation | Coordinates,
    channels: Channels,
    kept: Path,
    excluded: Path,
    summary: Path,
) -> None:
    """Write the three tables of `screen`: Parquet, CSV, CSV."""
    converged, others, counts = screen(batches, parameters, channels)
    converged.to_parquet(kept, index=False)
    others.to_csv(excluded, index=False)
    counts.to_csv(summary, index=False)
