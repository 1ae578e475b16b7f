"""The answers of all hearts of a cohort in tables: a row for each heart, one for each factor of the
stiffness over all hearts, and one for each cause."""

import json
import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from regional_lv.criticism import words
from regional_lv.criticism.contract import Findings, Summary, read_findings
from regional_lv.errors import InputError
from regional_lv.hearts import hierarchy
from regional_lv.hearts.hierarchy import infer_population
from regional_lv.hearts.likelihoods import NormalLikelihood
from regional_lv.hearts.prevalence import (
    default_prior,
    infer_prevalence,
    log_bayes_factors,
    weights_given_others,
)
from regional_lv.inference.posteriors import load
from regional_lv.inputs.stiffness import StiffnessInputs
from regional_lv.seeds import derive
from regional_lv.study.layout import AnswerFiles, BatchFiles

log = logging.getLogger(__name__)

DRAWS_PER_FACTOR = 20
"""Effective draws, by factor, from which on the precision of a heart's factors is by less than a
tenth too large: of n draws of P factors by n / (n - P - 2)."""

TOO_FEW = (
    "left out of the population: models that the other hearts make probable have only {:.0f} "
    "effective draws of this one"
)

POPULATION = [
    "parameter",
    "mean",
    "mean_lower95",
    "mean_upper95",
    "sd",
    "sd_lower95",
    "sd_upper95",
    "hearts_lower95",
    "hearts_upper95",
    "shrinkage",
    "hearts",
    "rhat",
]
CAUSES = [
    "cause",
    "hearts",
    "present",
    "share",
    "share_lower95",
    "share_upper95",
    "log_bayes_factor",
    "probability_any",
]


class Answered(NamedTuple):
    """A heart that was answered: its row, whether its stiffness can be trusted, log Bayes factors
    of causes and their prior probabilities, and the file of its posterior."""

    row: dict
    trusted: bool
    log_factors: Mapping[str, float]
    prior: Mapping[str, float]
    posterior: str


def summarise_cohort(
    hearts: Sequence[str],
    batches: Sequence[str | Path],
    checked: str | Path,
    parameters: StiffnessInputs,
    prevalence_prior: Sequence[float] | None,
    seed: int,
    table: str | Path,
    population: str | Path,
    causes: str | Path,
) -> None:
    """Write the tables of a cohort.

    hearts: names of all that are listed. batches: folders of `batches.answer_batch`. checked: of
    `cohort.check_cohort`. prevalence_prior: of the share of hearts with a cause, both parameters of
    a Beta distribution; None for `prevalence.default_prior`.

    table (Parquet): a row for each heart. `heart`, `reason` why it was not answered (empty if it
    was); what was read of it; `trusted`, `misfit_p_value`, `causes`, `verdict` and more of its
    findings; of each factor its mean, `_sd`, `_lower95`, `_upper95` averaged over models, the same
    `_as_is`, and given all other hearts `_pooled` (median), `_pooled_lower95`, `_pooled_upper95`,
    `_shrinkage`; of each cause `_probability`, `_estimate`, `_lower95`, `_upper95`,
    `_log_bayes_factor`, and given all other hearts `_pooled_probability`.
    population (CSV): `POPULATION`, as of `hierarchy.Population.table`; no rows for fewer hearts
    than `hierarchy.FEWEST`. causes (CSV): `CAUSES`; hearts: in how many it was searched; present:
    how many have it more probably than not, given all others.

    Hearts whose stiffness cannot be trusted have a row, and count for nothing else; those whose
    draws are too few for what the others expect are left out of the population, with a warning.
    Raises InputError if no heart was answered.
    """
    reasons, known = _read_reasons(batches, checked)
    places = {path.name: path for batch in batches for path in Path(batch).iterdir()}
    folder = Path(table).parent
    answered: dict[str, Answered] = {}
    rows = []
    for name in hearts:
        row = {"heart": name, "reason": reasons.get(name, "")}
        if not row["reason"]:
            files = AnswerFiles(str(places[name]))
            answered[name] = _read_answer(files)
            page = str(Path(files.page).relative_to(folder))
            row |= {"page": page, **_read_of(known[name]), **answered[name].row}
        rows.append(row)
    if not answered:
        lines = "\n".join(f"{name}: {why}" for name, why in reasons.items())
        raise InputError(f"cohort: no heart was answered; correct what is wrong:\n{lines}")
    of_hearts = pd.DataFrame(rows).set_index("heart")
    trusted = {name: one for name, one in answered.items() if one.trusted}
    of_causes, probabilities, expected = _prevalences(trusted, prevalence_prior)
    likelihoods = {}
    for name, one in trusted.items():
        found, effective = _likelihood(one.posterior, parameters, expected[name])
        if effective >= DRAWS_PER_FACTOR * len(parameters):
            likelihoods[name] = found
            continue
        log.warning("%s: %s", name, line := TOO_FEW.format(effective))
        of_hearts.loc[name, "warnings"] = f"{of_hearts.loc[name, 'warnings']}\n{line}".strip()
    given = [*likelihoods], [*likelihoods.values()]
    of_factors, pooled = _pool(*given, parameters, derive(seed, "population"))
    of_hearts = pd.concat([of_hearts, pooled, probabilities], axis=1).loc[[*hearts]]
    of_hearts.rename_axis("heart").reset_index().to_parquet(table, index=False)
    of_factors.to_csv(population, index=False, float_format="%.8g")
    of_causes.to_csv(causes, index=False, float_format="%.8g")


