"""What a criticism found, as one object that everything else reads (`findings.json`)."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import pandas as pd

from regional_lv.channels import Channels
from regional_lv.criticism import contract, words
from regional_lv.criticism.confirmation import Round
from regional_lv.criticism.contract import Findings
from regional_lv.criticism.left_out import gain, gains
from regional_lv.criticism.separate import separating_measurement
from regional_lv.criticism.verdict import PROBABILITY, Examined, Verdict
from regional_lv.emulators.base import Emulator
from regional_lv.emulators.gaussian import Z95
from regional_lv.inference.averaging import Averaged
from regional_lv.inference.emulated import EmulatedInputs, InputEmulator
from regional_lv.inference.hearts import own_name
from regional_lv.inference.sources import sources_of_variance
from regional_lv.inputs.catalogue import INPUTS
from regional_lv.measured import data_checks, shortcomings
from regional_lv.quantities.seth_hill import Measure

LISTED = 20
"""Sets that the findings list, the most probable first, and the best one in any case."""

BINS = 40
"""Of a histogram."""

TOLERATED = 0.01
"""Share of the posterior where no simulation is near, from which on it is said."""


@dataclass(frozen=True)
class Context:
    """What findings tell beside the verdict.

    subject: its name. tables: measured, by heart. emulated: of what the verdict is about. observed:
    channels of the study. rounds: of the confirmation. outputs, noise_sd (U,): what was measured in
    any heart. bootstrap: replicates of the tests. load_fractions: at which the heart could be
    imaged. measure: of the study's strains.
    """

    subject: str
    tables: Mapping[str, pd.DataFrame]
    emulated: EmulatedInputs
    observed: Channels
    rounds: Sequence[Round]
    outputs: Sequence[str]
    noise_sd: np.ndarray
    bootstrap: int
    load_fractions: Sequence[float]
    measure: Measure


def findings_of(verdict: Verdict, context: Context) -> Findings:
    """The findings, ready for JSON."""
    averaged = verdict.averaged
    table = averaged.table()
    content: Findings = {
        "subject": context.subject,
        "subjects": list(context.tables),
        "misfit": _misfit(verdict.base, verdict.detected, context),
        "data_checks": [
            {"subject": name} | check
            for name, measured in context.tables.items()
            for check in data_checks.check(measured, context.measure)
        ],
        "hypotheses": _causes(verdict),
        "sets": _sets(verdict, context),
        "base_probability": float(averaged.probability[averaged.base]),
        "unlisted_probability": averaged.departure_probability,
        "named": verdict.named,
        "groups": verdict.groups,
        "acts_like": verdict.proxies,
        "explained": verdict.explained,
        "trusted": verdict.trusted,
        "outliers": verdict.final.no_outliers,
        "confirmation": _confirmation(verdict, context),
        "separating": _separating(verdict, context),
        "best": None if verdict.best is None else list(verdict.causes_of(verdict.best)),
        "gain": gains(
            verdict.base.left_out, verdict.final.left_out if verdict.best is not None else None
        ),
        "stiffness": _stiffness(table, sources_of_variance(averaged)),
        "measured_inputs": _measured_inputs(verdict, table),
        "noise": _noise(verdict),
        "remaining": None,
        "level": verdict.level,
        "least_probability": PROBABILITY,
        "critical_z": verdict.base.tested.critical_z(verdict.level),
        "least_p_value": 1 / (1 + context.bootstrap),
        "ess": averaged.ess,
        "limits": _limits(verdict, context),
        "words": [],
    }
    if verdict.best is not None:
        final: Examined = verdict.final
        content["remaining"] = _misfit(final, not verdict.adequate, context)
    content = cast(Findings, _plain(content))
    content["words"] = words.verdict(content)
    return content


def write_findings(content: Findings, path: str | Path) -> None:
    """As JSON; what is no number becomes null."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(json.dumps(content, indent=1, allow_nan=False) + "\n")


def _plain(value):
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


# ------------------------------------------------------------------------------------ parts


def _misfit(examined: Examined, detected: bool, context: Context) -> contract.Misfit:
    return {
        "detected": detected,
        "p_value": examined.tested.p_value,
        "families": examined.tested.families,
        "largest": examined.tested.largest,
        "channels": examined.left_out.channels([*context.tables]),
    }


