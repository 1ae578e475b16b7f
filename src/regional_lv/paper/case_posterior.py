"""The posterior of one case by an emulator of the stiffness alone, for the paper's figures."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pandas as pd

from regional_lv.criticism.case_posterior import CasePosterior, true_theta
from regional_lv.errors import InputError
from regional_lv.inference.arviz_arrays import hdi95
from regional_lv.paper.sampler import files


@dataclass(frozen=True)
class StiffnessPosterior(CasePosterior):
    """Its noise scales are in training sds; `verdict` is that of the convergence check."""

    middle: ClassVar[str] = "median"
    noise_unit: ClassVar[str] = "standardised"

    @property
    def warning(self) -> str:
        if self.verdict == "passed":
            return ""
        return f"POSTERIOR FAILED ITS CONVERGENCE CHECK ({self.verdict.removeprefix('failed: ')})"

    def summary(self) -> pd.DataFrame:
        """Rows: parameters and noise scales; columns: median, lower95, upper95 (95 % HPD)."""
        rows = {}
        for name, values in self.draws.items():
            lower, upper = hdi95(values.ravel())
            rows[name] = {"median": np.median(values), "lower95": lower, "upper95": upper}
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")


def read(
    nc: str | Path,
    diagnostics: str | Path,
    case: str | None = None,
    truth: str | Path | None = None,
) -> StiffnessPosterior:
    """Read case `case` (default: the only one) of a file of posteriors.

    truth: JSON with the generating `theta` of a synthetic subject, if it has any; a test set
    carries its own.
    Raises InputError if the case is not in the file or has no verdict.
    """
    cases = {one.case: one for one in files.read(nc)}
    if case is None and len(cases) == 1:
        case = next(iter(cases))
    if case not in cases:
        raise InputError(f"{nc}: no case {case!r}; it holds {', '.join(cases)}: name one of these")
    found = cases[case]
    return StiffnessPosterior(
        file=nc,
        groups=found.groups,
        case=case,
        parameters=tuple(found.theta),
        draws=found.theta | found.sigma,
        verdict=verdict_of(diagnostics, case),
        truth=true_theta(truth) if truth else found.truth,
    )


def verdict_of(diagnostics: str | Path, case: str) -> str:
    """Verdict of one case in a `diagnostics.csv`: "passed" or "failed: ..." with every reason.

    Raises InputError if the file has no row for the case.
    """
    table = pd.read_csv(diagnostics, dtype={"case": str})
    rows = table[table["case"] == case]
    if rows.empty:
        raise InputError(f"{diagnostics}: no row for case {case!r}; rerun the diagnostics")
    reasons = [v for v in rows["verdict"].unique() if v != "passed"]
    if reasons:
        return "failed: " + "; ".join(v.removeprefix("failed: ") for v in reasons)
    return "passed" if rows["passed"].all() else "failed: a parameter did not pass"