def _read_reasons(batches: Sequence[str | Path], checked: str | Path) -> tuple[dict, dict]:
    """Why hearts were not answered, and what was read of the others, by heart."""
    content = json.loads(Path(checked).read_text())
    reasons: dict[str, str] = {}
    for batch in batches:
        reasons |= json.loads(Path(BatchFiles(str(batch)).failed).read_text())
    return reasons | content["left_out"], content["hearts"]


def _read_of(known: Mapping) -> dict:
    return {**known, "warnings": "\n".join(known["warnings"])}


def _read_answer(files: AnswerFiles) -> Answered:
    findings = read_findings(files.findings)
    data = load(files.posterior)
    log_factors = log_bayes_factors(data)
    prior = data.constant_data["prior_probability"].to_series().to_dict()
    row = _row(findings) | {f"{c}_log_bayes_factor": value for c, value in log_factors.items()}
    return Answered(row, findings["trusted"], log_factors, prior, files.posterior)


def _row(findings: Findings) -> dict:
    """What the findings of a heart say, in columns."""
    called = [words.causes(findings, findings["named"])] if findings["named"] else []
    called += [f"one of {' or '.join(map(words.cause, group))}" for group in findings["groups"]]
    row = {
        "trusted": findings["trusted"],
        "misfit_detected": findings["misfit"]["detected"],
        "misfit_p_value": findings["misfit"]["p_value"],
        "causes": "; ".join(called),
        "certainty": words.certainty(findings).lower() if called else "",
        "acts_like": "; ".join(map(words.cause, findings["acts_like"])),
        "as_is_probability": findings["base_probability"],
        "unlisted_probability": findings["unlisted_probability"],
        "effective_draws": findings["ess"],
        "verdict": " ".join(findings["words"]),
    }
    for known in findings["stiffness"]:
        row |= _columns(known["name"], known["averaged"])
        row |= _columns(f"{known['name']}_as_is", known["as_it_is"])
    for measured in findings["measured_inputs"]:
        row |= _columns(measured["name"], measured["averaged"])
    for cause in findings["hypotheses"]:
        name, (low, high) = cause["name"], cause["interval95"]
        row |= {f"{name}_probability": cause["probability"], f"{name}_estimate": cause["estimate"]}
        row |= {f"{name}_lower95": low, f"{name}_upper95": high}
    return row


