"""The posterior of one case, for figures and tables: draws by name, verdict, truth if known.

It is that of the model as it is, or averaged over models of what may be wrong with it.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import arviz as az
import numpy as np
import pandas as pd
import xarray as xr

from regional_lv.criticism.contract import Stiffness, Summary, read_findings
from regional_lv.errors import InputError

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
    verdict: "passed" or "failed: ..." of the convergence check. middle: the column of the summary
    that figures show.
    """

    middle: ClassVar[str] = "median"

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


UNTRUSTED = "failed: every model that was tried misses the measurements"
"""Verdict on a posterior that is averaged over models of which none fits."""


@dataclass(frozen=True)
class AveragedPosterior(CasePosterior):
    """The same averaged over models; with what the findings state of the stiffness, and draws of
    the model as it is (name -> (chain, draw))."""

    middle: ClassVar[str] = "mean"

    stiffness: tuple[Stiffness, ...]
    as_it_is: dict[str, np.ndarray]

    @property
    def warning(self) -> str:
        """Empty if a model fits, else what every figure says."""
        if self.verdict == "passed":
            return ""
        return f"NO STIFFNESS CAN BE TRUSTED ({self.verdict.removeprefix('failed: ')})"

    def summary(self) -> pd.DataFrame:
        """Rows: parameters and noise scales; columns: mean, sd, lower95, upper95 (central), and
        those of the model as it is, `as_is_mean` to `as_is_upper95`."""
        rows = {
            s["name"]: _stated(s["averaged"]) | _stated(s["as_it_is"], "as_is_")
            for s in self.stiffness
        }
        for name in self.noise:
            of_base = _moments(self.as_it_is[name])
            rows[name] = _stated(_moments(self.draws[name])) | _stated(of_base, "as_is_")
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")


def _stated(summary: Summary, prefix: str = "") -> dict[str, float]:
    lower, upper = summary["interval95"]
    row = {"mean": summary["mean"], "sd": summary["sd"], "lower95": lower, "upper95": upper}
    return {prefix + key: value for key, value in row.items()}


def _moments(values: np.ndarray) -> Summary:
    ends = [float(end) for end in np.quantile(values, [0.025, 0.975])]
    return {"mean": float(values.mean()), "sd": float(values.std()), "interval95": ends}


def read_averaged(
    nc: str | Path, findings: str | Path, truth: str | Path | None = None
) -> AveragedPosterior:
    """Read the posterior of a subject that is averaged over models, and of the model as it is.

    nc: groups `posterior` and `as_it_is` with value (chain, draw, input), and sigma (chain, draw,
    quantity) where noise is inferred; findings: of the same subject. truth: as for `read`.
    Raises InputError if the file has no such groups or lacks an input that the findings state.
    """
    content, data = read_findings(findings), az.from_netcdf(nc)
    if "as_it_is" not in data.groups():
        raise InputError(
            f"{nc}: no group `as_it_is`; give the posterior that is averaged over models, "
            "criticism/<subject>/posterior.nc"
        )
    names = tuple(row["name"] for row in content["stiffness"])
    missing = [name for name in names if name not in data.posterior["input"].values]
    if missing:
        raise InputError(f"{nc}: no draws of {missing[0]}, which {findings} states; make both anew")
    return AveragedPosterior(
        content["subject"],
        names,
        _draws_by_name(data.posterior, names),
        "passed" if content["trusted"] else UNTRUSTED,
        _true_theta(truth) if truth else {},
        tuple(content["stiffness"]),
        _draws_by_name(data["as_it_is"], names),
    )


def read_subject(
    nc: str | Path,
    diagnostics: str | Path | None,
    findings: str | Path | None,
    truth: str | Path | None = None,
) -> CasePosterior:
    """The posterior of one subject: averaged over models if there are findings, else of the model
    as it is. Arguments and errors as for `read_averaged` and `read`."""
    if findings:
        return read_averaged(nc, findings, truth)
    if not diagnostics:
        raise InputError(f"{nc}: a posterior without verdict; give its diagnostics, or findings")
    return read(nc, diagnostics, truth=truth)


def _draws_by_name(group: xr.Dataset, names: Sequence[str]) -> dict[str, np.ndarray]:
    order = ("chain", "draw")
    draws = {n: group["value"].sel(input=n).transpose(*order).to_numpy() for n in names}
    for quantity in group["quantity"].values if "sigma" in group else ():
        scale = group["sigma"].sel(quantity=quantity)
        draws[f"sigma_{quantity}"] = scale.transpose(*order).to_numpy()
    return draws


def _true_theta(truth: str | Path) -> dict[str, float]:
    return json.loads(Path(truth).read_text())["theta"]


def predictive(nc: str | Path, case: str) -> tuple[xr.DataArray, pd.Series]:
    """What a posterior predicts, (chain, draw, output), and what was observed, by output.

    Raises InputError if the file has no posterior predictive.
    """
    data = az.from_netcdf(nc)
    if "posterior_predictive" not in data.groups():
        raise InputError(f"{nc}: no group `posterior_predictive`; rerun the subject's inference")
    predicted = data.posterior_predictive["y"]
    if "case" not in predicted.dims:
        return predicted, data.observed_data["y"].to_series()
    return predicted.sel(case=case), data.constant_data["y_obs"].sel(case=case).to_series()


def read(
    nc: str | Path,
    diagnostics: str | Path,
    case: str | None = None,
    truth: str | Path | None = None,
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
        known = _true_theta(truth)
    elif "constant_data" in data.groups() and "theta_true" in data.constant_data:
        values = data.constant_data["theta_true"].isel(case=at)
        known = {name: float(values.sel(parameter=name)) for name in names}
    return CasePosterior(case, names, draws, verdict_of(diagnostics, case), known)


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
