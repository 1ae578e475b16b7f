"""Which simulations enter the study, and where in the parameter box the others lie."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.inputs.coordinates import Coordinates
from regional_lv.inputs.stiffness import StiffnessInputs

UNSTABLE = "next to a limit of stability: derivatives are many times those of the others"
NOT_FINITE = "an output is not finite"
"""Reasons of simulations that are left out although they converged."""


def screen(
    batches: Sequence[str | Path],
    parameters: StiffnessInputs | Coordinates,
    channels: Channels,
    steepest: float | None = None,
):
    """Merge batch tables; return (converged, excluded, summary).

    `converged` holds the simulations to learn from, sorted by sample. `excluded` lists the rest
    with reason, last converged pressure and, per parameter, the place in the box: 0 at its lower
    bound, 1 at its upper one on its scale. `summary` is one row of counts, costs and the range
    of the channels that are no wall strain.

    steepest: simulations whose derivatives are, root mean square, more than as many times the
    median's are left out (None: none). Next to a state at which the wall loses its stability, as
    soft ones do between the cavity's pressure and stiff springs outside, derivatives grow without
    bound, and an emulator of smooth functions that learns from one is wrong far around it.

    Raises InputError if nothing converged.
    """
    table = pd.concat([pd.read_parquet(path) for path in batches], ignore_index=True)
    table = table.sort_values("sample", ignore_index=True)
    finite = np.isfinite(table[list(channels.names)].to_numpy(dtype=float)).all(axis=1)
    converged = table["status"] == "converged"
    table.loc[converged & ~finite, "reason"] = NOT_FINITE
    kept = converged & finite
    if not kept.any():
        raise InputError(
            f"{batches[0]}: none of {len(table)} simulations converged; see the column `reason`, "
            "then check `material`, `loading.pressure_mmhg` and the mesh"
        )
    if steepest is not None:
        steep = _steepness(table[kept], parameters.coordinates, len(channels))
        unstable = steep > steepest * steep.median()
        table.loc[unstable.index[unstable], "reason"] = UNSTABLE
        kept &= ~unstable.reindex(table.index, fill_value=False)
    excluded = table.loc[
        ~kept, ["sample", "scale", "reason", "last_pressure_mmhg", "newton_steps", "cpu_s"]
    ]
    lost, space = table.loc[~kept, list(parameters.names)].to_numpy(float), parameters.coordinates
    low, high = space.scaled(space.lower), space.scaled(space.upper)
    place = (space.scaled(lost) - low) / (high - low)
    places = {
        column: values
        for name, value, share in zip(space.names, lost.T, place.T, strict=True)
        for column, values in ((name, value), (f"place_{name}", share))
    }
    excluded = pd.concat([excluded, pd.DataFrame(places, index=excluded.index)], axis=1)
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


def _steepness(table: pd.DataFrame, space: Coordinates, outputs: int) -> pd.Series:
    """By simulation, the root mean square over the outputs of an output's root mean square change
    over the inputs' ranges, divided by its median over the table, so that no simulation makes its
    own measure. Outputs that hardly any simulation changes do not count."""
    theta = table[list(space.names)].to_numpy(float)
    slopes = np.stack(table["sensitivity"].to_list()).reshape(len(table), outputs, len(space))
    range_ = space.scaled(space.upper) - space.scaled(space.lower)
    change = slopes * (space.slope(theta) * range_)[:, None]
    size = np.sqrt(np.square(change).mean(axis=2))
    median = np.median(size, axis=0)
    relative = np.divide(size, median, out=np.zeros_like(size), where=median > 0)
    return pd.Series(np.sqrt(np.square(relative).mean(axis=1)), index=table.index)


def screen_simulations(
    batches: Sequence[str | Path],
    parameters: StiffnessInputs | Coordinates,
    channels: Channels,
    kept: str | Path,
    excluded: str | Path,
    summary: str | Path,
    steepest: float | None = None,
) -> None:
    """Write the three tables of `screen`: Parquet, CSV, CSV."""
    converged, others, counts = screen(batches, parameters, channels, steepest)
    converged.to_parquet(kept, index=False)
    others.to_csv(excluded, index=False)
    counts.to_csv(summary, index=False)
