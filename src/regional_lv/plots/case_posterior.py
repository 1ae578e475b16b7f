"""The posterior of one case, for figures and tables: draws by name, verdict, truth if known."""

import json
from dataclasses import dataclass
from pathlib import Path

import arviz as az
import numpy as np
import pandas as pd

from regional_lv.errors import InputError
from regional_lv.plots.verdicts import verdict_of

SOURCES = {
    "synthetic": "synthetic data",
    "published_volunteer": "healthy volunteer (published data)",
    "published_simulation": "published simulation",
    "file": "measured data",
    "curves": "measured strain curves",
}
"""What a figure calls the data of a subject, by `subjects.<name>.source` of the config."""


@dataclass(frozen=True)
class CasePosterior:
    """Draws of one case.

    draws: name -> (chain, draw), the `parameters` and then the noise scales if inferred
    (`sigma_<direction>`, in standardised units). truth: name -> value, empty if unknown.
    verdict: "passed" or "failed: ..." of the convergence check.
    """

    case: str
    parameters: tuple[str, ...]
    draws: dict[str, np.ndarray]
    verdict: str
    truth: dict[str, float]

    @property
    def warning(self) -> str:
        """Empty if the posterior passed the convergence check, else what every figure says."""
        if self.verdict == "passed":
            return ""
        return f"POSTERIOR FAILED ITS CONVERGENCE CHECK ({self.verdict.removeprefix('failed: ')})"

    @property
    def noise(self) -> list[str]:
        """Names of the inferred noise scales."""
        return [name for name in self.draws if name not in self.parameters]

    def summary(self) -> pd.DataFrame:
        """Rows: parameters and noise scales; columns: median, lower95, upper95 (95 % HPD)."""
        rows = []
        for name, values in self.draws.items():
            lower, upper = az.hdi(values.ravel(), hdi_prob=0.95)
            rows.append((name, np.median(values), lower, upper))
        return pd.DataFrame(rows, columns=["parameter", "median", "lower95", "upper95"]).set_index(
            "parameter"
        )

    def title(self, what: str, source: str) -> str:
        """`what`, whose data, and where they come from."""
        return f"{what}: {self.case} - {SOURCES[source]}"


def read(
    nc: str | Path, diagnostics: str | Path, case: str | None = None, truth: Path | None = None
) -> CasePosterior:
    """Read case `case` (default: the only one) of an InferenceData file.

    truth: JSON with the generating `theta` of a synthetic subject, if it has any; a test set
    carries its own.
    Raises InputError if the case is not in the file or has no verdict.
    """
    data = az.from_netcdf(nc)
    cases = [str(c) for c in data.posterior["case"].values]
    if case is None and len(cases) == 1:
        case = cases[0]
    if case not in cases:
        raise InputError(f"{nc}: no case {case!r}; it holds {', '.join(cases)}: name one of these")
    at = cases.index(case)
    chosen = data.posterior.isel(case=at)
    order = ("chain", "draw")
    names = tuple(str(name) for name in chosen["parameter"].values)
    draws = {
        name: chosen["theta"].sel(parameter=name).transpose(*order).to_numpy() for name in names
    }
    if "sigma" in chosen:
        for direction in chosen["direction"].values:
            scale = chosen["sigma"].sel(direction=direction)
            draws[f"sigma_{direction}"] = scale.transpose(*order).to_numpy()
    known = {}
    if truth:
        known = json.loads(Path(truth).read_text())["theta"]
    elif "constant_data" in data.groups() and "theta_true" in data.constant_data:
        values = data.constant_data["theta_true"].isel(case=at)
        known = {name: float(values.sel(parameter=name)) for name in names}
    return CasePosterior(case, names, draws, verdict_of(diagnostics, case), known)


def density(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Kernel density estimate of draws: grid and density (128 each).

    Mass is reflected at the smallest and largest draw, so that a posterior leaning against the
    prior's bound shows as such. Draws that are all equal give a spike of finite height.
    """
    values = np.ravel(values)
    if np.ptp(values) == 0:
        width = max(abs(values[0]), 1.0) * 1e-3
        return np.array([values[0] - width, values[0], values[0] + width]), np.array([0, 1, 0.0])
    return az.kde(values, grid_len=128, bound_correction=True)