def _causes(verdict: Verdict) -> list[contract.Cause]:
    """Of every suspected cause, the most conspicuous first."""
    averaged, inputs = verdict.averaged, verdict.potential.inputs
    best = {} if verdict.best is None else verdict.causes_of(verdict.best)
    rows: list[contract.Cause] = []
    for test in verdict.base.tested.causes:
        probability, known = averaged.probability_of_cause(test.name), test.identified
        k = best.get(test.name, averaged.most_probable_of(test.name))
        drawn = averaged.values_where_free(k)
        if drawn is None:  # nothing but the tests speak of it, in their own place
            k = test.at
        each, share = inputs[k], averaged.probability_of(k) / probability if probability else 1.0
        base = float(inputs.nominal[k])
        estimate, low, high, posterior = None, each.low, each.high, None
        if drawn is not None:
            low, estimate, high = np.quantile(drawn, [0.025, 0.5, 0.975]).tolist()
            posterior = _density(drawn, each.low, each.high)
        elif known.identifiable and math.isfinite(known.sd):
            # From the score alone, as far as the range goes.
            middle = base + test.z * known.sd
            spread = Z95 * known.sd
            low, estimate, high = np.clip(
                [middle - spread, middle, middle + spread], each.low, each.high
            ).tolist()
        holding = [n for n in averaged.drawn if k in averaged.models[n].members]
        rows.append(
            {
                "name": test.name,
                "component": each.place,
                "parameter": each.parameter,
                "description": each.description,
                "source": each.source,
                "base": base,
                "range": [each.low, each.high],
                "z": test.z,
                "p_value": test.p_value,
                "p_value_single": test.p_single,
                "probability": probability,
                "component_probability": share,
                "estimate": estimate,
                "interval95": [low, high],
                "at_bound": bool(holding) and verdict.at_bound(holding[0], k),
                "unit": each.unit,
                "identifiable": known.identifiable,
                "why": known.why,
                "absorbed": known.absorbed,
                "sd": known.sd,
                "posterior": posterior,
            }
        )
    return rows


def _density(values: np.ndarray, low: float, high: float) -> contract.Histogram:
    """Histogram of `values` (N,), over the part of the range that holds nearly all of the mass."""
    first, last = np.quantile(values, [0.0005, 0.9995])
    pad = 0.1 * (last - first) + 1e-9
    density, edges = np.histogram(
        values, bins=BINS, range=(max(low, first - pad), min(high, last + pad)), density=True
    )
    return {"edges": edges.tolist(), "density": density.tolist()}


def _sets(verdict: Verdict, context: Context) -> list[contract.Set]:
    averaged, inputs = verdict.averaged, verdict.potential.inputs
    rows: list[contract.Set] = []
    for n, model in enumerate(averaged.models):
        if not model.members or (len(rows) >= LISTED and n != verdict.best):
            continue
        fit: list[float] = []
        if model.fit is not None:
            x = inputs.coordinates.natural(model.fit.x[:, : len(inputs)])[0]
            fit = [float(x[k]) for k in model.members]
        seen = verdict.examined.get(n)
        gained = gain(verdict.base.left_out, seen.left_out) if seen else (None, None)
        rows.append(
            {
                "causes": [inputs[k].cause for k in model.members],
                "components": [inputs[k].place for k in model.members],
                "best": n == verdict.best,
                "fit": fit,
                "probability": float(averaged.probability[n]),
                "log_evidence": model.log_evidence - averaged.models[averaged.base].log_evidence,
                "log_prior": model.log_prior,
                "elpd_gain": gained[0],
                "elpd_gain_se": gained[1],
                "misfit_p_value": seen.tested.p_value if seen else None,
                "confirmed": verdict.confirmed is not None and n in verdict.confirmed,
                "simulations": _simulations(context.rounds, averaged.names[n]),
                "emulator_error_sd": _error_of(context.rounds, averaged.names[n]),
            }
        )
    return rows


def _simulations(rounds: Sequence[Round], name: str) -> int:
    """How many of a set are known."""
    return sum(int((r.simulations["set"] == name).sum()) for r in rounds if len(r.simulations))


def _error_of(rounds: Sequence[Round], name: str) -> float | None:
    """Root mean square of simulated minus emulated of a set in the last round that has it."""
    for one in reversed(rounds):
        if len(one.simulations):
            own = one.in_sds[(one.simulations["set"] == name).to_numpy()]
            if own.size:
                return float(np.sqrt(np.square(own).mean()))
    return None


def _confirmation(verdict: Verdict, context: Context) -> contract.Confirmation:
    averaged, rounds = verdict.averaged, context.rounds
    channels: list[contract.EmulatorError] = []
    last = next((r for r in reversed(rounds) if r.in_sds.size), None)
    if last is not None:
        error, in_sds = (np.sqrt(np.square(v).mean(0)) for v in (last.errors, last.in_sds))
        channels = [
            {"output": name, "error": float(e), "error_sd": float(s)}
            for name, e, s in zip(context.outputs, error, in_sds, strict=True)
        ]
    known = {n for n, name in enumerate(averaged.names) if _simulations(rounds, name)}
    sets = [n for n, model in enumerate(averaged.models) if model.members]
    best = None if verdict.best is None else averaged.names[verdict.best]
    return {
        "simulations": sum(len(r.simulations) for r in rounds),
        "simulations_of_best": _simulations(rounds, best) if best else 0,
        "failed": sum(r.failed for r in rounds),
        "emulator_error_sd": [r.size for r in rounds],
        "largest_error_sd": max((c["error_sd"] for c in channels), default=math.nan),
        "agrees": last is not None and last.agrees(context.noise_sd),
        "probability_not_simulated": float(
            sum(averaged.probability[n] for n in sets if n not in known)
        ),
        "channels": channels,
    }


