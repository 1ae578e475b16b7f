"""The study's tables: CSV for programs, LaTeX (booktabs) for papers."""

import json
from pathlib import Path

import pandas as pd

from regional_lv import aha
from regional_lv.emulators import REGISTRY
from regional_lv.figures import posterior


def diagnostics(test: Path, subjects: list[Path]) -> pd.DataFrame:
    """Convergence per parameter, as in the paper's Tables S3-S6.

    test, subjects: `diagnostics.csv` files (case, parameter, rhat, ess_bulk, ess_tail,
    divergences, passed, verdict). The test set is summarised over its cases by mean, median and
    worst value; each subject stands for itself. Columns: posterior, parameter, cases, rhat_mean,
    rhat_median, rhat_max, ess_bulk_mean, ess_bulk_median, ess_bulk_min, ess_tail_min, divergences
    (sum over cases), failed_cases, verdict.
    """
    test_set = pd.read_csv(test, dtype={"case": str})
    parts = [("test set", test_set)]
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


def _tex(value: object) -> str:
    if isinstance(value, str):
        if value in aha.PARAMETERS:
            return f"$C_{value[2]}$ {value[4:]}"
        return value.replace("_", r"\_").replace("%", r"\%")
    return f"{value:.4g}" if isinstance(value, float) else str(value)
