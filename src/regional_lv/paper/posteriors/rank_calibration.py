"""Simulation-based calibration of the inference (Talts et al. 2018, arXiv:1804.06788).

Theta from the prior, outputs from the emulator at that theta with its own error, the posterior of
these outputs, and the rank of theta among the posterior's draws: uniform, if the whole chain from
likelihood to sampler is right. Whether the emulator's error is that of the simulator is another
question, which the coverage on simulated cases answers.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import torch
from scipy import stats
from statsmodels.stats.multitest import multipletests

from regional_lv import emulators
from regional_lv.emulators.training import read_simulations
from regional_lv.paper.posteriors.sets import error_model
from regional_lv.paper.sampler.likelihood import Likelihood
from regional_lv.paper.sampler.sampling import Sampled, Sampling, sample_cases
from regional_lv.seeds import derive

DRAWS = 99
"""Draws of each posterior that the truth is ranked among: a few of many, for ranks of dependent
draws pile up at the ends."""

BINS = 10
LEVEL = 0.05


def calibrate_chain(
    emulator_file: str | Path,
    simulations: str | Path,
    cases: int,
    sampler: str,
    nuts: dict,
    point: dict,
    seed: int,
    ranks: str | Path,
    histogram: str | Path,
    tests: str | Path,
) -> None:
    """Ranks of `cases` prior draws, their histogram and its tests (three CSV).

    simulations: screened table; a local emulator trains around the simulation nearest to the prior
    draw, and that fit both makes the outputs and infers from them.

    ranks: case, parameter, rank, draws, verdict. `tabulate` and `test_ranks` say what is in the
    others.
    """
    emulator, noise = error_model(emulators.load(emulator_file))
    known, outputs, _ = read_simulations(simulations, emulator.parameters, emulator.outputs)
    generator = torch.Generator().manual_seed(derive(seed, "calibration"))
    uniform = torch.rand(cases, len(emulator.lower), generator=generator, dtype=torch.float64)
    theta = emulator.lower + (emulator.upper - emulator.lower) * uniform
    deviates = torch.randn(cases, len(noise.groups), generator=generator, dtype=torch.float64)
    log_sigma = torch.log(noise.prior_scale * deviates.abs())
    common, likelihoods = None, []
    for at, scale in zip(theta, log_sigma, strict=True):
        nearest = np.abs(np.log(known / at.numpy())).sum(axis=1).argmin()
        local = emulator.localise(torch.as_tensor(outputs[nearest]))
        if common is None or local is not emulator:
            common = Likelihood(local, local.output_mean, noise)
        y = common.near(at).draw(at[None], scale[None], generator)[0]
        likelihoods.append(common.at(y))
    how = Sampling(nuts, point, seed, "calibration")
    names, size = [str(i) for i in range(cases)], nuts["cases_per_batch"]
    parts = [
        sample_cases(likelihoods[i : i + size], names[i : i + size], how, sampler)
        for i in range(0, cases, size)
    ]
    table = pd.concat(
        [
            rank(part, theta[i : i + size].numpy(), how)
            for i, part in zip(range(0, cases, size), parts, strict=True)
        ],
        ignore_index=True,
    )
    table.to_csv(ranks, index=False)
    tabulate(table).to_csv(histogram, index=False)
    test_ranks(table, derive(seed, "calibration", "ties")).to_csv(tests, index=False)


def rank(sampled: Sampled, truth: np.ndarray, how: Sampling) -> pd.DataFrame:
    """Rows case, parameter, rank, draws, verdict: how many of the thinned draws lie below `truth`
    (C, P)."""
    rows, names = [], sampled.likelihoods[0].emulator.parameters.names
    for case, draws, true in zip(sampled.cases, sampled.draws, truth, strict=True):
        theta = draws.theta.reshape(-1, draws.theta.shape[-1])
        count = min(DRAWS, len(theta))
        thinned = theta[np.linspace(0, len(theta) - 1, count).astype(int)]
        outcome = draws.verdict(how.settings)
        for name, below in zip(names, (thinned < true).sum(axis=0), strict=True):
            rows.append((case, name, int(below), count, outcome))
    return pd.DataFrame(rows, columns=["case", "parameter", "rank", "draws", "verdict"])


def _groups(table: pd.DataFrame) -> dict[str, pd.DataFrame]:
    return dict(iter(table.groupby("parameter", sort=False)))


def tabulate(table: pd.DataFrame) -> pd.DataFrame:
    """Rank histogram per parameter and over `all`.

    Columns: parameter, cases, draws, bin, lower_rank, upper_rank (included), count, expected.
    """
    draws = int(table["draws"].iloc[0])
    edges = np.linspace(0, draws + 1, BINS + 1).round().astype(int)
    rows = []
    for name, part in (_groups(table) | {"all": table}).items():
        counts, _ = np.histogram(part["rank"], edges - 0.5)
        for i, count in enumerate(counts):
            share = (edges[i + 1] - edges[i]) / (draws + 1)
            rows.append(
                {
                    "parameter": name,
                    "cases": part["case"].nunique(),
                    "draws": draws,
                    "bin": i,
                    "lower_rank": edges[i],
                    "upper_rank": edges[i + 1] - 1,
                    "count": int(count),
                    "expected": share * len(part),
                }
            )
    return pd.DataFrame(rows)


def test_ranks(table: pd.DataFrame, seed: int) -> pd.DataFrame:
    """Are the ranks uniform? Chi-square on the histogram, and Kolmogorov and Smirnov's test.

    Columns: parameter, cases, chi2, p_chi2, ecdf_max (largest distance of the distribution
    functions), p_ecdf, p_holm (of both tests over all parameters, Holm), passed (p_holm above 5 %).
    The row `all` has the smallest p_holm: the parameters of a case are no independent trials.
    """
    rng = np.random.default_rng(seed)
    histogram, rows = tabulate(table), []
    for name, part in _groups(table).items():
        bins = histogram[histogram["parameter"] == name]
        chi2, p_chi2 = stats.chisquare(bins["count"], bins["expected"])
        # Spread evenly within a rank, uniform ranks become uniform numbers.
        places = (part["rank"] + rng.random(len(part))) / (part["draws"] + 1)
        ks = stats.kstest(places, "uniform")
        rows.append(
            {
                "parameter": name,
                "cases": len(part),
                "chi2": chi2,
                "p_chi2": p_chi2,
                "ecdf_max": ks.statistic,
                "p_ecdf": ks.pvalue,
            }
        )
    tested = pd.DataFrame(rows)
    both = tested[["p_chi2", "p_ecdf"]].to_numpy()
    tested["p_holm"] = multipletests(both.ravel(), method="holm")[1].reshape(-1, 2).min(axis=1)
    total = {"parameter": "all", "cases": tested["cases"].iloc[0], "p_holm": tested["p_holm"].min()}
    tested = pd.concat([tested, pd.DataFrame([total])], ignore_index=True)
    tested["passed"] = tested["p_holm"] > LEVEL
    return tested
