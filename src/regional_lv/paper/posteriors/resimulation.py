"""Posterior draws through the simulator: is the emulator right where it matters?"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from regional_lv import emulators
from regional_lv.channels import Channel
from regional_lv.emulators.gaussian import Z95
from regional_lv.emulators.training import read_simulations
from regional_lv.paper.sampler.files import read
from regional_lv.seeds import derive


def pick_draws(
    posteriors: Sequence[str | Path], cases: int, draws: int, seed: int, design: str | Path
) -> None:
    """A design of posterior draws (Parquet): sample, scale (`posterior`), theta, case, draw.

    posteriors: batches of a set. `cases` of them, evenly over the set, `draws` random draws each.
    """
    every = [one for path in posteriors for one in read(path)]
    chosen = np.unique(np.linspace(0, len(every) - 1, min(cases, len(every))).round().astype(int))
    tables = []
    for one in (every[i] for i in chosen):
        flat = pd.DataFrame({name: values.ravel() for name, values in one.theta.items()})
        rng = np.random.default_rng(derive(seed, "resimulated", one.case))
        rows = np.sort(rng.choice(len(flat), draws, replace=False))
        tables.append(flat.iloc[rows].assign(case=one.case, draw=rows))
    table = pd.concat(tables, ignore_index=True)
    table.insert(0, "sample", np.arange(len(table)))
    table.insert(1, "scale", "posterior")
    table.to_parquet(design, index=False)


def compare_resimulated(
    emulator_file: str | Path,
    simulations: str | Path,
    test: str | Path,
    table: str | Path,
    summary: str | Path,
) -> None:
    """The emulator against the simulator at posterior draws (two CSV).

    simulations: screened table of the design of `pick_draws`. test: screened table of the set,
    whose outputs a local emulator trains around. table: case, draw, output, mean, sd (emulator),
    simulator, z, outside (bool: no simulation of the training set is near). summary: that of
    `summarise`.
    """
    emulator = emulators.load(emulator_file)
    model = emulator.parameters, emulator.outputs
    theta, truth, _ = read_simulations(simulations, *model)
    labels = pd.read_parquet(simulations, columns=["case", "draw"])
    _, observed, cases = read_simulations(test, *model)
    places = {case: i for i, case in enumerate(cases)}
    tables = []
    for case, rows in labels.groupby("case", sort=False):
        at = torch.as_tensor(theta[rows.index])
        local = emulator.localise(torch.as_tensor(observed[places[case]]))
        with torch.no_grad():
            prediction = local.predict(at)
        mean, sd = prediction.mean.numpy(), prediction.sd.numpy()
        size = len(local.outputs)
        tables.append(
            pd.DataFrame(
                {
                    "case": case,
                    "draw": np.repeat(rows["draw"].to_numpy(), size),
                    "output": np.tile(local.outputs, len(rows)),
                    "mean": mean.ravel(),
                    "sd": sd.ravel(),
                    "simulator": truth[rows.index].ravel(),
                    "outside": np.repeat(local.outside(at).numpy(), size),
                }
            )
        )
    long = pd.concat(tables, ignore_index=True)
    long["z"] = (long["simulator"] - long["mean"]) / long["sd"]
    columns = ["case", "draw", "output", "mean", "sd", "simulator", "z", "outside"]
    long[columns].to_csv(table, index=False)
    scale = dict(zip(emulator.outputs, emulator.output_sd.tolist(), strict=True))
    summarise(long, scale).to_csv(summary, index=False)


def summarise(long: pd.DataFrame, scale: dict[str, float]) -> pd.DataFrame:
    """Errors over all outputs and over those of each quantity.

    long: columns output, mean, simulator, z, case, draw. scale: training sd by output. Columns:
    output (`all`, then quantities as they begin a column: `volume_ml`, `circumferential`), draws,
    rmse_standardised (over the training sd), z_sd, coverage95.
    """
    error = (long["simulator"] - long["mean"]) / long["output"].map(scale)
    stem = {name: Channel.parse(name).kind.column_of("") for name in long["output"].unique()}
    kind = long["output"].map(stem)
    rows = []
    for name in ("all", *dict.fromkeys(stem.values())):
        here = (kind == name) | (name == "all")
        rows.append(
            {
                "output": name,
                "draws": len(long.loc[here, ["case", "draw"]].drop_duplicates()),
                "rmse_standardised": float(np.sqrt((error[here] ** 2).mean())),
                "z_sd": float(np.sqrt((long.loc[here, "z"] ** 2).mean())),
                "coverage95": float((long.loc[here, "z"].abs() <= Z95).mean()),
            }
        )
    return pd.DataFrame(rows)
