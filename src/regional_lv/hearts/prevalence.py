"""In how many hearts of a cohort a cause is present: evidence of hearts of any geometry, together.

Of one heart the evidence of all models that hold a cause, weighed by their prior, over that of all
that do not is its Bayes factor B_i. A share f of the hearts has the cause, with a Beta prior, so
that what was measured of all hearts has the density

    p(data | f)  ~  product over hearts of (1 - f + f B_i).

By default the Beta prior has the cause's prior probability in one heart by itself as its mean, so
that hearts which say nothing change no answer of another one.

Hearts are independent given f; a heart that has the cause has a size of its own, uniform within the
range of the input, so that what is alike in all hearts is that they have it, not how much. (The
joint criticism of several hearts of one geometry, `criticism.study.Critic`, has one size for all.)
Each cause is looked at by itself: of two that can replace each other, both are found. An error that
all hearts share, such as the emulator's, counts anew in every heart.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy import special, stats

NODES = 4001
"""Of the integral over the share, equally probable by its prior."""

AS_MANY = 2.0
"""Hearts that the default prior of the share counts as: as many as a uniform one."""

LEVELS = (0.025, 0.5, 0.975)

SOME = 0.95
"""Probability from which on some hearts have a cause: of one that was as probable as not, strong
evidence (Kass and Raftery 1995, doi 10.1080/01621459.1995.10476572)."""


@dataclass(frozen=True)
class Prevalence:
    """Posterior of the share of hearts with a cause: quantiles `LEVELS`; log Bayes factor against
    no heart having it; `among` how many causes it was looked for; of each heart (H,) the
    probability that it has, given all data, and `expected` (H,), given those of the others alone.
    """

    share: tuple[float, ...]
    log_bayes_factor: float
    among: int
    probability: np.ndarray
    expected: np.ndarray

    @property
    def probability_any(self) -> float:
        """That any heart has it, if one cause was expected to be there before the data: the more
        causes are looked for, the more say something by chance."""
        return float(special.expit(self.log_bayes_factor - np.log(self.among)))


def log_bayes_factors(data: xr.DataTree) -> Mapping[str, float]:
    """By cause that was searched in one heart, log of the evidence with it over that without it.

    data: as of `Averaged.to_datatree`.
    """
    models, known = data.sample_stats, data.constant_data
    weighed = (models["log_evidence"] + models["log_prior"]).to_numpy()
    found = {}
    for cause in known["cause"].to_numpy():
        prior = float(known["prior_probability"].sel(cause=cause))
        holds = models["holds"].sel(cause=cause).to_numpy()
        if 0 < prior < 1 and holds.any():
            present, absent = (special.logsumexp(weighed[at]) for at in (holds, ~holds))
            found[str(cause)] = float(present - absent - special.logit(prior))
    return found


def weights_given_others(data: xr.DataTree, expected: Mapping[str, float]) -> np.ndarray:
    """Factors (model,) on the probabilities of the models of one heart: for each cause that a model
    holds, its odds given the other hearts over its prior odds in this one by itself.

    data: as of `Averaged.to_datatree`; expected: by cause, `Prevalence.expected` of this heart.
    Each cause is taken by itself, as its prevalence was.
    """
    by_itself = data.constant_data["prior_probability"].sel(cause=[*expected]).to_numpy()
    change = special.logit([*expected.values()]) - special.logit(by_itself)
    holds = data.sample_stats["holds"].sel(cause=[*expected]).transpose("model", "cause")
    return np.exp(holds.to_numpy() @ change)


def default_prior(by_itself: float) -> tuple[float, float]:
    """Parameters of the Beta prior of the share, from the cause's prior probability in a heart by
    itself."""
    return AS_MANY * by_itself, AS_MANY * (1 - by_itself)


def infer_prevalence(
    log_factors: Sequence[float] | np.ndarray, prior: Sequence[float], among: int = 1
) -> Prevalence:
    """From the log Bayes factors (H,) of hearts; prior: both parameters of the Beta prior; among:
    how many causes."""
    share = stats.beta.ppf((np.arange(NODES) + 0.5) / NODES, *prior)[:, None]
    with np.errstate(divide="ignore"):  # a node may be 0 or 1 to all digits
        present = np.log(share) + np.asarray(log_factors)
        together = np.logaddexp(np.log1p(-share), present)
    logs = together.sum(1)
    weight = special.softmax(logs)
    others = special.softmax(logs[:, None] - together, axis=0)
    ends = np.interp(LEVELS, np.cumsum(weight) - weight / 2, share[:, 0])
    return Prevalence(
        share=tuple(map(float, ends)),
        log_bayes_factor=float(special.logsumexp(logs) - np.log(NODES)),
        among=among,
        probability=weight @ np.exp(present - together),
        expected=share[:, 0] @ others,
    )
