"""The study's tables: CSV for programs, LaTeX (booktabs) for papers."""

import json
from pathlib import Path

import arviz as az
import numpy as np
import pandas as pd

from regional_lv import aha
from regional_lv.emulators import REGISTRY
from regional_lv.figures import posterior
from regional_lv.figures import scenarios as scenario_figures


def by_set(paths: list[Path]) -> dict[str, Path]:
    """Files `posteriors/<emulator>/<set>/...` by their set."""
    return {Path(path).parent.name: path for path in paths}


def by_posteriors(paths: list[Path]) -> dict[str, Path]:
    """Files `posteriors/<emulator>/<set>/...` by "<set>, <emulator>"."""
    return {f"{Path(p).parent.name}, {Path(p).parent.parent.name}": p for p in paths}


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


def subjects(posteriors: list[Path], diagnostics: list[Path], sources: list[str]) -> pd.DataFrame:
    """Stiffness and noise of every subject: posterior median and 95 % HPD interval.

    posteriors: InferenceData files of one subject each; diagnostics: CSV with its verdict, and
    sources: `subjects.<name>.source` of the config, both in the same order. Columns: subject, data,
    parameter, median, lower95, upper95, verdict. Noise scales are in standardised units.
    """
    tables = []
    for nc, check, source in zip(posteriors, diagnostics, sources, strict=True):
        one = posterior.read(nc, check)
        table = one.summary().reset_index()
        table.insert(0, "subject", one.case)
        table.insert(1, "data", posterior.SOURCES[source])
        table["verdict"] = one.verdict
        tables.append(table)
    columns = ["subject", "data", "parameter", "median", "lower95", "upper95", "verdict"]
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=columns)


def variance_ratios(coverages: dict[str, Path]) -> pd.DataFrame:
    """Mean posterior over prior variance per parameter, a column per emulator (Table S2).

    coverages: `coverage.csv` of the test set by emulator. The last column says how many of the
    posteriors behind a row failed their gate, all emulators together.
    """
    read = {name: pd.read_csv(path).set_index("parameter") for name, path in coverages.items()}
    table = pd.DataFrame({name: part["variance_ratio"] for name, part in read.items()})
    table["failed"] = sum(part["failed"] for part in read.values())
    return table.loc[[*aha.PARAMETERS, "all"]].reset_index()


def convergence(nc: Path, diagnostics: Path) -> pd.DataFrame:
    """Convergence of one subject as the paper reports it (Table S6), beside this study's gate.

    Columns: parameter, rhat (conventional), split_rhat, ess (bulk), rhat_rank (rank-normalised
    and split: what the gate looks at), ess_tail, verdict.
    """
    one = posterior.read(nc, diagnostics)
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
        per_case = scenario_figures.read_sets([recoveries[name]], [name])
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


def noise_prior(path: Path) -> pd.DataFrame:
    """Noise of one subject by its prior's scale: a row per scale.

    path: `<subject>_noise_prior.csv`. Columns: prior_scale, median and 95 % HPD ends of each
    direction's noise, outside (observations outside the 95 % predictive interval), outputs,
    verdict.
    """
    table = pd.read_csv(path)
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


def recovery(per_case: Path, coverage: Path, diagnostics: Path) -> pd.DataFrame:
    """Accuracy on the test set per parameter and over all.

    per_case: `recovery.csv`; coverage: `coverage.csv`; diagnostics: verdicts of the cases. Columns:
    parameter, cases, failed_cases (posteriors that did not pass their gate; they count like the
    others), map_mse, mean_mse (of the posterior mean), crps, variance_ratio (posterior to prior,
    mean over cases), then the columns of `coverage`.
    """
    table = pd.read_csv(per_case, dtype={"case": str})
    table["map_mse"] = (table["map"] - table["truth"]) ** 2
    table["mean_mse"] = (table["mean"] - table["truth"]) ** 2
    both = pd.concat([table, table.assign(parameter="all")])
    summary = both.groupby("parameter").agg(
        cases=("case", "nunique"),
        map_mse=("map_mse", "mean"),
        mean_mse=("mean_mse", "mean"),
        crps=("crps", "mean"),
        variance_ratio=("variance_ratio", "mean"),
    )
    failed = posterior.failed_cases(diagnostics) & set(table["case"])
    summary.insert(1, "failed_cases", len(failed))
    covered = pd.read_csv(coverage).set_index("parameter")
    # What `coverage` says of the MAP's errors and of failures stands in the summary already.
    again = [*covered.columns.intersection(summary.columns), "failed", "mse"]
    covered = covered.drop(columns=again, errors="ignore")
    return summary.join(covered).loc[[*aha.PARAMETERS, "all"]].reset_index()


