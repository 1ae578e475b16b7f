"""Does importance sampling agree with Pyro's NUTS?"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import arviz as az
import numpy as np
import pandas as pd
import torch

from regional_lv import emulators
from regional_lv.paper.posteriors.sets import likelihoods_of_set
from regional_lv.paper.sampler.files import Posterior, read
from regional_lv.paper.sampler.sampling import Sampled, Sampling, sample_cases, subject_likelihood
from regional_lv.seeds import derive

MEANS, SDS = 0.1, 0.1
"""Largest difference of means, in posterior sd, and of sds, relative, that counts as agreement."""


def compare_samplers(
    emulator_file: str | Path,
    posteriors: Sequence[str | Path],
    set_name: str,
    cases: int,
    noise: dict | None,
    nuts: dict,
    point: dict,
    seed: int,
    table: str | Path,
) -> None:
    """Sample random cases of a set by NUTS and compare with importance sampling (CSV).

    posteriors: batches of the set. cases: how many to draw among those that were sampled by
    importance; all if there are fewer. noise: as in `sets.sample_set_batch`. For the columns
    see `COLUMNS`; cases whose chains fail the convergence check are left out.
    """
    fast = {
        one.case: one for path in posteriors for one in read(path) if one.sampler == "importance"
    }
    rng = np.random.default_rng(derive(seed, "agreement", set_name))
    chosen = sorted(rng.choice(sorted(fast), min(cases, len(fast)), replace=False)) if fast else []
    rows = []
    if chosen:
        observed = [fast[case].groups["observed_data"]["y"] for case in chosen]
        emulator = emulators.load(emulator_file).select(observed[0]["output"].to_numpy().tolist())
        y = torch.as_tensor(np.stack([one.to_numpy() for one in observed]))
        likelihoods = likelihoods_of_set(emulator, y, noise)
        how = Sampling(nuts, point, seed, set_name)
        reference = sample_cases(likelihoods, chosen, how, "nuts")
        rows = _compare(how, [fast[case] for case in chosen], reference)
    pd.DataFrame(rows, columns=COLUMNS).to_csv(table, index=False)


def compare_subject(
    emulator_file: str | Path,
    measured: str | Path,
    posterior: str | Path,
    subject: str,
    nuts: dict,
    point: dict,
    noise_prior_scale: float,
    seed: int,
    table: str | Path,
) -> None:
    """The same table for the posterior of a measured file; empty if NUTS has sampled it."""
    (fast,), rows = read(posterior), []
    if fast.sampler == "importance":
        likelihood = subject_likelihood(emulator_file, measured, noise_prior_scale)
        how = Sampling(nuts, point, seed, "subjects")
        reference = sample_cases([likelihood], [subject], how, "nuts")
        rows = _compare(how, [fast], reference)
    pd.DataFrame(rows, columns=COLUMNS).to_csv(table, index=False)


def _compare(how: Sampling, posteriors: Sequence[Posterior], reference: Sampled) -> list[dict]:
    """Rows of all cases, but those whose chains failed the convergence check: no reference."""
    rows = []
    for fast, draws in zip(posteriors, reference.draws, strict=True):
        if draws.verdict(how.settings) == "passed":
            rows += compare(how.set_name, fast.case, fast.theta, draws.theta)
    return rows


COLUMNS = (
    "set",
    "case",
    "parameter",
    "mean_fast",
    "mean_nuts",
    "sd_fast",
    "sd_nuts",
    "mean_difference_in_sd",
    "monte_carlo_error",
    "sd_ratio",
    "agrees",
)


def compare(
    set_name: str, case: str, fast: Mapping[str, np.ndarray], reference: np.ndarray
) -> list[dict]:
    """Rows of the table for draws of one case by both samplers, (chain, draw) by parameter and
    (chain, draw, P); mean_difference_in_sd has a Monte Carlo error."""
    rows = []
    for i, (name, a) in enumerate(fast.items()):
        b = reference[..., i]
        difference = (a.mean() - b.mean()) / b.std()
        ratio = a.std() / b.std()
        rows.append(
            {
                "set": set_name,
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
