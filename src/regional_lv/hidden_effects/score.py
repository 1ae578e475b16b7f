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

from regional_lv.criticism import misfit
from regional_lv.criticism.misfit import LinearModel
from regional_lv.criticism.study import Critic, Settings
from regional_lv.emulators.joint_gp import JointGP
from regional_lv.errors import InputError
from regional_lv.hidden_effects.blind import measured_of
from regional_lv.hidden_effects.groups import EFFECTS, FAR, LISTED, MODELS
from regional_lv.hidden_effects.rates import confusions, rate, weighted_rate
from regional_lv.inference import importance
from regional_lv.inference.averaging import LEVELS, RESAMPLED
from regional_lv.inference.drawing import ITERATIONS, LEAST_GAIN, sample
from regional_lv.inference.evidence import WEAK, Fits, fit
from regional_lv.inference.potential import Potential
from regional_lv.seeds import derive

DRAWS = 1000
"""Of a round of sampling of a true model."""

LEVEL = 0.05
"""At which p-values of true models count as rejections."""

BINS = (0.0, 0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 1.0)
"""Ends of the bins of probabilities in the table of reliability."""

OF_TRUE_MODEL = [
    "subject",
    "input",
    "role",
    "cause",
    "place",
    "value",
    "expected_z",
    "low",
    "high",
    "p_value",
]
"""Columns of the table of true models."""

OF_EFFECT = [
    *("place", "value", "expected_z", "contains", "covered"),
    *("probability", "estimate", "identifiable", "at_bound"),
    *("low", "high", "true_low", "true_high"),
]
"""Columns of the table of cases that only hearts with an effect have."""

OF_RELIABILITY = ["lower", "upper", "count", "probability", "share", "low", "high"]
"""Columns of the table of reliability."""


# --------------------------------------------------------------------------------- true models


def sample_true_models(
    subjects: str | Path,
    truth: str | Path,
    emulator_file: str | Path,
    physics: Mapping,
    settings: Mapping,
    seed: int,
    models: str | Path,
) -> None:
    """What the true model of each heart of a batch says, in which exactly the suspected inputs are
    free that are not at their nominal values; write it (Parquet).

    One row per effect and inferred input: `subject`, `input`, `role` (`effect` or `inferred`),
    `cause` and `place`, the true `value`, `expected_z` (effects: `expected_scores`), ends of the
    95 % interval (`low`, `high`), and the p-value of the model's misfit test (`p_value`). Unlisted
    hearts have no true model: of them the values alone, and of their inferred inputs only if
    `has_stiffness`. Other arguments as for `blind.criticise_batch`.
    """
    emulator, given = JointGP.load(emulator_file), Settings.from_config(settings)
    known = pd.read_parquet(truth).set_index("subject")
    rows: list[dict] = []
    for _, row in pd.read_parquet(subjects).iterrows():
        name = row["subject"]
        heart = known.loc[name]
        if heart["has_stiffness"]:
            critic = Critic(name, {name: measured_of(row)}, emulator, physics, given, seed)
            own = derive(seed, "true model", name)
            values, listed = json.loads(heart["values"]), heart["group"] != "unlisted"
            found = true_model(critic.potential(emulator), values, listed, given.bootstrap, own)
            rows += [{"subject": name} | each for each in found]
    pd.DataFrame(rows, columns=OF_TRUE_MODEL).to_parquet(models, index=False)


def true_model(
    potential: Potential, values: Mapping[str, float], listed: bool, replicates: int, seed: int
) -> list[dict]:
    """Rows of `sample_true_models` of one heart.

    values: by input, among others. listed: whether it has a true model. replicates: of the misfit
    test's bootstrap.
    """
    inputs = potential.inputs
    natural, x, on = truth_of(potential, values)
    on = on if listed else []
    roles = dict.fromkeys(on, "effect")
    roles |= dict.fromkeys(np.flatnonzero(inputs.of_role("inferred")).tolist(), "inferred")
    rows = {
        k: {"input": inputs[k].name, "role": role, "value": natural[k]}
        | {"cause": inputs[k].cause, "place": inputs[k].place}
        for k, role in roles.items()
    }
    if listed:
        free, zero = potential.free(on)[None], x.new_zeros(1)
        for k, score in expected_scores(potential, x, free, on).items():
            rows[k]["expected_z"] = score
        fitted = fit(potential, free, zero, x, potential.settle(x, zero), ITERATIONS, LEAST_GAIN)
        linear = LinearModel.of(potential, fitted)
        p_value = misfit.test(linear, (), replicates, seed).p_value
        for k, (low, high) in _intervals(potential, fitted, list(rows), seed).items():
            rows[k] |= {"low": low, "high": high, "p_value": p_value}
    return list(rows.values())


