"""Shares with their exact intervals, and the table of confusions."""

import pandas as pd
from statsmodels.stats.proportion import proportion_confint


def rate(hits: pd.Series) -> dict:
    """Share of hits with its exact 95 % interval (Clopper-Pearson)."""
    n, k = len(hits), int(hits.sum())
    if not n:
        return {"hits": 0, "of": 0, "share": None, "low": None, "high": None}
    low, high = proportion_confint(k, n, method="beta")
    return {"hits": k, "of": n, "share": k / n, "low": low, "high": high}


def confusions(cases: pd.DataFrame) -> pd.DataFrame:
    """How often each cause (columns) was in the answer to hearts with an effect (rows).

    cases: columns `effect`, and `answer` with names between spaces.
    """
    long = cases.assign(answer=cases["answer"].str.split(" ")).explode("answer")
    return pd.crosstab(long["effect"], long["answer"])
