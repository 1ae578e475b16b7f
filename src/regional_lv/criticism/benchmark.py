"""Hidden effects: many hearts with injected effects, criticised blind, compared with the truth."""

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from regional_lv.channels import Channels
from regional_lv.criticism.designs import design_columns, read_simulated
from regional_lv.criticism.discretisation import load_emulator
from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.criticism.extension import read_extensions
from regional_lv.criticism.fit import fit
from regional_lv.criticism.injection import KINDS
from regional_lv.criticism.model import Layout, Model
from regional_lv.criticism.observations import Observations, observe
from regional_lv.criticism.rates import confusions, rate
from regional_lv.criticism.score import Projected
from regional_lv.criticism.study import Inputs, split
from regional_lv.criticism.verdict import Searched, Settings
from regional_lv.errors import InputError
from regional_lv.jobs import passes_on
from regional_lv.measured import synthetic_subject
from regional_lv.progress import Progress
from regional_lv.seeds import derive

FAR = 3.0
"""Standard errors, given the other effects, from which on an injected effect has to be found."""


class Batch:
    """One batch of a table of subjects, and what their criticism reads.

    Parameters
    ----------
    subjects, batch, batch_size: the table (Parquet), and which of its rows.
    emulator, extensions, settings, strain_exponent, noise_prior_scale, seed, discretisation: as of
        `study.read_critic`.
    """

    def __init__(
        self,
        subjects: str | Path,
        batch: str,
        batch_size: int,
        emulator: str | Path,
        extensions: Sequence[str | Path],
        settings: dict,
        strain_exponent: float,
        noise_prior_scale: float,
        seed: int,
        discretisation: str | Path | Sequence[str] = (),
    ):
        first = int(batch) * batch_size
        self._rows = pd.read_parquet(subjects).iloc[first : first + batch_size]
        self._emulator = load_emulator(emulator, discretisation)
        self._changing, self._noises = split(read_extensions(extensions))
        self._rest = Settings.from_config(settings), strain_exponent, noise_prior_scale
        self._seed = seed

    @property
    def parameters(self) -> Sequence[str]:
        return self._emulator.parameters.names

    def inputs(self) -> Iterator[Inputs]:
        """Of every subject, without the cause that is withheld from it."""
        progress = Progress("hidden effects", len(self._rows))
        for _, row in self._rows.iterrows():
            name = row["subject"]
            known = [e for e in self._changing if e.hypothesis.name != row["withheld"]]
            yield Inputs(
                *(name, {name: measured_of(row)}, self._emulator, known, self._noises),
                *(*self._rest, derive(self._seed, "criticism", name)),
            )
            progress.step()


@passes_on(Batch)
def search_batch(searches: str | Path, **batch) -> None:
    """What `study.search_causes` does, for the subjects of a batch (as of `Batch`); writes one JSON
    of all, with the seconds that each took."""
    found: dict[str, dict] = {}
    for inputs in Batch(**batch).inputs():
        started = time.monotonic()
        found[inputs.name] = {"search": inputs.critic().search().content()}
        found[inputs.name]["seconds"] = time.monotonic() - started
    Path(searches).write_text(json.dumps(found) + "\n")


@passes_on(Batch)
def plan_batch(
    searches: str | Path,
    turn: str,
    design: str | Path,
    simulations: Sequence[str | Path] = (),
    **batch,
) -> None:
    """What `study.plan_confirmation` does, for the subjects of a batch."""
    found, made = json.loads(Path(searches).read_text()), _by_subject(simulations)
    own = Batch(**batch)
    tables = [
        inputs.critic().plan(
            Searched.of(found[inputs.name]["search"]), made.get(inputs.name), int(turn)
        )
        for inputs in own.inputs()
    ]
    # A batch may be without a heart: those that cannot be inflated are no subjects.
    nothing = pd.DataFrame(columns=design_columns(own.parameters))
    filled = [table for table in tables if len(table)] or [nothing]
    pd.concat(filled, ignore_index=True).to_parquet(design, index=False)


@passes_on(Batch)
def conclude_batch(
    searches: str | Path, simulations: Sequence[str | Path], verdicts: str | Path, **batch
) -> None:
    """What `study.conclude_criticism` does, for the subjects of a batch; writes one row per subject
    and hypothesis (Parquet): subject, what was found, and the verdict on the hypothesis."""
    found, made, rows = json.loads(Path(searches).read_text()), _by_subject(simulations), []
    for inputs in Batch(**batch).inputs():
        started, own = time.monotonic(), found[inputs.name]
        criticism = inputs.critic().conclude(Searched.of(own["search"]), made.get(inputs.name))
        content = inputs.findings(criticism)
        rows += _rows(content, own["seconds"] + time.monotonic() - started)
    pd.DataFrame(rows).to_parquet(verdicts, index=False)


