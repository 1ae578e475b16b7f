"""What the prior of the noise scales does to the posterior of a subject."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv.inference.arviz_arrays import hdi95
from regional_lv.paper.sampler.diagnostics import diagnose
from regional_lv.paper.sampler.files import read


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
        (one,) = read(path)
        outside, outputs = count_outside(
            one.groups["posterior_predictive"]["y"].transpose("chain", "draw", "output"),
            one.groups["observed_data"]["y"].to_numpy(),
        )
        verdict = diagnose([one])["verdict"].iloc[0]
        for name, draws in (one.sigma | one.theta).items():
            low, high = hdi95(draws.ravel())
            rows.append(
                {
                    "prior_scale": scale,
                    "parameter": name,
                    "median": float(np.median(draws)),
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
