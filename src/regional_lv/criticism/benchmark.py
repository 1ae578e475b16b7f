"""Hidden effects: many hearts with injected effects, criticised blind, compared with the truth."""

import json
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from regional_lv import emulators
from regional_lv.channels import Channels
from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.criticism.extension import read_extensions
from regional_lv.criticism.fit import fit
from regional_lv.criticism.model import Layout, Model
from regional_lv.criticism.observations import Observations, observe
from regional_lv.criticism.rates import rate
from regional_lv.criticism.score import Projected
from regional_lv.criticism.study import criticise_tables, split
from regional_lv.criticism.verdict import Settings
from regional_lv.errors import InputError
from regional_lv.measured import synthetic_subject
from regional_lv.progress import Progress
from regional_lv.seeds import derive

FAR = 3.0
"""Detection limits from which on an injected effect has to be found."""

NOTHING = ""


def criticise_benchmark(
    subjects: str | Path,
    batch: str,
    batch_size: int,
    emulator: str | Path,
    extensions: Sequence[str | Path],
    settings: dict,
    noise_prior_scale: float,
    seed: int,
    verdicts: str | Path,
) -> None:
    """Criticise one batch of a table of subjects; write one row per subject and hypothesis
    (Parquet): subject, what was found, and what was said of the hypothesis."""
    first = int(batch) * batch_size
    table = pd.read_parquet(subjects).iloc[first : first + batch_size]
    trained = emulators.load(emulator)
    changing, noises = split(read_extensions(extensions))
    chosen = Settings.from_config(settings)
    progress, rows = Progress("hidden effects", len(table)), []
    for _, subject in table.iterrows():
        name, started = subject["subject"], time.monotonic()
        content, _ = criticise_tables(
            *(name, {name: measured_of(subject)}, trained, changing, noises, chosen),
            *(noise_prior_scale, derive(seed, "criticism", name)),
        )
        rows += _rows(content, time.monotonic() - started)
        progress.step()
    pd.DataFrame(rows).to_parquet(verdicts, index=False)


def measured_of(row: pd.Series) -> pd.DataFrame:
    """A measured table, as `read_measured` returns it, of one row of a batch of subjects."""
    channels = Channels.parse(name for name in row.index if f"sd_{name}" in row.index)
    noise = {channel.kind.noise: float(row[f"sd_{channel.name}"]) for channel in channels}
    values = row[list(channels.names)].to_numpy(float)
    return synthetic_subject(values, channels, noise, np.zeros(len(channels)))


def _rows(content: dict, seconds: float) -> list[dict]:
    common = {
        "subject": content["subject"],
        "named": content["named_cause"] or NOTHING,
        "named_component": content["named_component"] or "",
        "set": json.dumps(content["indistinguishable"]),
        "explained": content["explained"],
        "misfit_p": content["misfit"]["p_value"],
        "remaining_p": content["remaining"]["p_value"],
        "critical_z": content["rounds"][0]["critical_z"],
        "rounds": len(content["rounds"]),
        "ess": content["rounds"][0]["ess"],
        "seconds": seconds,
    }
    keys = (
        *("name", "component", "z", "p_value", "p_value_single", "estimate", "identifiable", "sd"),
        *("why", "elpd_gain", "elpd_gain_se", "probability", "weight", "fitted"),
    )
    return [
        common
        | {key: hypothesis[key] for key in keys}
        | {"low": hypothesis["interval95"][0], "high": hypothesis["interval95"][1]}
        for hypothesis in content["hypotheses"]
    ]


# ------------------------------------------------------------------------------------- score


def score_benchmark(
    verdicts: Sequence[str | Path],
    truth: str | Path,
    subjects: str | Path,
    emulator: str | Path,
    extensions: Sequence[str | Path],
    cases: str | Path,
    confusion: str | Path,
    summary: str | Path,
) -> None:
    """Compare verdicts with the truth: a table of all subjects and one of confusions (CSV), and
    the rates that count with their intervals (JSON). The one reader of a truth."""
    every = pd.concat([pd.read_parquet(path) for path in verdicts], ignore_index=True)
    known = pd.read_parquet(truth)
    known = known[known["status"] == "converged"].set_index("subject")
    hearts = pd.read_parquet(subjects).set_index("subject", drop=False)
    trained = emulators.load(emulator)
    changing, _ = split(read_extensions(extensions))
    by_place = {(e.hypothesis.name, e.component): e for e in changing}
    rows = []
    for name, said in every.groupby("subject", sort=True):
        true = known.loc[name]
        theta = torch.as_tensor(true[list(trained.parameters.names)].to_numpy(float))
        extension = by_place.get((true["effect"], true["component"]))
        strength = np.nan
        if extension is not None:
            observed = observe({name: measured_of(hearts.loc[name])}, trained, 1.0)
            strength = expected_score(observed, trained, extension, theta, float(true["value"]))
        rows.append(_case(name, said, true, strength))
    table = pd.DataFrame(rows)
    if table.empty:
        raise InputError(f"{truth}: no subject that was criticised; make the benchmark again")
    table.to_csv(cases, index=False)
    pd.crosstab(table["effect"], table["answer"]).to_csv(confusion)
    Path(summary).write_text(json.dumps(summarise(table), indent=1) + "\n")


