"""Tables of single subjects."""

from pathlib import Path

import pandas as pd

from regional_lv.criticism.case_posterior import SOURCES, read_averaged
from regional_lv.tables.writing import written


@written
def subjects(posteriors: list[Path], findings: list[Path], sources: list[str]) -> pd.DataFrame:
    """Stiffness and noise of every subject, averaged over models.

    posteriors: files (NetCDF) of one subject each; findings: theirs; sources:
    `subjects.<name>.source` of the config; all in the same order. Columns: subject, data,
    parameter, mean, sd, lower95 and upper95 (central), the same of the model as it is,
    `as_is_mean` to `as_is_upper95`, verdict. Noise scales are in sds of the training data.
    """
    tables = []
    for path, found, source in zip(posteriors, findings, sources, strict=True):
        one = read_averaged(path, found)
        table = one.summary().reset_index()
        table.insert(0, "subject", one.case)
        table.insert(1, "data", SOURCES[source])
        table["verdict"] = one.verdict
        tables.append(table)
    if tables:
        return pd.concat(tables, ignore_index=True)
    moments = ("mean", "sd", "lower95", "upper95")
    columns = [*moments, *(f"as_is_{each}" for each in moments)]
    return pd.DataFrame(columns=["subject", "data", "parameter", *columns, "verdict"])