def _by_subject(simulations: Sequence[str | Path]) -> dict[str, pd.DataFrame]:
    tables = [table for path in simulations if len(table := read_simulated(path))]
    if not tables:
        return {}
    return dict(tuple(pd.concat(tables, ignore_index=True).groupby("subject")))


def measured_of(row: pd.Series) -> pd.DataFrame:
    """A measured table, as `read_measured` returns it, of one row of a batch of subjects."""
    channels = Channels.parse(name for name in row.index if f"sd_{name}" in row.index)
    noise = {channel.kind.noise: float(row[f"sd_{channel.name}"]) for channel in channels}
    values = row[list(channels.names)].to_numpy(float)
    return synthetic_subject(values, channels, noise, np.zeros(len(channels)))


def _rows(content: Mapping, seconds: float) -> list[dict]:
    common = {
        "subject": content["subject"],
        "named": json.dumps(content["named"]),
        "groups": json.dumps(content["groups"]),
        "acts_like": json.dumps(content["acts_like"]),
        "best": json.dumps(content["best"] or []),
        "explained": content["explained"],
        "detected": content["misfit"]["detected"],
        "misfit_p": content["misfit"]["p_value"],
        "remaining_p": content["remaining"]["p_value"] if content["remaining"] else None,
        "unlisted": content["unlisted_probability"],
        "gain": content["gain"]["elpd"],
        "gain_se": content["gain"]["elpd_se"],
        "simulations": content["confirmation"]["simulations"],
        "difference_sd": content["confirmation"]["largest_difference_sd"],
        "critical_z": content["critical_z"],
        "ess": content["ess"],
        "seconds": seconds,
    }
    keys = (
        *("name", "component", "z", "p_value", "p_value_single", "probability", "estimate"),
        *("identifiable", "sd", "at_bound", "fitted", "why"),
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
    cases: str | Path,
    confusion: str | Path,
    summary: str | Path,
    discretisation: str | Path | Sequence[str] = (),
) -> None:
    """Compare verdicts with the truth: a table with a row per effect, and one per subject without
    any, a table of confusions (CSV), and the rates that count with their intervals (JSON). The one
    reader of a truth."""
    every = pd.concat([pd.read_parquet(path) for path in verdicts], ignore_index=True)
    known = pd.read_parquet(truth)
    known = known[known["status"] == "converged"].set_index("subject")
    hearts = pd.read_parquet(subjects).set_index("subject", drop=False)
    trained = load_emulator(emulator, discretisation)
    rows = []
    for name, rows_of in every.groupby("subject", sort=True):
        true = known.loc[name]
        effects = {n: tuple(at) for n, at in json.loads(true["effects"]).items()}
        theta = torch.as_tensor(true[list(trained.parameters.names)].to_numpy(float))
        shifts = {n: at for n, at in json.loads(true["shifts"]).items() if at is not None}
        strength = {}
        if shifts:
            observed = observe({name: measured_of(hearts.loc[name])}, trained, 1.0)
            strength = expected_scores(observed, trained, shifts, theta)
        rows += _cases(name, rows_of, true["kind"], effects, strength)
    table = pd.DataFrame(rows)
    if table.empty:
        raise InputError(f"{truth}: no subject that was criticised; make the benchmark again")
    table.to_csv(cases, index=False)
    confusions(table).to_csv(confusion)
    Path(summary).write_text(json.dumps(summarise(table), indent=1) + "\n")


def expected_scores(
    observed: Observations, emulator, shifts: Mapping[str, Sequence[float]], theta: torch.Tensor
) -> dict[str, float]:
    """Score that each effect would have on average given the others, by name: the length of what it
    does to the outputs, in sds of the noise, after theta and the other effects took up what they
    can. One standard error of psi scores one.

    shifts: what each effect does to the outputs of `emulator` (D,), as of `injection.shifts`.
    """
    layout = Layout.inferred(observed.subjects, emulator.parameters)
    chosen = emulator.select(observed.outputs)
    model = Model(observed, ExtendedEmulator(chosen), layout)
    x = theta.log()[None]
    model.settle(x[0])
    at_truth = fit(model, model.mean(x), x, iterations=1)
    at = [emulator.outputs.index(name) for name in observed.outputs]
    together = torch.tensor(np.array([*shifts.values()]))[:, at].T
    projected = Projected.of(at_truth, model)
    gram = (together.mT @ (projected.precision @ together))[0]
    # An effect of nothing, and a share of two that do the same, score zero.
    gram = gram + 1e-9 * torch.diag(gram.diagonal().clamp(min=1e-12))
    found = torch.linalg.inv(gram).diagonal().clamp(min=1e-300).rsqrt()
    return dict(zip(shifts, found.tolist(), strict=True))


