"""The posterior of one subject, for figures, tables and pages: draws by name, verdict, truth if
known."""

import json
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np
import pandas as pd
import xarray as xr

from regional_lv.criticism.contract import Stiffness, Summary, read_findings
from regional_lv.errors import InputError
from regional_lv.inference import posteriors
from regional_lv.inference.posteriors import Groups, draws_by_name

SOURCES = {
    "synthetic": "synthetic data",
    "published_volunteer": "healthy volunteer (published data)",
    "published_simulation": "published simulation",
    "file": "measured data",
    "curves": "measured strain curves",
}
"""What a figure calls the data of a subject, by `subjects.<name>.source` of the config."""


@dataclass(frozen=True)
class CasePosterior(ABC):
    """Draws of one case, as figures show them.

    draws: name -> (chain, draw), the `parameters` and then the noise scales if inferred
    (`sigma_<quantity>`). truth: name -> value, empty if unknown. verdict: "passed" or "failed:
    ...". groups: of its file, at this case. middle: the column of the summary that figures show.
    noise_unit: what noise scales are counted in.
    """

    middle: ClassVar[str]
    noise_unit: ClassVar[str]

    file: str | Path
    groups: Groups
    case: str
    parameters: tuple[str, ...]
    draws: dict[str, np.ndarray]
    verdict: str
    truth: dict[str, float]

    @property
    @abstractmethod
    def warning(self) -> str:
        """What every figure says of a posterior that did not pass; else empty."""

    @abstractmethod
    def summary(self) -> pd.DataFrame:
        """Rows: parameters and noise scales; columns: `middle`, lower95, upper95 and others."""

    @property
    def noise(self) -> list[str]:
        """Names of the inferred noise scales."""
        return [name for name in self.draws if name not in self.parameters]

    @cached_property
    def prediction(self) -> tuple[xr.DataArray, pd.Series]:
        """What the posterior predicts, (chain, draw, output), and what was observed, by output.

        Raises InputError if the file has no posterior predictive.
        """
        if "posterior_predictive" not in self.groups:
            raise InputError(
                f"{self.file}: no group `posterior_predictive`; rerun the subject's inference"
            )
        predicted, observed = (
            self.groups[name]["y"] for name in ("posterior_predictive", "observed_data")
        )
        return predicted, observed.to_series()

    def title(self, what: str, source: str) -> str:
        """`what`, whose data, and where they come from."""
        return f"{what}: {self.case} - {SOURCES[source]}"


UNTRUSTED = "failed: every model that was tried misses the measurements"
"""Verdict on a posterior that is averaged over models of which none fits."""


@dataclass(frozen=True)
class AveragedPosterior(CasePosterior):
    """Averaged over models; with what the findings state of the stiffness, and draws of the model
    as it is (name -> (chain, draw))."""

    middle: ClassVar[str] = "mean"
    noise_unit: ClassVar[str] = "of the spread over the simulations"

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
    quantity) where noise is inferred; findings: of the same subject. truth: JSON with the
    generating `theta` of a synthetic subject, if it has any.
    Raises InputError if the file has no such groups or lacks an input that the findings state.
    """
    content = read_findings(findings)
    groups = {name: part.to_dataset() for name, part in posteriors.load(nc).children.items()}
    if "as_it_is" not in groups:
        raise InputError(
            f"{nc}: no group `as_it_is`; give the posterior that is averaged over models, "
            "criticism/<subject>/posterior.nc"
        )
    names = tuple(row["name"] for row in content["stiffness"])
    missing = [name for name in names if name not in groups["posterior"]["input"].values]
    if missing:
        raise InputError(f"{nc}: no draws of {missing[0]}, which {findings} states; make both anew")
    averaged, as_it_is = (
        draws_by_name(group.sel(input=[*names]), "value", "input")
        | draws_by_name(group, "sigma", "quantity", "sigma_")
        for group in (groups["posterior"], groups["as_it_is"])
    )
    return AveragedPosterior(
        file=nc,
        groups=groups,
        case=content["subject"],
        parameters=names,
        draws=averaged,
        verdict="passed" if content["trusted"] else UNTRUSTED,
        truth=true_theta(truth) if truth else {},
        stiffness=tuple(content["stiffness"]),
        as_it_is=as_it_is,
    )


def true_theta(truth: str | Path) -> dict[str, float]:
    """By parameter, of a synthetic subject's truth (JSON)."""
    return json.loads(Path(truth).read_text())["theta"]
