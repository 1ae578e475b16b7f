"""The score of the benchmark of hidden effects: verdicts against the truth, and against the models
that a benchmark knows to be true. Nothing else reads a truth.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from scipy import stats

from regional_lv import emulators
from regional_lv.criticism.benchmark import measured_of
from regional_lv.criticism.injection import EFFECTS
from regional_lv.criticism.rates import confusions, rate, weighted_rate
from regional_lv.emulators.base import Emulator
from regional_lv.errors import InputError
from regional_lv.inference import importance
from regional_lv.inference.averaging import LEVELS, RESAMPLED
from regional_lv.inference.drawing import ITERATIONS, LEAST_GAIN, sample
from regional_lv.inference.emulated import EmulatedInputs
from regional_lv.inference.evidence import WEAK, Fits, fit
from regional_lv.inference.likelihood import Noise
from regional_lv.inference.potential import Potential
from regional_lv.inputs.space import Inputs
from regional_lv.seeds import derive

FAR = 3.0
"""Standard errors, given the other effects, from which on an injected effect has to be found."""

LISTED = ("singles", "pairs", "triples", "nulls")
"""Groups whose causes are all in the catalogue that is searched."""

DRAWS = 1000
"""Of a round of sampling of a true model."""

BINS = (0.0, 0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 1.0)
"""Ends of the bins of probabilities in the table of reliability."""

MODELS = {"averaged": "averaged", "as_it_is": "as it is", "true": "true model"}
"""Posteriors whose intervals of stiffness are judged, and what they are called."""


# --------------------------------------------------------------------------------- true models


def sample_true_models(
    subjects: str | Path,
    truth: str | Path,
    emulator: str | Path,
    physics: Mapping,
    seed: int,
    models: str | Path,
) -> None:
    """What the true model of each heart of a batch says, in which exactly the inputs are free that
    are not at their nominal values; write it (Parquet).

    One row per effect and inferred input: `subject`, `input`, `role`, `cause` and `place` (of
    effects), the true `value`, `expected_z` (effects: `expected_scores`), ends of the 95 %
    interval, `low` and `high`. Unlisted hearts have no true model: of them the values alone, and of
    their inferred inputs only if `has_stiffness`. emulator: over all inputs. physics: what
    `inputs.space.sections_of` gives. seed: the study's.
    """
    inputs, trained = Inputs.from_config(physics), emulators.load(emulator)
    known = pd.read_parquet(truth).set_index("subject")
    rows: list[dict] = []
    for _, row in pd.read_parquet(subjects).iterrows():
        name = row["subject"]
        true = known.loc[name]
        values = json.loads(true["values"])
        if true["has_stiffness"]:
            potential = potential_of(measured_of(row), trained, inputs)
            listed = true["group"] != "unlisted"
            own = derive(seed, "true model", name)
            rows += [{"subject": name} | r for r in true_model(potential, values, listed, own)]
    columns = ["subject", "input", "role", "cause", "place", "value", "expected_z", "low", "high"]
    pd.DataFrame(rows, columns=columns).to_parquet(models, index=False)


def potential_of(table: pd.DataFrame, emulator: Emulator, inputs: Inputs) -> Potential:
    """The posterior of a measured table whose noise is known.

    emulator: over all inputs.
    """
    table = table.set_index("output")
    chosen = emulator.select([name for name in emulator.outputs if name in table.index])
    table = table.loc[list(chosen.outputs)]
    y, sd = (torch.as_tensor(table[column].to_numpy(float)) for column in ("value", "sd"))
    return Potential(EmulatedInputs(chosen, inputs), inputs, y, Noise.known(sd))


def true_model(
    potential: Potential, values: Mapping[str, float], listed: bool, seed: int
) -> list[dict]:
    """Rows of `sample_true_models` of one heart.

    values: by input, among others. listed: whether it has a true model.
    """
    inputs = potential.inputs
    x = potential.nominal[None].clone()
    natural = np.array([values.get(e.name, v) for e, v in zip(inputs, inputs.nominal, strict=True)])
    x[0, : len(inputs)] = torch.as_tensor(inputs.coordinates.scaled(natural))
    on = [k for k in potential.suspected if x[0, k] != potential.nominal[k]]
    inferred = np.flatnonzero(inputs.of_role("inferred")).tolist()
    reported = [*on, *inferred] if listed else inferred
    rows = {k: {"input": inputs[k].name, "value": natural[k]} for k in reported}
    for k in reported:
        role = "effect" if k in on else "inferred"
        rows[k] |= {"role": role, "cause": inputs[k].cause, "place": inputs[k].place}
    if listed:
        free = potential.free(on)[None]
        for k, score in expected_scores(potential, x, free, on).items():
            rows[k]["expected_z"] = score
        fitted = _fitted(potential, x, free)
        for k, (low, high) in _intervals(potential, fitted, reported, seed).items():
            rows[k] |= {"low": low, "high": high}
    return list(rows.values())


def expected_scores(
    potential: Potential, x: torch.Tensor, free: torch.Tensor, on: Sequence[int]
) -> dict[int, float]:
    """By place, the distance of each effect `on` from its nominal value in standard errors, as the
    linear model about the truth has them, with everything else that is `free` estimated too.

    x (1, P): the truth. free (1, P): of the true model.
    """
    error = potential.settle(x, x.new_zeros(1))
    found = potential.quadratic(*potential.linearise(x), x, error)
    precision = found.curvature[0] + torch.diag(WEAK / potential.width.square())
    which = torch.nonzero(free[0])[:, 0]
    covariance = torch.linalg.inv(precision[which][:, which])
    sd = dict(zip(which.tolist(), covariance.diagonal().sqrt().tolist(), strict=True))
    return {k: float((x[0, k] - potential.nominal[k]).abs()) / sd[k] for k in on}


def _fitted(potential: Potential, x: torch.Tensor, free: torch.Tensor) -> Fits:
    zero = x.new_zeros(1)
    error = potential.settle(x, zero)
    return fit(potential, free, zero, x, error, ITERATIONS, LEAST_GAIN)


def _intervals(
    potential: Potential, fitted: Fits, which: Sequence[int], seed: int
) -> dict[int, tuple[float, float]]:
    """Central 95 % intervals of the inputs at some places, in their units."""
    drawn = sample(potential, fitted, DRAWS, seed)
    x = drawn.x[importance.resample(drawn.weight, RESAMPLED)]
    ends = np.quantile(x[:, list(which)].numpy(), LEVELS, axis=0).T
    scales = [potential.inputs[k].scale for k in which]
    return {
        k: (float(scale.inverse(low)), float(scale.inverse(high)))
        for k, scale, (low, high) in zip(which, scales, ends, strict=True)
    }


# ---------------------------------------------------------------------------------------- score


def score_benchmark(
    findings: Sequence[str | Path],
    truth: Sequence[str | Path],
    models: Sequence[str | Path],
    cases: str | Path,
    stiffness: str | Path,
    confusion: str | Path,
    reliability: str | Path,
    summary: str | Path,
) -> None:
    """Compare what was found with the truth; write a row per effect, and one per heart without any
    (`cases`), a row per heart and inferred input (`stiffness`), the table of confusions, that of
    probabilities (`reliabilities`), all CSV, and the rates that count (`summarise`, JSON).

    findings, truth, models: batches of `benchmark.criticise_batch`, `injection.inject_batch` and
    `sample_true_models`.
    """
    found: dict[str, dict] = {}
    for path in findings:
        found |= json.loads(Path(path).read_text())
    if not found:
        raise InputError(f"{findings[0]}: no heart was criticised; make the benchmark again")
    known = pd.concat(map(pd.read_parquet, truth), ignore_index=True).set_index("subject")
    true = pd.concat(map(pd.read_parquet, models), ignore_index=True)
    effects, inferred = (true[true["role"] == role] for role in ("effect", "inferred"))
    by_heart = dict(tuple(effects.groupby("subject")))
    rows, probabilities = [], []
    for name, own in found.items():
        heart, here = known.loc[name], by_heart.get(name, effects.iloc[:0])
        rows += cases_of(name, heart, own, here)
        if heart["group"] in LISTED:
            probabilities += _probabilities(own, set(here["cause"]), len(here))
    tables = {
        cases: pd.DataFrame(rows),
        stiffness: stiffness_of(found, known, inferred),
        reliability: reliabilities(pd.DataFrame(probabilities)),
    }
    for path, table in tables.items():
        table.to_csv(path, index=False)
    confusions(tables[cases]).to_csv(confusion)
    content = summarise(tables[cases], tables[stiffness])
    Path(summary).write_text(json.dumps(content, indent=1) + "\n")


def cases_of(name: str, heart: pd.Series, own: Mapping, effects: pd.DataFrame) -> list[dict]:
    """Rows of the table of cases of one heart.

    heart: its row of the truth; own: its findings (`benchmark.reduced`); effects: its rows of the
    true models. `wrong_named`: a cause is named that is absent, or in a wrong place, or a group is
    of absent ones. `contains`: whether the answer has the effect, in its place; `covered`: whether
    the interval of one that it has holds its value.
    """
    present = dict(zip(effects["cause"], effects["place"], strict=True))
    causes = {cause["name"]: cause for cause in own["causes"]}
    answer = [*own["named"], *(n for group in own["groups"] for n in group)]

    def right(cause: str) -> bool:
        return cause in present and (causes[cause]["component"] or "") == present[cause]

    wrong = any(not right(cause) for cause in own["named"])
    wrong |= any(not any(map(right, group)) for group in own["groups"])
    common = {
        "subject": name,
        "group": heart["group"],
        "unlisted": heart["unlisted"],
        "detail": heart["detail"],
        "named": " ".join(own["named"]),
        "answer": " ".join(dict.fromkeys(answer)) or "none",
        "wrong_named": wrong,
        **{key: own[key] for key in ("explained", "trusted", "detected", "misfit_p_value")},
        **{key: own[key] for key in ("remaining_p_value", "base_probability")},
        **{key: own[key] for key in ("unlisted_probability", "seconds", "simulation_seconds")},
        "simulations": own["confirmation"]["simulations"],
        "confirmed": own["confirmation"]["agrees"],
        "error_sd": own["confirmation"]["largest_error_sd"],
    }
    if effects.empty:
        none = heart["unlisted"] or {"misread": "misread table"}.get(heart["group"], "none")
        return [common | {"effect": none, "contains": np.nan, "covered": np.nan}]
    rows = []
    for _, effect in effects.iterrows():
        cause, contains = causes[effect["cause"]], effect["cause"] in answer
        contains = contains and right(effect["cause"])
        low, high = cause["interval95"] or (np.nan, np.nan)
        rows.append(
            common
            | {"effect": effect["cause"], "place": effect["place"], "value": effect["value"]}
            | {"expected_z": effect["expected_z"], "contains": contains}
            | {"covered": bool(low <= effect["value"] <= high) if contains else np.nan}
            | {key: cause[key] for key in ("probability", "estimate", "identifiable", "at_bound")}
            | {"low": low, "high": high, "true_low": effect["low"], "true_high": effect["high"]}
        )
    return rows


def stiffness_of(
    found: Mapping[str, Mapping], truth: pd.DataFrame, inferred: pd.DataFrame
) -> pd.DataFrame:
    """By heart and inferred input the true value, the 95 % intervals of each of `MODELS`
    (`averaged_low`, ...), and whether these hold it (`averaged_covers`; NaN without interval)."""
    rows = []
    answers = {
        (name, each["name"]): each | {"trusted": own["trusted"]}
        for name, own in found.items()
        for each in own["stiffness"]
    }
    for _, true in inferred.iterrows():
        own = answers.get((true["subject"], true["input"]))
        if own is None:
            continue
        heart = truth.loc[true["subject"]]
        row = {"subject": true["subject"], "group": heart["group"], "unlisted": heart["unlisted"]}
        row |= {"input": true["input"], "value": true["value"], "trusted": own["trusted"]}
        ends = {model: own[model]["interval95"] for model in ("averaged", "as_it_is")}
        ends["true"] = (true["low"], true["high"])
        for model, (low, high) in ends.items():
            covers = np.nan if pd.isna(low) else float(low <= true["value"] <= high)
            row |= {f"{model}_low": low, f"{model}_high": high, f"{model}_covers": covers}
        rows.append(row)
    columns = [f"{model}_{what}" for model in MODELS for what in ("low", "high", "covers")]
    own = ["subject", "group", "unlisted", "input", "value", "trusted"]
    return pd.DataFrame(rows, columns=[*own, *columns])


def _probabilities(own: Mapping, present: set[str], size: int) -> list[dict]:
    """Of each cause that was searched: its probability, whether it is present, and how many causes
    are."""
    return [
        {"probability": cause["probability"], "present": cause["name"] in present, "size": size}
        for cause in own["causes"]
    ]


def reliabilities(probabilities: pd.DataFrame) -> pd.DataFrame:
    """How often causes of a probability were present, by `BINS`: `lower`, `upper`, `count`,
    `probability` (mean), `share` that was present and its 95 % interval, `low` and `high`.

    probabilities: `probability`, `present`, `size`. Hearts count so that every number of causes is
    as frequent as the others, as the prior of the sets has it.
    """
    frequency = probabilities["size"].map(probabilities["size"].value_counts())
    table = probabilities.assign(weight=1 / frequency)
    table["bin"] = np.digitize(table["probability"], BINS[1:-1])
    rows = []
    for number, inside in table.groupby("bin"):
        row = {"lower": BINS[number], "upper": BINS[number + 1], "count": len(inside)}
        row["probability"] = np.average(inside["probability"], weights=inside["weight"])
        rows.append(row | weighted_rate(inside["present"], inside["weight"]))
    columns = ["lower", "upper", "count", "probability", "share", "low", "high"]
    return pd.DataFrame(rows, columns=columns)


def summarise(cases: pd.DataFrame, stiffness: pd.DataFrame) -> dict:
    """Rates with exact 95 % intervals (Clopper and Pearson 1934), by group of hearts.

    `found`: of hearts all of whose effects are `FAR` or more standard errors large given the
    others, the share whose answer holds them all. `effects_found`: of all effects of that size.
    `wrong_named`: as of `cases_of`; of groups without listed causes, anything named. `coverage`: of
    the 95 % intervals of causes in the answer. `stiffness`: what the intervals of each of `MODELS`
    cover, and the median of the averaged ones' width over that of the true model. `true_model`:
    p-values of the misfit test (`p_values_of`).
    """
    hearts = cases.groupby("subject", sort=True).first()
    summary: dict[str, object] = {
        "hearts": len(hearts),
        "seconds": float(hearts["seconds"].median()),
        "simulation_seconds": float(hearts["simulation_seconds"].median()),
        "simulations": float(hearts["simulations"].median()),
        "confirmed": rate(hearts["confirmed"].astype(bool)),
    }
    for group, size in EFFECTS.items():
        own, inside = hearts[hearts["group"] == group], cases[cases["group"] == group]
        part = _group(own, stiffness[stiffness["group"] == group])
        if size:
            part |= _found(inside)
        summary[group] = part
    summary["unlisted_by_kind"] = {
        str(kind): _group(own, stiffness[stiffness["unlisted"] == kind])
        for kind, own in hearts[hearts["unlisted"] != ""].groupby("unlisted")
    }
    with_effects = hearts["group"].map(EFFECTS) > 0
    summary["absent_named"] = rate(hearts.loc[with_effects, "wrong_named"].astype(bool))
    summary["coverage"] = rate(cases["covered"].dropna().astype(bool))
    return summary


def _group(hearts: pd.DataFrame, stiffness: pd.DataFrame) -> dict:
    found = {
        "hearts": len(hearts),
        **{key: rate(hearts[key].astype(bool)) for key in ("detected", "wrong_named", "trusted")},
        "stiffness": {
            model: rate(stiffness[f"{model}_covers"].dropna().astype(bool)) for model in MODELS
        },
    }
    widths = [stiffness[f"{m}_high"] - stiffness[f"{m}_low"] for m in ("averaged", "true")]
    ratio = (widths[0] / widths[1]).median()
    return found | {"width_ratio": None if np.isnan(ratio) else float(ratio)}


def _found(cases: pd.DataFrame) -> dict:
    far = cases.groupby("subject").filter(lambda rows: bool((rows["expected_z"] >= FAR).all()))
    every = cases[cases["expected_z"] >= FAR]
    return {
        "found": rate(far.groupby("subject")["contains"].apply(lambda c: bool(c.all()))),
        "effects_found": rate(every["contains"].astype(bool)),
    }
