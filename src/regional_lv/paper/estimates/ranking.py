"""Which emulators find the parameters: the paper's first stage of selection."""

import json
import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import scoringrules
from scipy import stats
from statsmodels.stats.multitest import multipletests

from regional_lv.channels import Channels
from regional_lv.emulators import label_of
from regional_lv.emulators.gaussian import Z95
from regional_lv.paper.estimates import ESTIMATORS

log = logging.getLogger(__name__)

PAIRS = (("local_gp", "local_mgp"), ("local_dkgp", "local_dkmgp"), ("vgp", "mvgp"))
"""Single-output emulators and the same with all outputs together."""

LEVEL = 0.05


def rank_emulators(
    names: Sequence[str],
    estimates: Sequence[Path],
    checked: Sequence[Path],
    costs: Sequence[Path],
    fits: Sequence[Path],
    predictions: Sequence[Path],
    channels: Channels,
    train: Path,
    test: Path,
    size: int,
    estimator: str,
    named: Sequence[str] | None,
    also: Sequence[str],
    ranking: Path,
    pairs: Path,
    shortlist: Path | None = None,
) -> None:
    """Rank emulators by the parameter MSE of one `estimator`; write what `rank`, `compare_pairs`
    and, unless `shortlist` is None, `choose` describe (CSV, CSV, JSON).

    names: of the emulators, in the order of their files: `estimates` (`estimate_parameters`),
    `checked` (`simulate_estimates`), `costs` (`measure_cost`), `fits` and `predictions`
    (`train_emulator` and `predict_test_set`). train: the screened table; test: that of the set
    that was estimated, the test set or what is held out beside it. named, also: as in `choose`.
    """
    sd = pd.read_parquet(train, columns=list(channels.names)).std()
    truth = pd.read_parquet(test, columns=["sample", *channels.names])
    truth = truth.assign(sample=truth["sample"].astype(str)).set_index("sample")
    rows, estimated = [], {}
    for name, own, back, cost, report, predicted in zip(
        names, estimates, checked, costs, fits, predictions, strict=True
    ):
        estimated[name], fit = pd.read_parquet(own), json.loads(Path(report).read_text())
        rows.append(
            {
                "emulator": name,
                "label": label_of(name),
                "input_transform": fit["settings"]["input_transform"],
                **parameter_errors(estimated[name]),
                **output_errors(pd.read_parquet(back), truth, sd, estimator),
                **predictive_scores(pd.read_parquet(predicted), sd),
                "training_seconds": fit["seconds"],
                "peak_memory_mb": fit["peak_memory_mb"],
                **json.loads(Path(cost).read_text()),
            }
        )
    table = rank(pd.DataFrame(rows), estimator)
    table.to_csv(ranking, index=False)
    compare_pairs(estimated).to_csv(pairs, index=False)
    if shortlist is None:
        return
    chosen = choose(table, size, estimator, named, also)
    Path(shortlist).write_text(json.dumps(chosen, indent=2) + "\n")
    log.info("shortlist: %s", ", ".join(chosen["shortlist"]))


def parameter_errors(estimates: pd.DataFrame) -> dict:
    """Of each estimator: param_mse_<estimator> (mean over cases and parameters),
    param_mse_median_<estimator> (median over cases), outside_<estimator> (cases whose estimate
    lies outside the design), seconds_per_case_<estimator>."""
    result = {"cases": estimates["sample"].nunique()}
    for name in ESTIMATORS:
        part = estimates[estimates["estimator"] == name]
        result[f"param_mse_{name}"] = part["mse"].mean()
        result[f"param_mse_median_{name}"] = part["mse"].median()
        result[f"outside_{name}"] = int(part["outside"].sum())
        result[f"seconds_per_case_{name}"] = part["seconds"].mean()
    return result


