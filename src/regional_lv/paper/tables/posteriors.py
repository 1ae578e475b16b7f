"""Tables of posteriors: of the test set, the scenarios and a subject."""

import json
from pathlib import Path

import arviz as az
import numpy as np
import pandas as pd

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.case_posterior import read
from regional_lv.paper.posteriors.files import by_emulator, by_posteriors, by_set
from regional_lv.paper.posteriors.sets_table import read_sets
from regional_lv.tables.writing import written


@written
def diagnostics(shortlist: list[Path], scenarios: list[Path], subjects: list[Path]) -> pd.DataFrame:
    """Convergence per parameter, as in the paper's Tables S3-S6.

    shortlist, scenarios: `posteriors/<emulator>/<set>/diagnostics.csv`; subjects: the same of one
    subject each (case, parameter, rhat, ess_bulk, ess_tail, divergences, passed, verdict). A set is
    summarised over its cases by mean, median and worst value; each subject stands for itself.
    Columns: posterior ("<set>, <emulator>" or a subject),
    parameter, cases, rhat_mean, rhat_median, rhat_max, ess_bulk_mean, ess_bulk_median,
    ess_bulk_min, ess_tail_min, divergences (sum over cases), failed_cases, verdict.
    """
    sets = by_posteriors([*shortlist, *scenarios])
    parts = [(name, pd.read_csv(path, dtype={"case": str})) for name, path in sets.items()]
    for path in subjects:
        parts += list(pd.read_csv(path, dtype={"case": str}).groupby("case", sort=False))
    return pd.concat([_convergence(name, part) for name, part in parts], ignore_index=True)


def _convergence(name: str, part: pd.DataFrame) -> pd.DataFrame:
    groups = part.groupby("parameter", sort=False)
    table = groups.agg(
        cases=("case", "nunique"),
        rhat_mean=("rhat", "mean"),
        rhat_median=("rhat", "median"),
        rhat_max=("rhat", "max"),
        ess_bulk_mean=("ess_bulk", "mean"),
        ess_bulk_median=("ess_bulk", "median"),
        ess_bulk_min=("ess_bulk", "min"),
        ess_tail_min=("ess_tail", "min"),
        divergences=("divergences", "sum"),
    ).reset_index()
    table.insert(0, "posterior", name)
    verdicts = part.groupby("case")["verdict"].agg(lambda v: set(v) - {"passed"})
    failed = int(verdicts.map(bool).sum())
    table["failed_cases"] = failed
    if part["case"].nunique() == 1:
        table["verdict"] = "; ".join(sorted(verdicts.iloc[0])) or "passed"
    else:
        table["verdict"] = f"failed: {failed} cases" if failed else "passed"
    return table


@written
def variance_ratios(coverages: list[Path], parameters: StiffnessInputs) -> pd.DataFrame:
    """Mean posterior over prior variance per parameter, a column per emulator (Table S2).

    coverages: `posteriors/<emulator>/test/coverage.csv`. The last column says how many of the
    posteriors behind a row failed the convergence check, all emulators together.
    """
    read = {
        name: pd.read_csv(paths[0]).set_index("parameter")
        for name, paths in by_emulator(coverages).items()
    }
    table = pd.DataFrame({name: part["variance_ratio"] for name, part in read.items()})
    table["failed"] = sum(part["failed"] for part in read.values())
    return table.loc[[*parameters.names, "all"]].reset_index()


