"""What the prior of the noise scales does to the posterior of a subject."""

from collections.abc import Sequence
from pathlib import Path

import arviz as az
import numpy as np
import pandas as pd

from regional_lv.inference.diagnostics import chains_of, diagnose


def compare_noise_priors(
    posteriors: Sequence[str | Path], scales: Sequence[float], table: str | Path
) -> None:
    """Posterior of noise and stiffness for several prior scales, and the fit (CSV).

    posteriors: files of `sample_subject`, in the order of `scales`. Columns: prior_scale (of the
    half-normal priors, training sd), parameter (sigma_<quantity>, then theta's), median, lower95,
    upper95 (HPD), outside (observations outside the central 95 % interval of the posterior
    predictive), outputs (their number), verdict.
    """
    rows = []
    for path, scale in zip(posteriors, scales, strict=True):
        data = az.from_netcdf(path)
        case = data.posterior["case"].to_numpy()[0]
        outside, outputs = count_outside(
            data.posterior_predictive["y"].sel(case=case).transpose("chain", "draw", "output"),
            data.observed_data["y"].sel(case=case).to_numpy(),
        )
        verdict = diagnose(data)["verdict"].iloc[0]
        chains, names = chains_of(data.posterior.sel(case=case))
        inputs = data.posterior.sizes["parameter"]
        for i in (*range(inputs, len(names)), *range(inputs)):
            low, high = az.hdi(chains[..., i].ravel(), hdi_prob=0.95)
            rows.append(
                {
                    "prior_scale": scale,
                    "parameter": names[i],
                    "median": float(np.median(chains[..., i])),
                    "lower95": low,
                    "upper95": high,
                    "outside": outside,
                    "outputs": outputs,
                    "verdict": verdict,
                }
            )
    pd.DataFrame(rows).to_csv(table, index=False)


def count_outside(predictive, observed: np.ndarray) -> tuple[int, int]:
    """How many of the D observations lie outside the central 95 % interval of `predictive`
    (chain, draw, D), and D."""
    draws = np.asarray(predictive).reshape(-1, len(observed))
    low, high = np.quantile(draws, [0.025, 0.975], axis=0)
    return int(((observed < low) | (observed > high)).sum()), len(observed)