def output_errors(
    checked: pd.DataFrame, truth: pd.DataFrame, sd: pd.Series, estimator: str
) -> dict:
    """How far one estimator's estimates lie from the data when passed back: output_mse (strains,
    the paper's), output_mse_standardised (all outputs, in squared training sd), checked_by,
    checked_cases, checked_failed (did not converge; left out).

    truth: outputs by sample; sd: by output."""
    part, outputs = checked[checked["estimator"] == estimator], list(truth.columns)
    error = part[outputs].to_numpy() - truth.loc[part["sample"]].to_numpy()
    kept = np.isfinite(error).all(axis=1)
    strains = error[kept][:, Channels.parse(outputs).is_strain]
    return {
        "output_mse": np.square(strains).mean() if strains.size else np.nan,
        "output_mse_standardised": np.square(error[kept] / sd.to_numpy()).mean()
        if kept.any()
        else np.nan,
        "checked_by": "; ".join(part["checked_by"].unique()),
        "checked_cases": int(kept.sum()),
        "checked_failed": int((~kept).sum()),
    }


def predictive_scores(predictions: pd.DataFrame, sd: pd.Series) -> dict:
    """At the test set's true parameters, outputs in training sd: predictive_mse, predictive_crps
    (of the Gaussian), predictive_coverage50 and 95 (central intervals)."""
    scale = sd.loc[predictions["output"]].to_numpy()
    error = ((predictions["truth"] - predictions["mean"]) / scale).to_numpy()
    spread = (predictions["sd"] / scale).to_numpy()
    z = np.abs(error) / spread
    return {
        "predictive_mse": np.square(error).mean(),
        "predictive_crps": scoringrules.crps_normal(error, 0.0, spread).mean(),
        "predictive_coverage50": (z <= stats.norm.ppf(0.75)).mean(),
        "predictive_coverage95": (z <= Z95).mean(),
    }


def rank(table: pd.DataFrame, estimator: str) -> pd.DataFrame:
    """`table` with `rank` (1 is best) in front, by the parameter MSE of `estimator`."""
    table = table.sort_values(f"param_mse_{estimator}", ignore_index=True)
    table.insert(0, "rank", np.arange(1, len(table) + 1))
    return table


def compare_pairs(estimates: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Wilcoxon signed-rank tests (two-sided) of the per-sample MSE of `PAIRS`, Holm-corrected over
    the pairs of each estimator.

    estimates: tables of `estimate_parameters` by emulator; pairs that are not complete are left
    out. Columns: estimator, single, multi, cases, median_single, median_multi, statistic, p_value,
    p_holm, rejected (at 5 %), better.
    """
    columns = ["estimator", "single", "multi", "cases", "median_single", "median_multi"]
    columns += ["statistic", "p_value", "p_holm", "rejected", "better"]
    rows = []
    for estimator in ESTIMATORS:
        family = []
        for single, multi in PAIRS:
            if not {single, multi} <= set(estimates):
                continue
            a, b = (
                t.loc[t["estimator"] == estimator].set_index("sample")["mse"]
                for t in (estimates[single], estimates[multi])
            )
            b = b.loc[a.index]
            test = stats.wilcoxon(a, b)
            middle = a.median(), b.median()
            better = single if np.median(a - b) < 0 else multi
            family.append(
                [estimator, single, multi, len(a), *middle, test.statistic, test.pvalue, better]
            )
        rejected, adjusted, *_ = multipletests([row[7] for row in family], LEVEL, method="holm")
        rows += [
            [*row[:8], p, bool(r), row[8]]
            for row, p, r in zip(family, adjusted, rejected, strict=True)
        ]
    return pd.DataFrame(rows, columns=columns)


def choose(
    table: pd.DataFrame,
    size: int,
    estimator: str,
    named: Sequence[str] | None,
    also: Sequence[str],
) -> dict:
    """The emulators whose posteriors are compared: `shortlist`, which is `named` or, if that is
    None, the best of the ranking and what is ranked of `also`; `best_of_ranking`, the first `size`;
    the `rule` for these in words."""
    words = {"least_squares": "least squares", "weighted": "weighted by predictive covariance"}
    ranked = table["emulator"].tolist()
    best = ranked[:size]
    return {
        "shortlist": named or list(dict.fromkeys([*best, *(n for n in also if n in ranked)])),
        "best_of_ranking": best,
        "rule": f"the {min(size, len(table))} of {len(table)} emulators with the least parameter "
        f"MSE (mean over {table['cases'].iloc[0]} test cases; estimates {words[estimator]})",
    }