def _cases(
    name: str, verdicts: pd.DataFrame, kind: str, effects: dict, strength: dict
) -> list[dict]:
    first = verdicts.iloc[0]
    named, groups = json.loads(first["named"]), json.loads(first["groups"])
    answer = [*named, *(n for group in groups for n in group)]
    common = {
        "subject": name,
        "kind": kind,
        "effects": len(effects),
        "named": " ".join(named),
        "answer": " ".join(dict.fromkeys(answer)) or "none",
        "size": len(set(answer)),
        "wrong_named": bool(set(named) - set(effects))
        or any(not set(group) & set(effects) for group in groups),
        **{k: first[k] for k in ("acts_like", "best", "explained", "detected", "misfit_p")},
        **{k: first[k] for k in ("remaining_p", "unlisted", "gain", "gain_se", "simulations")},
        **{k: first[k] for k in ("difference_sd", "critical_z", "seconds")},
    }
    rows = []
    for effect, (value, component) in effects.items():
        row = {"effect": effect, "component": component, "value": value}
        row |= {"expected_z": strength.get(effect, np.nan), "contains": False}
        row |= {"identifiable": np.nan, "covered": np.nan, "right_place": np.nan}
        own = verdicts[verdicts["name"] == effect]
        if len(own):
            own = own.iloc[0]
            same = own["component"] == component
            row |= {key: own[key] for key in ("z", "p_value", "estimate", "low", "high", "why")}
            row |= {key: own[key] for key in ("probability", "at_bound")}
            row |= {"identifiable": bool(own["identifiable"]), "right_place": bool(same)}
            row["contains"] = effect in answer and bool(same)
            # The right cause in a wrong segment is a wrong answer.
            common["wrong_named"] |= effect in named and not same
            if effect in answer and own["fitted"] and same:
                row["covered"] = bool(own["low"] <= value <= own["high"])
        rows.append(row)
    return [common | row for row in rows] or [
        common | {"effect": "none", "contains": np.nan, "covered": np.nan}
    ]


def summarise(cases: pd.DataFrame) -> dict:
    """Rates with exact 95 % intervals (Clopper and Pearson 1934), by kind of subject.

    `found`: of subjects all of whose effects are `FAR` or more standard errors large given the
    others, the share whose answer holds them all. `effects_found`: of all effects of that size, the
    share that is in the answer. `wrong_named`: a cause named that is absent, or a
    group of which none is present. `coverage`: of the 95 % intervals of causes in the answer.
    """
    hearts = cases.groupby("subject", sort=True)
    summary: dict[str, object] = {"subjects": int(hearts.ngroups)}
    summary["seconds_median"] = float(cases["seconds"].median())
    for kind in KINDS:
        own = cases[cases["kind"] == kind].groupby("subject", sort=True)
        part = {
            "subjects": int(own.ngroups),
            "detected": rate(own["detected"].first().astype(bool)),
            "wrong_named": rate(own["wrong_named"].first().astype(bool)),
        }
        if kind in ("singles", "pairs", "triples"):
            far = own.filter(lambda rows: bool((rows["expected_z"] >= FAR).all()))
            groups = far.groupby("subject", sort=True)
            part["found"] = rate(groups["contains"].apply(lambda c: bool(c.astype(bool).all())))
            every = cases[(cases["kind"] == kind) & (cases["expected_z"] >= FAR)]
            part["effects_found"] = rate(every["contains"].astype(bool))
        summary[kind] = part
    present = cases[cases["kind"].isin(("singles", "pairs", "triples"))]
    wrong = present.groupby("subject", sort=True)["wrong_named"].first()
    summary["absent_named"] = rate(wrong.astype(bool))
    summary["coverage"] = rate(cases["covered"].dropna().astype(bool))
    hidden = cases[cases["effect"] == "end_diastolic_pressure"]
    summary["pressure_not_identifiable"] = rate(hidden["identifiable"] == False)  # noqa: E712
    return summary
