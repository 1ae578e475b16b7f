"""Tables of sets of posteriors: the test set and the scenarios."""

import json
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.figures.scenarios import read_sets


def diagnostics(sets: dict[str, Path], subjects: list[Path]) -> pd.DataFrame:
    """Convergence per parameter, as in the paper's Tables S3-S6.

    sets (by the name that the table gives them), subjects: `diagnostics.csv` files (case,
    parameter, rhat, ess_bulk, ess_tail, divergences, passed, verdict). A set is summarised over
    its cases by mean, median and worst value; each subject stands for itself. Columns: posterior,
    parameter, cases, rhat_mean, rhat_median, rhat_max, ess_bulk_mean, ess_bulk_median,
    ess_bulk_min, ess_tail_min, divergences (sum over cases), failed_cases, verdict.
    """
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


def variance_ratios(coverages: dict[str, Path]) -> pd.DataFrame:
    """Mean posterior over prior variance per parameter, a column per emulator (Table S2).

    coverages: `coverage.csv` of the test set by emulator. The last column says how many of the
    posteriors behind a row failed their gate, all emulators together.
    """
    read = {name: pd.read_csv(path).set_index("parameter") for name, path in coverages.items()}
    table = pd.DataFrame({name: part["variance_ratio"] for name, part in read.items()})
    table["failed"] = sum(part["failed"] for part in read.values())
    return table.loc[[*aha.PARAMETERS, "all"]].reset_index()


def scenarios(
    coverages: dict[str, Path], areas: dict[str, Path], recoveries: dict[str, Path]
) -> pd.DataFrame:
    """One row per set of simulated hearts, all by the name that the table gives it.

    coverages: `coverage.csv`; areas: `auc.csv` of scenarios; recoveries: `recovery.csv`. Columns:
    set, cases, failed, coverage50/80/95 and the interval of the last, map_rmse and bias of the
    MAP, the RMSE in stiffened and in baseline zones, crps, variance_ratio, hpd_width95, and area
    under the curve and its interval of `both` quantities over all zones. Empty: does not apply.
    """
    rows = []
    for name, path in coverages.items():
        row = pd.read_csv(path).set_index("parameter").loc["all"]
        kept = ["cases", "failed", "coverage50", "coverage80", "coverage95"]
        kept += ["coverage95_lower", "coverage95_upper"]
        entry = {"set": name} | {column: row[column] for column in kept}
        entry |= {"cases": int(row["cases"]), "failed": int(row["failed"])}
        entry |= {"map_rmse": np.sqrt(row["mse"]), "bias": row["bias"]}
        per_case = read_sets([recoveries[name]], [name])
        squared = (per_case["map"] - per_case["truth"]) ** 2
        for zones, which in (("stiffened", True), ("baseline", False)):
            chosen = per_case["zone"].notna() & (per_case["stiffened"] == which)
            entry[f"map_rmse_{zones}"] = np.sqrt(squared[chosen].mean())
        entry |= {column: row[column] for column in ("crps", "variance_ratio", "hpd_width95")}
        for column in ("auc", "auc_lower", "auc_upper"):
            entry[column] = _area(areas[name], column) if name in areas else np.nan
        rows.append(entry)
    return pd.DataFrame(rows)


def _area(path: Path, column: str) -> float:
    table = pd.read_csv(path)
    chosen = table[(table["quantity"] == "both") & (table["zone"] == "all")]
    return float(chosen[column].iloc[0]) if len(chosen) else np.nan


def choice(final: Path) -> pd.DataFrame:
    """The emulators that could have been chosen, with their numbers and why (not)."""
    chosen = json.loads(Path(final).read_text())
    table = pd.DataFrame(chosen["candidates"])
    table.insert(1, "chosen", table["emulator"] == chosen["final"])
    return table


def recovery(coverage: Path) -> pd.DataFrame:
    """Accuracy on the test set per parameter, over all, and over cases with a soft zone.

    coverage: `coverage.csv`. Columns: parameter, cases, failed_cases (posteriors that did not pass
    their gate; they count like the others), map_mse, mean_mse (of the posterior mean), crps,
    variance_ratio (posterior to prior, mean over cases), then the other columns of `coverage`.
    """
    table = pd.read_csv(coverage).rename(columns={"failed": "failed_cases", "mse": "map_mse"})
    first = ["parameter", "cases", "failed_cases", "map_mse", "mean_mse", "crps", "variance_ratio"]
    return table[[*first, *table.columns.difference(first, sort=False)]]
