"""Does the posterior find the truth?"""

from collections.abc import Iterable

import numpy as np
import pandas as pd
import scoringrules
from statsmodels.stats.proportion import proportion_confint

from regional_lv.inference.arviz_arrays import hdi95
from regional_lv.paper.sampler.files import Posterior

LEVELS = (50, 80, 95)
"""Central credible intervals whose coverage is counted, in per cent."""


def recovery(posteriors: Iterable[Posterior], verdicts: pd.DataFrame) -> pd.DataFrame:
    """How every posterior, each with a `theta_true`, compares with the truth.

    Columns: case, parameter, truth, map, mean, sd, median, lower95, upper95 (central interval),
    covered50, covered80, covered95 (by it), hpd_lower95, hpd_upper95, hpd_width95,
    crps (continuous ranked probability score of the M draws x_m, the paper's formula:
    mean |x_m - truth| - sum_mm' |x_m - x_m'| / (2 M^2)), variance_ratio (posterior over the uniform
    prior's variance), rank (number of draws below the truth), draws, verdict, zone (the stiffened
    one of a scenario, else empty).
    """
    verdict = dict(zip(verdicts["case"], verdicts["verdict"], strict=True))
    rows = []
    for one in posteriors:
        parameters = one.parameters
        prior_variance = (parameters.upper - parameters.lower) ** 2 / 12
        for i, (name, chains) in enumerate(one.theta.items()):
            draws, truth = chains.ravel(), one.truth[name]
            hpd = hdi95(draws)
            row = {
                "case": one.case,
                "parameter": name,
                "truth": truth,
                "map": one.maximum[name],
                "mean": draws.mean(),
                "sd": draws.std(ddof=1),
                "median": np.median(draws),
            }
            inside = {}
            for level in LEVELS:
                ends = np.quantile(draws, [0.5 - level / 200, 0.5 + level / 200])
                inside[f"covered{level}"] = bool(ends[0] <= truth <= ends[1])
            row |= {"lower95": ends[0], "upper95": ends[1], **inside}
            row |= {
                "hpd_lower95": hpd[0],
                "hpd_upper95": hpd[1],
                "hpd_width95": hpd[1] - hpd[0],
                "crps": float(scoringrules.crps_ensemble(truth, draws, estimator="qd")),
                "variance_ratio": row["sd"] ** 2 / prior_variance[i],
                "rank": int((draws < truth).sum()),
                "draws": len(draws),
                "verdict": verdict[one.case],
                "zone": one.zone,
            }
            rows.append(row)
    return pd.DataFrame(rows)


def clustered_interval(hits: np.ndarray) -> tuple[float, float]:
    """95 % interval of the overall proportion of `hits` (cases, parameters), 0 or 1.

    The P parameters of a case share its emulator error, so that they are worth fewer than P
    independent trials: Clopper-Pearson with the effective number (Korn and Graubard 1998).
    """
    cases, each = hits.shape
    total, share = cases * each, float(hits.mean())
    spread = hits.mean(axis=1).var(ddof=1) / cases if cases > 1 else 0.0
    effective: float = cases  # where nothing tells how alike the parameters of a case are
    if spread > 0:
        effective = min(total, max(cases, share * (1 - share) / spread))
    return proportion_confint(share * effective, effective, method="beta")


SOFT = 0.5
"""A factor below which emulators err most: outputs change fastest with it there."""


ANY_SOFT = f"any below {SOFT:g}"
"""Row of `coverage` over the cases that have such a factor."""


def coverage(table: pd.DataFrame) -> pd.DataFrame:
    """Per parameter and over `all`: how often the truth lies in the central intervals, and errors.

    table: of `recovery`. The last row, `ANY_SOFT`, is over all parameters of the cases of which one
    lies below `SOFT`, if there are any. Columns: parameter, cases, failed (posteriors that did not
    pass the convergence check; they count), coverage<level>, its 95 % interval
    coverage<level>_lower and _upper for 50, 80 and 95 %, bias and mse of the MAP, mean_mse (of the
    posterior mean), crps, variance_ratio (posterior to prior), hpd_width95 (means).
    """
    single = dict(iter(table.groupby("parameter", sort=False)))
    groups = single | {"all": table}
    soft = table.loc[table["truth"] < SOFT, "case"]
    if len(soft):
        groups[ANY_SOFT] = table[table["case"].isin(soft)]
    rows = []
    for name, part in groups.items():
        cases = part["case"].nunique()
        failed = part.loc[part["verdict"] != "passed", "case"].nunique()
        row = {"parameter": name, "cases": cases, "failed": failed}
        for level in LEVELS:
            hits = part[f"covered{level}"].to_numpy(float)
            if name in single:
                ends = proportion_confint(hits.sum(), cases, method="beta")
            else:
                ends = clustered_interval(hits.reshape(cases, -1))
            row[f"coverage{level}"] = hits.mean()
            row[f"coverage{level}_lower"], row[f"coverage{level}_upper"] = ends
        error = part["map"] - part["truth"]
        row |= {"bias": error.mean(), "mse": (error**2).mean()}
        row["mean_mse"] = ((part["mean"] - part["truth"]) ** 2).mean()
        row |= {key: part[key].mean() for key in ("crps", "variance_ratio", "hpd_width95")}
        rows.append(row)
    return pd.DataFrame(rows)


def map_errors(table: pd.DataFrame) -> pd.DataFrame:
    """Mean squared error over the parameters of each case's MAP: case, mse, crps, verdict."""
    squared = table.assign(mse=(table["map"] - table["truth"]) ** 2)
    return (
        squared.groupby("case", sort=False)
        .agg(mse=("mse", "mean"), crps=("crps", "mean"), verdict=("verdict", "first"))
        .reset_index()
    )
