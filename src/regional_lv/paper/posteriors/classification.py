"""Can a stiffened zone be told from baseline? Scenario posteriors as a classification."""

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import gmean

from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.paper.sampler.diagnostics import diagnose
from regional_lv.paper.sampler.files import read
from regional_lv.paper.scenarios import stiffened
from regional_lv.seeds import derive

BOTH = "both"
"""Name of the geometric mean of a zone's factors, beside the factors' own."""

RESAMPLES = 500
EDGE = 1.96
"""Standard deviations of healthy zones above their mean at which stiffness begins."""


def stiffness(theta: np.ndarray, parameters: StiffnessInputs) -> np.ndarray:
    """The F factors and `BOTH`, their geometric mean, of every zone: (..., P) -> (..., Z, F + 1).

    The factors of a zone compensate; their geometric mean lies across that ridge.
    """
    factors = parameters.table(theta)
    return np.concatenate([factors, gmean(factors, axis=-1, keepdims=True)], axis=-1)


def classify_zones(posteriors: Sequence[str | Path], healthy: dict, classified: str | Path) -> None:
    """Probability that each zone of each case is stiffer than baseline.

    healthy: `mean` and `sd` of the factors of healthy zones. Baseline ends at mean + 1.96 sd: a
    zone above it is no ordinary one. classified: case, stiff_zone, zone, quantity (a factor, or
    `BOTH`), stiffened (bool), probability, truth, verdict.
    """
    edge = healthy["mean"] + EDGE * healthy["sd"]
    rows = []
    for path in posteriors:
        cases = read(path)
        verdicts = diagnose(cases).groupby("case")["verdict"].first()
        for one in cases:
            parameters, stiff = one.parameters, one.zone
            draws = stiffness(np.stack([*one.theta.values()], axis=-1), parameters)
            shares = (draws > edge).mean(axis=(0, 1))
            true = stiffness(np.array([*one.truth.values()]), parameters)
            for z, zone in enumerate(parameters.zones):
                for q, quantity in enumerate((*parameters.factors, BOTH)):
                    rows.append(
                        {
                            "case": one.case,
                            "stiff_zone": stiff,
                            "zone": zone,
                            "quantity": quantity,
                            "stiffened": stiffened(zone, stiff),
                            "probability": shares[z, q],
                            "truth": true[z, q],
                            "verdict": verdicts[one.case],
                        }
                    )
    pd.DataFrame(rows).to_csv(classified, index=False)


def score_classification(
    classified: str | Path, local: Sequence[str | Path], roc: str | Path, auc: str | Path, seed: int
) -> None:
    """ROC and AUC of the probabilities of one scenario.

    classified: of that scenario. local: tables of the local scenarios with the same noise; where
    a scenario has no healthy zone (global stiffening), theirs are compared with. roc: quantity,
    zone (`all` or one), threshold, false_positive_rate, true_positive_rate. auc: quantity, zone,
    auc, auc_lower, auc_upper (95 %, cases resampled), positives, negatives, negatives_from
    (`itself` or `local`). Without any healthy zone the numbers are empty.
    """
    table, source = pd.read_csv(classified, dtype={"case": str}), "itself"
    if table["stiffened"].all() and local:
        parts = [pd.read_csv(path, dtype={"case": str}).assign(origin=str(path)) for path in local]
        others, source = pd.concat(parts), "local"
        table = pd.concat([table.assign(origin="own"), others[~others["stiffened"]]])
    else:
        table = table.assign(origin="own")
    table["group"] = table["origin"] + "/" + table["case"]
    curves, areas = [], []
    for quantity in table["quantity"].unique():
        for zone in ("all", *table["zone"].unique()):
            part = table[table["quantity"] == quantity]
            part = part if zone == "all" else part[part["zone"] == zone]
            label, score = part["stiffened"].to_numpy(bool), part["probability"].to_numpy()
            common = {"quantity": quantity, "zone": zone}
            curve = curve_of(label, score)
            curves.append(curve.assign(**common)[[*common, *curve.columns]])
            rng = np.random.default_rng(derive(seed, "auc", quantity, zone))
            low, high = auc_interval(label, score, part["group"].to_numpy(), rng)
            areas.append(
                common
                | {
                    "auc": area(label, score),
                    "auc_lower": low,
                    "auc_upper": high,
                    "positives": int(label.sum()),
                    "negatives": int((~label).sum()),
                    "negatives_from": source,
                }
            )
    pd.concat(curves, ignore_index=True).to_csv(roc, index=False)
    pd.DataFrame(areas).to_csv(auc, index=False)


def curve_of(label: np.ndarray, score: np.ndarray) -> pd.DataFrame:
    """Rates of false and true positives when scores of at least `threshold` count as positive; NaN
    is the rate of a class that there is none of."""
    # Slow to load, and the pages of subjects load this module.
    from sklearn.exceptions import UndefinedMetricWarning
    from sklearn.metrics import roc_curve

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UndefinedMetricWarning)
        false, true, threshold = roc_curve(label, score, drop_intermediate=False)
    return pd.DataFrame(
        {"threshold": threshold, "false_positive_rate": false, "true_positive_rate": true}
    )


def area(label: np.ndarray, score: np.ndarray) -> float:
    """Area under the ROC curve; NaN if there is only one class."""
    return float(areas_of(label, score, np.ones((1, len(label)), dtype=int))[0])


def areas_of(label: np.ndarray, score: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Areas (R,) under the ROC curves of R resamples, which count rows `counts` (R, N) times.

    The share of pairs of a positive and a negative in which the positive has the larger score, ties
    for half; NaN if only one class is left. All resamples at once, because one after the other took
    most of the job's time.
    """
    order = np.argsort(score, kind="stable")
    label, counts = label[order].astype(bool), counts[:, order]
    ties = np.flatnonzero(np.diff(score[order], prepend=np.nan) != 0)
    positive, negative = (
        np.add.reduceat(counts * of_class, ties, axis=1) for of_class in (label, ~label)
    )
    won = (positive * (negative.cumsum(axis=1) - negative / 2)).sum(axis=1)
    pairs = positive.sum(axis=1) * negative.sum(axis=1)
    return np.divide(won, pairs, out=np.full(len(counts), np.nan), where=pairs > 0)


def auc_interval(label, score, group, rng: np.random.Generator) -> tuple[float, float]:
    """95 % interval of the area from resampled cases: the zones of a case belong together."""
    cases, case = np.unique(group, return_inverse=True)
    drawn = rng.integers(len(cases), size=(RESAMPLES, len(cases)))
    times = np.stack([np.bincount(row, minlength=len(cases)) for row in drawn])
    areas = areas_of(label, score, times[:, case])
    if np.isnan(areas).all():
        return float("nan"), float("nan")
    low, high = np.nanquantile(areas, [0.025, 0.975])
    return float(low), float(high)