def _columns(name: str, summary: Summary) -> dict:
    low, high = summary["interval95"]
    ends = {f"{name}_lower95": low, f"{name}_upper95": high}
    return {name: summary["mean"], f"{name}_sd": summary["sd"], **ends}


def _pool(
    hearts: Sequence[str],
    likelihoods: list[NormalLikelihood],
    parameters: StiffnessInputs,
    seed: int,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The stiffness of the population, and that of each heart given all others."""
    names = [*parameters.names]
    if len(hearts) < hierarchy.FEWEST:
        return pd.DataFrame(columns=POPULATION), pd.DataFrame(index=[*hearts])
    stacked = NormalLikelihood.stack(likelihoods)
    found = infer_population(stacked, parameters.lower, parameters.upper, derive(seed, "sampler"))
    table = found.table(names, derive(seed, "table")).assign(hearts=len(hearts), rhat=found.rhat)
    low, middle, high = np.exp(found.heart_quantiles)
    columns: dict[str, np.ndarray] = {}
    for k, name in enumerate(names):
        columns |= {f"{name}_pooled": middle[:, k], f"{name}_shrinkage": found.shrinkage[:, k]}
        columns |= {f"{name}_pooled_lower95": low[:, k], f"{name}_pooled_upper95": high[:, k]}
    return table[POPULATION], pd.DataFrame(columns, index=[*hearts])


def _likelihood(
    file: str, parameters: StiffnessInputs, expected: Mapping[str, float]
) -> tuple[NormalLikelihood, float]:
    """What the data of a heart say of its stiffness, averaged over models as probable as the other
    hearts make them; and how many equally weighted draws say as much."""
    data, names = load(file), [*parameters.names]
    draws = data.posterior["value"].sel(input=names).stack(n=("chain", "draw"))
    lower, upper = (
        data.constant_data[end].sel(input=names).to_numpy() for end in ("lower", "upper")
    )
    of_models = weights_given_others(data, expected)
    weights = of_models[data.posterior["model_number"].to_numpy().ravel()]
    values = draws.transpose("n", "input").to_numpy()
    effective = float(weights.sum() ** 2 / np.square(weights).sum())
    return NormalLikelihood.of_draws(values, lower, upper, weights), effective


def _prevalences(
    hearts: Mapping[str, Answered], given: Sequence[float] | None
) -> tuple[pd.DataFrame, pd.DataFrame, dict[str, dict[str, float]]]:
    """In how many hearts causes are; the probability in each given all others; and by heart and
    cause how probable the others alone make it."""
    factors = pd.DataFrame({name: one.log_factors for name, one in hearts.items()}).T
    rows, columns = [], dict[str, pd.Series]()
    expected: dict[str, dict[str, float]] = {name: {} for name in hearts}
    for cause in factors:
        searched = factors[cause].dropna()
        by_itself = float(np.mean([hearts[name].prior[cause] for name in searched.index]))
        prior = given or default_prior(by_itself)
        found = infer_prevalence(searched.to_numpy(float), prior, factors.shape[1])
        low, middle, high = found.share
        columns[f"{cause}_pooled_probability"] = pd.Series(found.probability, searched.index)
        for name, probability in zip(searched.index, found.expected, strict=True):
            expected[name][cause] = float(probability)
        rows.append(
            {
                "cause": cause,
                "hearts": len(searched),
                "present": int((found.probability > 0.5).sum()),
                "share": middle,
                "share_lower95": low,
                "share_upper95": high,
                "log_bayes_factor": found.log_bayes_factor,
                "probability_any": found.probability_any,
            }
        )
    table = pd.DataFrame(rows, columns=CAUSES).sort_values("log_bayes_factor", ascending=False)
    return table, pd.DataFrame(columns, index=[*hearts]), expected
