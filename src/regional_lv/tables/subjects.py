"""Tables of single subjects."""

from pathlib import Path

import arviz as az
import pandas as pd

from regional_lv.criticism.case_posterior import SOURCES, read, read_subject
from regional_lv.tables.writing import written


@written
def subjects(
    posteriors: list[Path],
    diagnostics: list[Path] | None,
    sources: list[str],
    findings: list[Path] | None = None,
) -> pd.DataFrame:
    """Stiffness and noise of every subject.

    posteriors: files (NetCDF) of one subject each; diagnostics: CSV with its verdict; or
    findings, where posteriors are averaged over models. sources: `subjects.<name>.source` of the
    config; all in the same order. Columns: subject, data, parameter, then median, lower95 and
    upper95 (95 % HPD interval); or of the average mean, sd, lower95 and upper95 (central), and the
    same of the model as it is, `as_is_mean` to `as_is_upper95`; verdict. Noise scales of the model
    as it is alone are in standardised units, others in those of a good measurement's noise.
    """
    tables = []
    absent = [None] * len(posteriors)
    files = zip(posteriors, diagnostics or absent, findings or absent, sources, strict=True)
    for path, check, found, source in files:
        one = read_subject(path, check, found)
        table = one.summary().reset_index()
        table.insert(0, "subject", one.case)
        table.insert(1, "data", SOURCES[source])
        table["verdict"] = one.verdict
        tables.append(table)
    columns = ["subject", "data", "parameter", "median", "lower95", "upper95", "verdict"]
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=columns)


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
