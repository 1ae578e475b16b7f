"""Does the fast sampler agree with Pyro's NUTS?"""

import logging
from collections.abc import Sequence
from pathlib import Path

import arviz as az
import numpy as np
import pandas as pd
import torch

from regional_lv import emulators
from regional_lv.inference.sampling import Sampling, error_model, make_likelihoods
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

MEANS, SDS = 0.1, 0.1
"""Largest difference of means, in posterior sd, and of sds, relative, that counts as agreement."""


def compare_samplers(
    emulator_file: str | Path,
    posteriors: Sequence[str | Path],
    cases: int,
    nuts: dict,
    point: dict,
    seed: int,
    table: str | Path,
) -> None:
    """Sample random cases of the test set by NUTS and compare with batched HMC (CSV).

    posteriors: batches of the test set. cases: how many to draw among those that batched HMC
    sampled; all if there are fewer. Columns: case, parameter, mean_fast, mean_nuts, sd_fast,
    sd_nuts, mean_difference_in_sd, its Monte Carlo error, sd_ratio, agrees.
    """
    batches = [az.from_netcdf(path) for path in posteriors]
    fast = {
        str(case): (data, case)
        for data in batches
        for case in data.posterior["case"].to_numpy()
        if str(data.constant_data["sampler"].sel(case=case).item()) == "hmc"
    }
    names = sorted(fast)
    rng = np.random.default_rng(derive(seed, "agreement"))
    chosen = sorted(rng.choice(names, min(cases, len(names)), replace=False)) if names else []
    emulator, kind = error_model(emulators.load(emulator_file))
    how, rows = Sampling(nuts, point, seed, "test"), []
    if chosen:
        data = [fast[case] for case in chosen]
        y = [one.observed_data["y"].sel(case=label).to_numpy() for one, label in data]
        likelihoods = make_likelihoods(emulator, torch.as_tensor(np.stack(y)), kind)
        log.info("%s: %d posteriors by NUTS, in step", emulator.name, len(chosen))
        reference = how.by_nuts(likelihoods, how.find_maxima(likelihoods), chosen)
        for case, (one, label), draws in zip(chosen, data, reference, strict=True):
            ours = one.posterior["theta"].sel(case=label).transpose("chain", "draw", "parameter")
            rows += compare(case, ours.to_numpy(), draws.theta, emulator.parameters.names)
    pd.DataFrame(rows, columns=COLUMNS).to_csv(table, index=False)


COLUMNS = (
    *("case", "parameter", "mean_fast", "mean_nuts", "sd_fast", "sd_nuts"),
    *("mean_difference_in_sd", "monte_carlo_error", "sd_ratio", "agrees"),
)


def compare(
    case: str, fast: np.ndarray, reference: np.ndarray, parameters: Sequence[str]
) -> list[dict]:
    """Rows of the table for draws (chain, draw, P) of one case and of `parameters` by both
    samplers."""
    rows = []
    for i, name in enumerate(parameters):
        a, b = fast[..., i], reference[..., i]
        difference = (a.mean() - b.mean()) / b.std()
        ratio = a.std() / b.std()
        rows.append(
            {
                "case": case,
                "parameter": name,
                "mean_fast": a.mean(),
                "mean_nuts": b.mean(),
                "sd_fast": a.std(),
                "sd_nuts": b.std(),
                "mean_difference_in_sd": difference,
                "monte_carlo_error": np.hypot(az.mcse(a), az.mcse(b)) / b.std(),
                "sd_ratio": ratio,
                "agrees": bool(abs(difference) <= MEANS and abs(ratio - 1) <= SDS),
            }
        )
    return rows
