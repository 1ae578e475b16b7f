"""Checks of measured strains that need no simulator."""

import math

import numpy as np
import pandas as pd
from scipy import stats

from regional_lv.quantities import seth_hill

LEVEL = 0.01
"""Of each check, over all its segments or channels."""


def check(table: pd.DataFrame, exponent: float, converted: bool = False) -> list[dict]:
    """All checks of a measured table (as `read_measured` returns it).

    exponent: n of the strains, (l^n - 1) / n. converted: whether they were converted to it from
    another measure, which is known. Each check is `name`, `passed` and a sentence, `says`; one that
    the table has no channels for is left out.
    """
    strains = table[table["quantity"].isin(("circumferential", "radial", "longitudinal"))]
    checks = [_stretch(strains, exponent), _volume(strains, exponent, converted), _loads(table)]
    return [found for found in checks if found]


def _stretch(strains: pd.DataFrame, exponent: float) -> dict | None:
    """Strains below -1/n (above, for n < 0) belong to no stretch."""
    if strains.empty or not exponent:
        return None
    inner = 1 + exponent * strains["value"]
    bad = strains.loc[inner <= 0, "output"].tolist()
    says = f"no stretch gives these strains with exponent {exponent:g}: {', '.join(bad)}"
    return _result("possible_stretch", not bad, says, "every strain belongs to a stretch")


def _volume(strains: pd.DataFrame, exponent: float, converted: bool) -> dict | None:
    """Of a wall that keeps its volume, the product of the three 1 + n E is at least one.

    These are the diagonal of U^n, whose determinant is one (Hadamard's inequality); means over a
    segment obey it as well, for the logarithm is concave. For n = 0 the sum of the strains is zero.
    """
    wide = strains.pivot_table(
        index=["load_fraction", "segment"], columns="quantity", values=["value", "sd"]
    )
    if strains.empty or wide["value"].shape[1] < 3:
        return None
    values = wide["value"].dropna()
    if values.empty:
        return None
    sd = wide["sd"].reindex(columns=values.columns).loc[values.index] if "sd" in wide else None
    if sd is None or sd.isna().any(axis=None):
        return None
    low = _below(values.to_numpy(), sd.to_numpy(), exponent)
    places = [f"{segment:.0f}" for (_, segment), z in zip(values.index, low, strict=True)]
    limit = stats.norm.isf(LEVEL / len(low))
    bad = [place for place, z in zip(places, low, strict=True) if z > limit]
    together = float(low.sum() / math.sqrt(len(low)))
    passed = not bad and together <= stats.norm.isf(LEVEL)
    where = f"segments {', '.join(bad)}" if bad else "all segments together"
    says = f"the three strains of {where} cannot be those of a wall that keeps its volume"
    if converted:
        says += "; check the directions of the columns, the frames and the sd"
    else:
        able = [
            name
            for n, name in seth_hill.MEASURES.items()
            if (z := _below(values.to_numpy(), sd.to_numpy(), n)).max() <= limit
            and z.sum() / math.sqrt(len(z)) <= stats.norm.isf(LEVEL)
        ]
        says += f", with the exponent {exponent:g}; " + (
            f"as {' or '.join(able)} strains they can" if able else "nor with any common measure"
        )
    return _result(
        "volume_preserving", passed, says, "the strains allow a wall that keeps its volume"
    )


def _below(values: np.ndarray, sd: np.ndarray, exponent: float) -> np.ndarray:
    """By how many sds (n,) the bound is missed, negative where it is kept: values, sd (n, 3)."""
    if not exponent:
        # An equality: the two-sided p-value, as a standard normal deviate.
        z = np.abs(values.sum(1)) / np.sqrt((sd**2).sum(1))
        return stats.norm.isf(np.minimum(2 * stats.norm.sf(z), 1 - 1e-12))
    inner = np.clip(1 + exponent * values, 1e-6, None)
    # (l^n)'s logarithms add up to at least zero, for either sign of n.
    total = np.log(inner).sum(1)
    error = np.sqrt(((exponent * sd / inner) ** 2).sum(1))
    return -total / error


def _loads(table: pd.DataFrame) -> dict | None:
    """A wall that fills strains more at a higher pressure."""
    if table["load_fraction"].nunique() < 2 or table["sd"].isna().any():
        return None
    bad = []
    for (quantity, segment), rows in table.groupby(["quantity", "segment"], dropna=False):
        rows = rows.sort_values("load_fraction")
        size = rows["value"].abs().to_numpy()
        error = np.hypot(rows["sd"].to_numpy()[1:], rows["sd"].to_numpy()[:-1])
        if ((size[:-1] - size[1:]) / error > stats.norm.isf(LEVEL / len(table))).any():
            bad.append(quantity if pd.isna(segment) else f"{quantity} of segment {segment:.0f}")
    says = f"smaller at a higher load: {', '.join(bad)}; check the frames"
    return _result("grows_with_load", not bad, says, "every channel grows with the load")


def _result(name: str, passed: bool, failed: str, fine: str) -> dict:
    return {"name": name, "passed": bool(passed), "says": fine if passed else failed}
