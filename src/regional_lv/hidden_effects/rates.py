"""Shares with their exact intervals, and the table of confusions."""

import pandas as pd
from statsmodels.stats.proportion import proportion_confint


def rate(hits: pd.Series) -> dict:
    """Share of hits with its exact 95 % interval (Clopper-Pearson)."""
    n, k = len(hits), int(hits.sum())
    return {"hits": k, "of": n, **_share(k, n)}


def weighted_rate(hits: pd.Series, weights: pd.Series) -> dict:
    """`share` of hits with weights, and the 95 % interval, `low` and `high`, of as many that count
    the same as are effective (Kish 1965)."""
    effective = weights.sum() ** 2 / (weights**2).sum()
    return _share(effective * (hits * weights).sum() / weights.sum(), effective)


def _share(hits: float, of: float) -> dict:
    if not of:
        return {"share": None, "low": None, "high": None}
    low, high = proportion_confint(min(hits, of), of, method="beta")  # sums of weights round
    return {"share": min(hits / of, 1.0), "low": float(low), "high": float(high)}


def confusions(cases: pd.DataFrame) -> pd.DataFrame:
    """How often each cause (columns) was in the answer to hearts with an effect (rows).

    cases: columns `effect`, and `answer` with names between spaces.
    """
    long = cases.assign(answer=cases["answer"].str.split(" ")).explode("answer")
    return pd.crosstab(long["effect"], long["answer"])
