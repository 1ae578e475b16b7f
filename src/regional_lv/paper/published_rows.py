"""The study's simulator against published simulations that no subject of the study is."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.aha import outputs_from_published
from regional_lv.channels import Channels
from regional_lv.simulation.batches import make_runner, run_all, tabulate

NATURAL_ROWS = 4704
"""Rows of the published table on the natural scale, the first ones; the other 957 are logarithmic.
The paper says 4,196 and 1,465."""


def simulate_published_rows(
    mesh: str | Path,
    predictor: str | Path,
    inputs: str | Path,
    outputs: str | Path,
    physics: dict,
    used: Sequence[int],
    most: int,
    rows: str | Path,
) -> None:
    """Simulate `most` rows of the published inputs, evenly spread over those that are not `used`.

    inputs, outputs: header-less CSV, N rows of the paper's 10 parameters and 52 outputs. used: row
    numbers, from 1. Writes (Parquet) one line per row and channel: row, output, quantity, level,
    simulated, published; simulated is NaN where a run failed.
    """
    theta = np.loadtxt(inputs, delimiter=",")
    published = outputs_from_published(np.loadtxt(outputs, delimiter=","))
    free = np.setdiff1d(np.arange(len(theta)), np.asarray(used, dtype=int) - 1)
    chosen = free[np.linspace(0, len(free) - 1, min(most, len(free))).round().astype(int)]
    runner = make_runner(mesh, physics, predictor, sensitivities=False)
    results, channels = run_all(runner, theta[chosen], "published rows", chosen + 1), Channels.of()
    simulated = tabulate(pd.DataFrame({"row": chosen + 1}), results, runner.channels)
    table = {
        "row": np.repeat(chosen + 1, len(channels)),
        "output": np.tile(channels.names, len(chosen)),
        "quantity": np.tile([c.quantity for c in channels], len(chosen)),
        "level": np.tile([c.level for c in channels], len(chosen)),
        "simulated": simulated[list(channels.names)].to_numpy().ravel(),
        "published": published[chosen].ravel(),
    }
    pd.DataFrame(table).to_parquet(rows, index=False)


def summarise_published_rows(rows: str | Path, summary: str | Path) -> None:
    """Write the errors (CSV) by scale of the design, quantity and level, where `all` stands for all
    scales, all levels, or all strains.

    Columns: scale, quantity, level, simulations; mean and rms of simulated less published;
    median_rms, the median over the simulations of each one's rms, which a few soft ventricles with
    strains above one do not decide; published_sd.
    """
    table = pd.read_parquet(rows).dropna(subset=["simulated"])
    natural = table["row"] <= NATURAL_ROWS
    found = []
    for scale, part in {"all": table, "natural": table[natural], "log": table[~natural]}.items():
        strains = part[part["quantity"] != "volume"]
        groups = [
            (("strains", "all"), strains),
            *(((name, "all"), own) for name, own in strains.groupby("quantity", sort=False)),
            *part.groupby(["quantity", "level"], sort=False),
        ]
        for (quantity, level), own in groups:
            if len(own):
                at = {"scale": scale, "quantity": quantity, "level": level}
                found.append(at | _errors(own))
    pd.DataFrame(found).to_csv(summary, index=False)


def _errors(part: pd.DataFrame) -> dict[str, float]:
    error = part["simulated"] - part["published"]
    by_row = (error**2).groupby(part["row"]).mean() ** 0.5
    return {
        "simulations": len(by_row),
        "mean_error": error.mean(),
        "rms_error": (error**2).mean() ** 0.5,
        "median_rms": by_row.median(),
        "published_sd": part["published"].std(),
    }