def truth_of(
    potential: Potential, values: Mapping[str, float]
) -> tuple[np.ndarray, torch.Tensor, list[int]]:
    """True values (K,) of all inputs, their coordinates (1, P), and places of the suspected inputs
    that are not nominal; values: by input, nominal where there is none."""
    inputs, x = potential.inputs, potential.nominal[None].clone()
    natural = np.array([values.get(e.name, v) for e, v in zip(inputs, inputs.nominal, strict=True)])
    x[0, : len(inputs)] = torch.as_tensor(inputs.coordinates.scaled(natural))
    return natural, x, [k for k in potential.suspected if x[0, k] != potential.nominal[k]]


def expected_scores(
    potential: Potential, x: torch.Tensor, free: torch.Tensor, on: Sequence[int]
) -> dict[int, float]:
    """By place, the distance of each effect `on` from its nominal value in standard errors, as the
    linear model about the truth has them, with everything else that is `free` estimated too.

    x (1, P): the truth. free (1, P): of the true model.
    """
    error = potential.settle(x, x.new_zeros(1))
    mean, slopes = potential.linearise(x)
    found = potential.quadratic(mean, slopes, x, error)
    precision = found.curvature[0] + torch.diag(WEAK / potential.width.square())
    which = torch.nonzero(free[0])[:, 0]
    covariance = torch.linalg.inv(precision[which][:, which])
    sd = dict(zip(which.tolist(), covariance.diagonal().sqrt().tolist(), strict=True))
    return {k: float((x[0, k] - potential.nominal[k]).abs()) / sd[k] for k in on}


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

    findings, truth, models: batches of `blind.criticise_batch`, `injection.inject_batch` and
    `sample_true_models`.
    """
    found: dict[str, dict] = {}
    for path in findings:
        found |= json.loads(Path(path).read_text())
    if not found:
        raise InputError(
            "criticism.benchmark.hearts: no heart was criticised; ask for some, and see in the "
            "truth whether those that were drawn could be inflated"
        )
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
    p_values = inferred.assign(group=inferred["subject"].map(known["group"]))
    p_values = p_values[p_values["group"].isin(LISTED)].groupby("subject")["p_value"].first()
    tables = {
        cases: pd.DataFrame(rows),
        stiffness: stiffness_of(found, known, inferred),
        reliability: reliabilities(pd.DataFrame(probabilities)),
    }
    for path, table in tables.items():
        table.to_csv(path, index=False)
    confusions(tables[cases]).to_csv(confusion)
    content = summarise(tables[cases], tables[stiffness], p_values)
    Path(summary).write_text(json.dumps(content, indent=1) + "\n")


def cases_of(name: str, heart: pd.Series, own: Mapping, effects: pd.DataFrame) -> list[dict]:
    """Rows of the table of cases of one heart.

    heart: its row of the truth; own: its findings (`blind.reduced`); effects: its rows of the
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
        return [common | {"effect": none} | dict.fromkeys(OF_EFFECT, np.nan)]
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
    if probabilities.empty:
        return pd.DataFrame(columns=OF_RELIABILITY)
    frequency = probabilities["size"].map(probabilities["size"].value_counts())
    table = probabilities.assign(weight=1 / frequency)
    table["bin"] = np.digitize(table["probability"], BINS[1:-1])
    rows = []
    for number, inside in table.groupby("bin"):
        row = {"lower": BINS[number], "upper": BINS[number + 1], "count": len(inside)}
        row["probability"] = np.average(inside["probability"], weights=inside["weight"])
        rows.append(row | weighted_rate(inside["present"], inside["weight"]))
    return pd.DataFrame(rows, columns=OF_RELIABILITY)


def summarise(cases: pd.DataFrame, stiffness: pd.DataFrame, p_values: pd.Series) -> dict:
    """Rates with exact 95 % intervals (Clopper and Pearson 1934), by group of hearts.

    `found`: of hearts all of whose effects are `FAR` or more standard errors large given the
    others, the share whose answer holds them all. `effects_found`: of all effects of that size.
    `wrong_named`: as of `cases_of`; of groups without listed causes, anything named. `coverage`: of
    the 95 % intervals of causes in the answer. `stiffness`: what the intervals of each of `MODELS`
    cover; `width_ratio`: the median of the averaged ones' width over that of the true model.
    `true_model`: how many of the p-values (hearts,) of the misfit test of true models are below
    5 %, and the p-value of Kolmogorov's test that they are uniform.
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
    p_values = p_values.dropna()
    uniform = float(stats.kstest(p_values, "uniform").pvalue) if len(p_values) else None
    summary["true_model"] = {"rejected": rate(p_values < LEVEL), "uniform_p_value": uniform}
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
    ratios = (widths[0] / widths[1]).dropna()
    return found | {"width_ratio": None if ratios.empty else float(ratios.median())}


def _found(cases: pd.DataFrame) -> dict:
    far = cases.groupby("subject").filter(lambda rows: bool((rows["expected_z"] >= FAR).all()))
    every = cases[cases["expected_z"] >= FAR]
    return {
        "found": rate(far.groupby("subject")["contains"].apply(lambda c: bool(c.all()))),
        "effects_found": rate(every["contains"].astype(bool)),
    }
