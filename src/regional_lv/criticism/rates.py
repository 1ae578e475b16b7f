"""Shares with their exact intervals."""

import pandas as pd
from scipy import stats


def rate(hits: pd.Series) -> dict:
    """Share of hits with its exact 95 % interval."""
    n, k = len(hits), int(hits.sum())
    if not n:
        return {"hits": 0, "of": 0, "share": None, "low": None, "high": None}
    low = stats.beta.ppf(0.025, k, n - k + 1) if k else 0.0
    high = stats.beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    return {"hits": k, "of": n, "share": k / n, "low": float(low), "high": float(high)}