def expected_score(
    observed: Observations, emulator, extension, theta: torch.Tensor, value: float
) -> float:
    """Score that the effect would have on average: the length of what it does to the outputs, in
    sds of the noise, after theta took up what it can. One standard error of psi scores one."""
    layout = Layout.inferred(observed.subjects, emulator.parameters)
    chosen = emulator.select(observed.outputs)
    model = Model(observed, ExtendedEmulator(chosen), layout)
    x = theta.log()[None]
    model.settle(x[0])
    at_truth = fit(model, model.mean(x), x, iterations=1)
    psi = torch.tensor([value], dtype=torch.float64)
    change = extension.select(observed.outputs).mean(chosen, theta[None], psi)
    return float(Projected.of(at_truth, model).information(change[..., None]).sqrt())


def _case(name: str, said: pd.DataFrame, true: pd.Series, strength: float) -> dict:
    first = said.iloc[0]
    members = [first["named"]] if first["named"] else json.loads(first["set"])
    effect = true["effect"]
    own = said[said["name"] == effect]
    row = {
        "subject": name,
        "effect": effect or "none",
        "component": true["component"],
        "value": true["value"],
        "expected_z": strength,
        "limits": strength / first["critical_z"],
        "answer": first["named"] or ("several" if members else "none"),
        "members": " ".join(members),
        "size": len(members),
        "contains": effect in members if effect else np.nan,
        "right_place": np.nan,
        "misfit_p": first["misfit_p"],
        "explained": first["explained"],
        "critical_z": first["critical_z"],
        "seconds": first["seconds"],
        "identifiable": np.nan,
        "covered": np.nan,
    }
    if len(own):
        own = own.iloc[0]
        same = own["component"] == true["component"]
        row |= {key: own[key] for key in ("z", "p_value", "estimate", "low", "high", "why")}
        row["identifiable"] = bool(own["identifiable"])
        row["right_place"] = bool(same)
        if own["fitted"] and same:
            row["covered"] = bool(own["low"] <= true["value"] <= own["high"])
    return row


def summarise(cases: pd.DataFrame) -> dict:
    """Rates with exact 95 % intervals (Clopper and Pearson 1934): of false positives among subjects
    without an effect; of effects found among those far beyond their detection limit, by two
    definitions of it; of intervals that cover; and how many members the sets have."""
    null = cases[cases["effect"] == "none"]
    injected = cases[cases["effect"] != "none"]
    visible = injected[injected["identifiable"] == True]  # noqa: E712 - a column of objects
    far = {
        "limit_one_se": visible[visible["expected_z"] >= FAR],
        "limit_of_the_test": visible[visible["limits"] >= FAR],
    }
    found = {
        "null_subjects": len(null),
        "injected_subjects": len(injected),
        "false_positives": rate(null["size"] > 0),
        "misfit_false_alarms": rate(null["misfit_p"] <= 0.05),
        "interval_coverage": rate(visible["covered"].dropna().astype(bool)),
        "seconds_median": float(cases["seconds"].median()),
    }
    for definition, group in far.items():
        hit = group[group["contains"].astype(bool)]
        found[definition] = {
            "contains_injected": rate(group["contains"].astype(bool)),
            "named_alone": rate(group["answer"] == group["effect"]),
            "mean_members": float(hit["size"].mean()) if len(hit) else None,
            "coverage": rate(group["covered"].dropna().astype(bool)),
        }
    hidden = injected[injected["effect"] == "end_diastolic_pressure"]
    found["pressure_not_identifiable"] = rate(hidden["identifiable"] == False)  # noqa: E712
    return found