def architectures(fits: list[Path]) -> pd.DataFrame:
    """The paper's Table 1 with what each emulator was fitted with.

    fits: reports of training (JSON). Columns: emulator, base_method, training_scope,
    output_structure, deep_component, input_transform, kernel, simulations (that one fit learns
    from: neighbours, or all of them), inducing.
    """
    rows = []
    for path in fits:
        fit = json.loads(Path(path).read_text())
        settings, kind = fit["settings"], REGISTRY[fit["emulator"]].architecture
        kernel = fit.get("kernel", settings.get("kernel", "rq" if "alpha" in fit else ""))
        rows.append(
            kind._asdict()
            | {
                "input_transform": settings["input_transform"],
                "kernel": kernel,
                "simulations": settings.get("neighbours", fit["rows"]),
                "inducing": fit.get("inducing", ""),
            }
        )
    return pd.DataFrame(rows).rename(columns={"label": "emulator"})


def ranking(path: Path) -> pd.DataFrame:
    """The paper's Table S1 and what else the screening measured, of a ranking (CSV)."""
    columns = {
        "rank": "rank",
        "label": "emulator",
        "input_transform": "input_transform",
        "param_mse_least_squares": "param_mse_least_squares",
        "param_mse_weighted": "param_mse_weighted",
        "outside_weighted": "outside",
        "output_mse": "output_mse",
        "checked_by": "checked_by",
        "predictive_mse": "predictive_mse",
        "predictive_crps": "predictive_crps",
        "predictive_coverage95": "predictive_coverage95",
        "training_seconds": "training_seconds",
        "seconds_per_case_weighted": "seconds_per_case",
        "ms_prediction": "ms_prediction",
        "ms_gradient": "ms_gradient",
        "peak_memory_mb": "peak_memory_mb",
        "paper_param_mse": "paper_param_mse",
        "paper_output_mse": "paper_output_mse",
    }
    return pd.read_csv(path)[list(columns)].rename(columns=columns)


def pairs(path: Path) -> pd.DataFrame:
    """Wilcoxon-Holm tests of single- against multi-output emulators, by their labels."""
    table = pd.read_csv(path)
    for column in ("single", "multi", "better"):
        table[column] = [REGISTRY[name].architecture.label for name in table[column]]
    return table


def transforms(path: Path) -> pd.DataFrame:
    """What the input transform does to each emulator (`estimates.transforms`), by its label."""
    table = pd.read_csv(path)
    table["emulator"] = [REGISTRY[name].architecture.label for name in table["emulator"]]
    return table


def sample_efficiency(curves: list[Path]) -> pd.DataFrame:
    """Errors against the number of simulations (`estimates.efficiency`), all curves."""
    return pd.concat([pd.read_csv(path) for path in curves], ignore_index=True)


def save(table: pd.DataFrame, csv: Path, tex: Path) -> None:
    """Write a table as CSV (all digits that matter) and as a LaTeX tabular (four digits)."""
    for path in (csv, tex):
        Path(path).parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(csv, index=False, float_format="%.8g")
    head = " & ".join(_tex(name) for name in table.columns)
    body = [" & ".join(_tex(v) for v in row) for row in table.itertuples(index=False)]
    columns = "".join("r" if pd.api.types.is_numeric_dtype(t) else "l" for t in table.dtypes)
    lines = [rf"\begin{{tabular}}{{@{{}}{columns}@{{}}}}", r"\toprule", rf"{head} \\", r"\midrule"]
    lines += [rf"{row} \\" for row in body] + [r"\bottomrule", r"\end{tabular}"]
    Path(tex).write_text("\n".join(lines) + "\n")


def save_markdown(table: pd.DataFrame, md: Path, heading: str) -> None:
    """Write a table as Markdown (four digits, empty for NaN) under a `heading` of free text."""
    lines = [heading.strip(), ""]
    lines.append("| " + " | ".join(table.columns) + " |")
    lines.append("|" + "---|" * len(table.columns))
    for row in table.itertuples(index=False):
        lines.append("| " + " | ".join(_plain(value) for value in row) + " |")
    Path(md).parent.mkdir(parents=True, exist_ok=True)
    Path(md).write_text("\n".join(lines) + "\n")


def _plain(value: object) -> str:
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value:.4g}"
    return str(value).replace("|", "\\|")


def _tex(value: object) -> str:
    if isinstance(value, str):
        if value in aha.PARAMETERS:
            return f"$C_{value[2]}$ {value[4:]}"
        return value.replace("_", r"\_").replace("%", r"\%")
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value:.4g}"
    return str(value)