@written
def scenarios(
    coverages: list[Path], areas: list[Path], recoveries: list[Path], parameters: StiffnessInputs
) -> pd.DataFrame:
    """One row per set of simulated hearts.

    coverages: `posteriors/<emulator>/<set>/coverage.csv`; areas, recoveries: `auc.csv` (of
    scenarios) and `recovery.csv` beside them. Columns:
    set, cases, failed, coverage50/80/95 and the interval of the last, map_rmse and bias of the
    MAP, the RMSE in stiffened and in baseline zones, crps, variance_ratio, hpd_width95, and area
    under the curve and its interval of `both` quantities over all zones. Empty: does not apply.
    """
    rows, area_of, recovery_of = [], by_set(areas), by_set(recoveries)
    for name, path in by_set(coverages).items():
        row = pd.read_csv(path).set_index("parameter").loc["all"]
        kept = ["cases", "failed", "coverage50", "coverage80", "coverage95"]
        kept += ["coverage95_lower", "coverage95_upper"]
        entry = {"set": name} | {column: row[column] for column in kept}
        entry |= {"cases": int(row["cases"]), "failed": int(row["failed"])}
        entry |= {"map_rmse": np.sqrt(row["mse"]), "bias": row["bias"]}
        per_case = read_sets([recovery_of[name]], [name], parameters)
        squared = (per_case["map"] - per_case["truth"]) ** 2
        for zones, which in (("stiffened", True), ("baseline", False)):
            chosen = per_case["zone"].notna() & (per_case["stiffened"] == which)
            entry[f"map_rmse_{zones}"] = np.sqrt(squared[chosen].mean())
        entry |= {column: row[column] for column in ("crps", "variance_ratio", "hpd_width95")}
        for column in ("auc", "auc_lower", "auc_upper"):
            entry[column] = _area(area_of[name], column) if name in area_of else np.nan
        rows.append(entry)
    return pd.DataFrame(rows)


def _area(path: Path, column: str) -> float:
    table = pd.read_csv(path)
    chosen = table[(table["quantity"] == "both") & (table["zone"] == "all")]
    return float(chosen[column].iloc[0]) if len(chosen) else np.nan


@written
def choice(choice: Path) -> pd.DataFrame:
    """The emulators that could have been chosen, with their numbers and why (not).

    choice: `posteriors/final.json`.
    """
    chosen = json.loads(Path(choice).read_text())
    table = pd.DataFrame(chosen["candidates"])
    table.insert(1, "chosen", table["emulator"] == chosen["final"])
    return table


@written
def recovery(coverage: Path) -> pd.DataFrame:
    """Accuracy on the test set per parameter, over all, and over cases with a soft zone.

    coverage: `coverage.csv`. Columns: parameter, cases, failed_cases (posteriors that did not pass
    the convergence check; they count like the others), map_mse, mean_mse (of the posterior mean),
    crps, variance_ratio (posterior to prior, mean over cases), then the other columns of
    `coverage`.
    """
    table = pd.read_csv(coverage).rename(columns={"failed": "failed_cases", "mse": "map_mse"})
    first = ["parameter", "cases", "failed_cases", "map_mse", "mean_mse", "crps", "variance_ratio"]
    return table[[*first, *table.columns.difference(first, sort=False)]]


@written
def noise_prior(noise_prior: Path) -> pd.DataFrame:
    """Noise of one subject by its prior's scale: a row per scale.

    noise_prior: `<subject>_noise_prior.csv`. Columns: prior_scale, median and 95 % HPD ends of each
    direction's noise, outside (observations outside the 95 % predictive interval), outputs,
    verdict.
    """
    table = pd.read_csv(noise_prior)
    rows = []
    for scale, part in table.groupby("prior_scale"):
        row = {"prior_scale": scale}
        for entry in part[part["parameter"].str.startswith("sigma_")].itertuples():
            row |= {
                entry.parameter: entry.median,
                f"{entry.parameter}_lower95": entry.lower95,
                f"{entry.parameter}_upper95": entry.upper95,
            }
        rows.append(row | part[["outside", "outputs", "verdict"]].iloc[0].to_dict())
    return pd.DataFrame(rows)


@written
def convergence(posterior: Path, diagnostics: Path) -> pd.DataFrame:
    """Convergence of one subject as the paper reports it (Table S6), and this study's check.

    Columns: parameter, rhat (conventional), split_rhat, ess (bulk), rhat_rank (rank-normalised
    and split: what the convergence check looks at), ess_tail, verdict.
    """
    one = read(posterior, diagnostics)
    checks = pd.read_csv(diagnostics).set_index("parameter")
    rows = [
        {
            "parameter": name,
            "rhat": float(az.rhat(draws, method="identity")),
            "split_rhat": float(az.rhat(draws, method="split")),
            "ess": checks.loc[name, "ess_bulk"],
            "rhat_rank": checks.loc[name, "rhat"],
            "ess_tail": checks.loc[name, "ess_tail"],
            "verdict": one.verdict,
        }
        for name, draws in one.draws.items()
    ]
    return pd.DataFrame(rows)
