"""Checks of measured strains that need no simulator."""

import math

import numpy as np
import pandas as pd
from scipy import stats

from regional_lv.quantities import QUANTITIES, seth_hill
from regional_lv.quantities.seth_hill import Measure

DIRECTIONS = ("circumferential", "radial", "longitudinal")

LEVEL = 0.01
"""Of each check, over all its segments or channels."""


def check(table: pd.DataFrame, measure: Measure, converted: bool = False) -> list[dict]:
    """All checks of a measured table (as `read_measured` returns it).

    measure: of the strains. converted: whether they were converted to it from another measure,
    which is known. Each check is `name`, `passed` and a sentence, `says`; one that the table has no
    channels for is left out.
    """
    checks = [_volume(table[table["quantity"].isin(DIRECTIONS)], measure, converted), _loads(table)]
    return [found for found in checks if found]


def _volume(strains: pd.DataFrame, measure: Measure, converted: bool) -> dict | None:
    """Whether a wall that keeps its volume can have these strains (`_below`)."""
    wide = strains.pivot_table(
        index=["load_fraction", "segment"], columns="quantity", values=["value", "sd"]
    )
    if strains.empty or wide["value"].shape[1] < len(DIRECTIONS):
        return None
    values = wide["value"].dropna()
    if values.empty:
        return None
    sd = wide["sd"].reindex(columns=values.columns).loc[values.index] if "sd" in wide else None
    if sd is None or sd.isna().any(axis=None):
        return None
    low = _below(values.to_numpy(), sd.to_numpy(), measure)
    limit = stats.norm.isf(LEVEL / len(low))
    bad = [f"{at[1]:.0f}{_at(at[0])}" for at, z in zip(values.index, low, strict=True) if z > limit]
    passed = not bad and _together(low) <= stats.norm.isf(LEVEL)
    where = f"segments {', '.join(bad)}" if bad else "all segments together"
    says = f"the three strains of {where} cannot be those of a wall that keeps its volume"
    if converted:
        says += "; check the directions of the columns, the frames and the sd"
    else:
        able = []
        for exponent, name in seth_hill.MEASURES.items():
            z = _below(values.to_numpy(), sd.to_numpy(), measure._replace(exponent=exponent))
            if z.max() <= limit and _together(z) <= stats.norm.isf(LEVEL):
                able.append(name)
        says += f", with the exponent {measure.exponent:g}; " + (
            f"as {' or '.join(able)} strains they can" if able else "nor with any common measure"
        )
    return _result(
        "volume_preserving", passed, says, "the strains allow a wall that keeps its volume"
    )


def _at(load_fraction: float) -> str:
    return "" if load_fraction == 1 else f" at {100 * load_fraction:.0f} % of the load"


def _together(z: np.ndarray) -> float:
    return float(z.sum() / math.sqrt(len(z)))


def _below(values: np.ndarray, sd: np.ndarray, measure: Measure) -> np.ndarray:
    """By how many sds (n,) strains miss the bound of a wall that keeps its volume, negative where
    they keep it: values, sd (n, 3). Of what lies between two measures, the smaller one."""
    bounds = {0.0: _of_tensor, 1.0: _of_lines}
    found = [
        bound(values, sd, measure.exponent)
        for share, bound in bounds.items()
        if abs(measure.line_share - share) < 1
    ]
    return np.min(found, axis=0)


def _of_tensor(values: np.ndarray, sd: np.ndarray, exponent: float) -> np.ndarray:
    """The product of the three 1 + n E is at least one: these are the diagonal of U^n, whose
    determinant is one (Hadamard's inequality); means over a segment obey it as well, for the
    logarithm is concave. For n = 0 the sum of the strains is zero."""
    if not exponent:
        # An equality: the two-sided p-value, as a standard normal deviate.
        z = np.abs(values.sum(1)) / np.sqrt((sd**2).sum(1))
        return stats.norm.isf(np.minimum(2 * stats.norm.sf(z), 1 - 1e-12))
    inner = np.clip(1 + exponent * values, 1e-6, None)
    error = np.sqrt(((exponent * sd / inner) ** 2).sum(1))
    return -np.log(inner).sum(1) / error


def _of_lines(values: np.ndarray, sd: np.ndarray, exponent: float) -> np.ndarray:
    """The product of the stretches of three lines that were perpendicular is at least one, for any
    measure: their squares are the diagonal of C."""
    inner = np.clip(1 + exponent * values, 1e-6, None)
    stretches = np.log(inner).sum(1) / exponent if exponent else values.sum(1)
    return -stretches / np.sqrt(((sd / inner) ** 2).sum(1))


def _loads(table: pd.DataFrame) -> dict | None:
    """A wall that fills strains more at a higher pressure."""
    if table["load_fraction"].nunique() < 2 or table["sd"].isna().any():
        return None
    bad = []
    signed = table[[bool(QUANTITIES[name].sign) for name in table["quantity"]]]
    for (quantity, segment), rows in signed.groupby(["quantity", "segment"], dropna=False):
        rows = rows.sort_values("load_fraction")
        size = rows["value"].abs().to_numpy()
        error = np.hypot(rows["sd"].to_numpy()[1:], rows["sd"].to_numpy()[:-1])
        if ((size[:-1] - size[1:]) / error > stats.norm.isf(LEVEL / len(table))).any():
            bad.append(quantity if pd.isna(segment) else f"{quantity} of segment {segment:.0f}")
    says = f"smaller at a higher load: {', '.join(bad)}; check the frames"
    return _result("grows_with_load", not bad, says, "every channel grows with the load")


def _result(name: str, passed: bool, failed: str, fine: str) -> dict:
    return {"name": name, "passed": bool(passed), "says": fine if passed else failed}
