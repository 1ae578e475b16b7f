"""Did the chains converge?"""

from collections.abc import Iterable, Sequence

import arviz as az
import numpy as np
import pandas as pd

from regional_lv.inference.arviz_arrays import PARETO_K
from regional_lv.paper.sampler.files import Posterior


def check_convergence(
    chains: np.ndarray,
    names: Sequence[str],
    diverging: np.ndarray,
    rhat_max: float,
    ess_min: float,
    pareto_k: float,
    weighted_ess: float,
) -> tuple[pd.DataFrame, str]:
    """Convergence of one case: a row per parameter, and the verdict.

    chains: (chain, draw, P). diverging: (chain, draw). Rank-normalised split R-hat, bulk and tail
    effective sample size (Vehtari et al. 2021, doi 10.1214/20-BA1221), both at least `ess_min`.
    pareto_k, weighted_ess: of the draws' importance weights; k may be NaN (nothing was weighted).
    Columns: parameter, rhat, ess_bulk, ess_tail, divergences, pareto_k, weighted_ess, passed. The
    verdict is "passed", or "failed: " and every reason; one diverging draw is reason enough.
    """
    data = az.convert_to_dataset({"x": chains})
    table = pd.DataFrame(
        {
            "parameter": list(names),
            "rhat": az.rhat(data, method="rank")["x"].to_numpy(),
            "ess_bulk": az.ess(data, method="bulk")["x"].to_numpy(),
            "ess_tail": az.ess(data, method="tail")["x"].to_numpy(),
            "divergences": int(diverging.sum()),
            "pareto_k": pareto_k,
            "weighted_ess": weighted_ess,
        }
    )
    # Of draws that are all the same neither is a number, and NaN passes no comparison.
    mixed = table["rhat"] <= rhat_max
    enough = {kind: table[f"ess_{kind}"] >= ess_min for kind in ("bulk", "tail")}
    even, sufficient = not pareto_k > PARETO_K, weighted_ess >= ess_min
    table["passed"] = mixed & enough["bulk"] & enough["tail"] & (table["divergences"] == 0)
    table["passed"] &= even and sufficient
    reasons = []
    still = table.loc[table["rhat"].isna(), "parameter"].tolist()
    if still:
        reasons.append(f"{', '.join(still)} never moved")
    if (table["rhat"] > rhat_max).any():
        reasons.append(f"R-hat {table['rhat'].max():.3f} > {rhat_max:g}")
    for kind in enough:
        if (table[f"ess_{kind}"] < ess_min).any():
            reasons.append(f"{kind} ESS {table[f'ess_{kind}'].min():.0f} < {ess_min:g}")
    if diverging.any():
        reasons.append(f"{int(diverging.sum())} divergences")
    if not even:
        reasons.append(f"Pareto k {pareto_k:.2f} > {PARETO_K:g}")
    if not sufficient:
        reasons.append(f"ESS of the weights {weighted_ess:.0f} < {ess_min:g}")
    if not reasons and not table["passed"].all():
        reasons.append("a diagnostic is no number")
    return table, "failed: " + "; ".join(reasons) if reasons else "passed"


def diagnose(posteriors: Iterable[Posterior]) -> pd.DataFrame:
    """Diagnostics of every case.

    Columns: case, those of `check_convergence`, verdict, outside (share of the draws that lie where
    no simulation of the training set is near), seconds, sampler.
    Inferred noise scales appear as `sigma_<quantity>`. The limits of the convergence check are
    those that the sampler worked with, kept in the file.
    """
    tables = []
    for one in posteriors:
        limits, stats = one.groups["posterior"].attrs, one.groups["sample_stats"]
        table, verdict = check_convergence(
            one.chains,
            [*one.theta, *one.sigma],
            stats["diverging"].transpose("chain", "draw").to_numpy(),
            limits["rhat_max"],
            limits["ess_min"],
            *(float(one.constant[key]) for key in ("pareto_k", "weighted_ess")),
        )
        table.insert(0, "case", one.case)
        table["verdict"] = verdict
        table["outside"] = float(stats["outside"].mean())
        table["seconds"] = float(one.constant["seconds"])
        table["sampler"] = one.sampler
        tables.append(table)
    return pd.concat(tables, ignore_index=True)