def _separating(verdict: Verdict, context: Context) -> list[dict]:
    """Where causes can stand for one another."""
    if not verdict.groups:
        return []
    averaged = verdict.averaged
    leading = [n for n in averaged.leading if n in verdict.examined]
    probable = [n for n in leading if averaged.models[n].members]
    hearts = [*context.tables]
    return separating_measurement(
        averaged, probable, context.emulated, hearts, context.load_fractions
    )


def _summary(row: pd.Series, prefix: str = "") -> contract.Summary:
    mean, sd, low, high = (float(row[f"{prefix}{k}"]) for k in ("mean", "sd", "lower95", "upper95"))
    return {"mean": mean, "sd": sd, "interval95": [low, high]}


def _stiffness(table: pd.DataFrame, sources: pd.DataFrame) -> list[contract.Stiffness]:
    rows: list[contract.Stiffness] = []
    for name, row in table[table["role"] == "inferred"].iterrows():
        averaged, as_it_is = _summary(row), _summary(row, "as_is_")
        rows.append(
            {
                "name": str(name),
                "unit": row["unit"],
                "averaged": averaged,
                "as_it_is": as_it_is,
                "sources": {k: float(v) for k, v in sources.loc[name].items() if v > 0},
                "shift_sd": (averaged["mean"] - as_it_is["mean"]) / as_it_is["sd"],
            }
        )
    return rows


def _measured_inputs(verdict: Verdict, table: pd.DataFrame) -> list[contract.MeasuredInput]:
    inputs = verdict.potential.inputs
    return [
        {
            "name": inputs.names[k],
            "unit": inputs[k].unit,
            "prior_mean": float(inputs.nominal[k]),
            "prior_sd": inputs.roles[k].sd,
            "averaged": _summary(table.loc[inputs.names[k]]),
        }
        for k in verdict.potential.measured.at
    ]


def _noise(verdict: Verdict) -> list[contract.Noise]:
    averaged = verdict.averaged
    before, after = averaged.noise_medians([averaged.base]), averaged.noise_medians()
    return [
        {"quantity": quantity, "before": before[quantity], "after": after[quantity]}
        for quantity in verdict.potential.noise.groups
    ]


def _inferred_of(name: str, verdict: Verdict, context: Context) -> int:
    """How many inputs are inferred from what was measured in one heart."""
    inputs = verdict.potential.inputs
    others = tuple(own_name(heart, "") for heart in context.tables if heart != name)
    inferred = inputs.subset(inputs.of_role("inferred")).names
    return sum(not each.startswith(others) for each in inferred)


def _limits(verdict: Verdict, context: Context) -> list[str]:
    """What the data do not support, in sentences."""
    potential, families = verdict.potential, verdict.base.tested.families
    measured = potential.observed.channels
    limits = [
        f"{name}: {text}"
        for name, table in context.tables.items()
        for text in shortcomings(table, _inferred_of(name, verdict, context))
    ]
    if not families:
        limits.append("no more channels than parameters: they can be fitted whatever is wrong")
    quantities = {c.quantity for c in measured}
    for channel in {c.quantity: c for c in context.observed if c.quantity != "volume"}.values():
        if channel.quantity not in quantities:
            what = f"{channel.quantity} strain" if channel.kind.is_strain else channel.quantity
            limits.append(f"no {what} was measured: nothing is concluded about it")
    for family in ("direction", "level", "wall"):
        if families and family not in families:
            limits.append(f"too few channels for the tests by {family}")
    if potential.noise.groups:
        limits.append(
            "the noise is inferred: a misfit spread evenly over a direction counts as noise, and "
            "the overall test of the size of residuals does not apply"
        )
    if verdict.averaged.poor:
        limits.append(
            "the draws of the most probable model are not reliable (too few count, or a few carry "
            "most of the weight): estimates and intervals are rough"
        )
    one = context.emulated.inputs
    possible = {k.name for k in INPUTS.values() if k.is_cause and not k.why_not(one.base)}
    if others := sorted(possible - {each.cause for each in one}):
        limits.append(
            f"{len(others)} causes of the catalogue were not searched, because `inputs` does not "
            f"make them suspected, or the emulator does not know them: {', '.join(others)}"
        )
    if verdict.confirmed is None:
        share = _extrapolated(verdict.averaged, context.emulated.emulator)
        if share >= TOLERATED:
            limits.append(
                f"{100 * share:.0f} % of the posterior lies where no simulation is near: the "
                "emulator extrapolates there, and its errors may be larger than it states"
            )
    return limits


def _extrapolated(averaged: Averaged, emulator: InputEmulator) -> float:
    """Share of the posterior where no simulation is near, of any of the hearts, for an emulator of
    the study's own."""
    if not isinstance(emulator, Emulator):
        return 0.0
    potential, total, far = averaged.potential, 0.0, 0.0
    for n, part in averaged.drawn.items():
        at = potential.emulated.simulated_at(part.x[:, : len(potential.inputs)])
        outside = emulator.outside(at).unflatten(0, (len(part.x), -1)).any(1)
        total += averaged.probability[n]
        far += averaged.probability[n] * float(part.weight[outside].sum())
    return far / total
