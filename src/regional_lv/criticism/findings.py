"""What a criticism found, as plain numbers and sentences: the contract with everything after it."""

import json
import math
from pathlib import Path

import torch
from scipy import stats

from regional_lv.channels import Channels
from regional_lv.criticism import words
from regional_lv.criticism.posterior import Posterior, gain_of
from regional_lv.criticism.separate import separating_measurement
from regional_lv.criticism.verdict import Cause, Criticism, Round, Sampled
from regional_lv.emulators.base import Emulator
from regional_lv.measured import shortcomings

Z95 = float(stats.norm.ppf(0.975))
BINS = 40
"""Of the posterior of psi."""


def findings_of(subject: str, criticism: Criticism, emulator: Emulator, extensions, tables) -> dict:
    """The findings of one subject (or several together, called `subject`), ready for JSON.

    emulator, extensions: for all outputs, to find what measurement would tell causes apart.
    tables: the measured tables, by subject.
    """
    first, last = criticism.rounds[0], criticism.rounds[-1]
    final, level = _final(criticism), criticism.settings.level
    named, rivals = criticism.named, criticism.indistinguishable
    content = {
        "subject": subject,
        "subjects": list(criticism.observations.subjects),
        "misfit": _misfit(first, level),
        "hypotheses": [_hypothesis(cause) for cause in first.causes],
        "named_cause": named.name if named else None,
        "named_component": named.component if named else None,
        "indistinguishable": [cause.name for cause in rivals],
        "separating": separating_measurement(
            rivals, emulator, extensions, criticism.settings.load_fractions
        ),
        "explained": criticism.explained,
        "partly": [cause.name for cause in criticism.found] if not criticism.explained else [],
        "gain": _gain(first.base, final),
        "theta": _theta(first.base, final),
        "noise": _noise(first.base, final),
        "remaining": _misfit(last, level),
        "rounds": [_round(step, level) for step in criticism.rounds],
        "limits": [
            f"{name}: {text}"
            for name, table in tables.items()
            for text in shortcomings(table, len(emulator.parameters))
        ]
        + _limits(first, emulator.channels),
    }
    content["words"] = words.verdict(content)
    return _plain(content)


def write_findings(content: dict, path: str | Path) -> None:
    """As JSON; what is no number becomes null."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(json.dumps(content, indent=1, allow_nan=False) + "\n")


def _final(criticism: Criticism) -> Sampled:
    found = criticism.found
    return found[-1].sampled if found else criticism.rounds[0].base


def _plain(value):
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


# ------------------------------------------------------------------------------------ parts


def _misfit(step: Round, level: float) -> dict:
    o, left_out = step.base.model.observations, step.base.left_out
    channels = []
    for i, subject in enumerate(o.subjects):
        for j, channel in enumerate(o.channels):
            if not o.present[i, j]:
                continue
            observed, predicted, sd = (float(v[i, j]) for v in (o.y, left_out.mean, left_out.sd))
            channels.append(
                {
                    "subject": subject,
                    "output": channel.name,
                    "quantity": channel.quantity,
                    "segment": channel.segment,
                    "load_fraction": channel.load_fraction,
                    "observed": observed,
                    "predicted": predicted,
                    "sd": sd,
                    "z": (observed - predicted) / sd,
                }
            )
    return {
        "detected": step.misfit.p_value <= level,
        "p_value": step.misfit.p_value,
        "families": step.misfit.families,
        "largest": [
            {"family": family, "what": name, "z": z, "p_value": p}
            for family, name, z, p in step.misfit.largest
        ],
        "channels": channels,
    }


def _hypothesis(cause: Cause) -> dict:
    h, identified = cause.hypothesis, cause.identified
    estimate, low, high, posterior = None, h.low, h.high, None
    if cause.sampled is not None:
        draws = cause.sampled.posterior
        psi = draws.x[:, cause.sampled.model.first_sigma - 1]
        low, estimate, high = draws.quantile(psi, [0.025, 0.5, 0.975])
        posterior = _density(draws, psi, h.low, h.high)
    elif identified.identifiable and math.isfinite(identified.sd):
        # From the score alone: one step from the base, as far as the range goes.
        middle = h.base + cause.z * identified.sd
        estimate, low, high = (
            min(max(v, h.low), h.high)
            for v in (middle, middle - Z95 * identified.sd, middle + Z95 * identified.sd)
        )
    return {
        "name": cause.name,
        "component": cause.component,
        "parameter": h.parameter,
        "description": h.description,
        "source": h.source,
        "base": h.base,
        "range": [h.low, h.high],
        "z": cause.z,
        "p_value": cause.p_value,
        "p_value_single": cause.p_single,
        "estimate": estimate,
        "interval95": [low, high],
        "unit": h.unit,
        "elpd_gain": cause.elpd_gain,
        "elpd_gain_se": cause.elpd_gain_se,
        "elpd_gain_se_folds": cause.elpd_gain_se_folds,
        "probability": cause.probability,
        "weight": cause.weight,
        "identifiable": identified.identifiable,
        "why": identified.why,
        "absorbed": identified.absorbed,
        "sd": identified.sd,
        "fitted": cause.sampled is not None,
        "ess": None if cause.sampled is None else cause.sampled.posterior.ess,
        "fraction_simulated": cause.coverage,
        "posterior": posterior,
    }


def _density(draws: Posterior, values: torch.Tensor, low: float, high: float) -> dict:
    """Histogram of `values` (N,), over the part of the range that holds nearly all of the mass."""
    first, last = draws.quantile(values, [0.0005, 0.9995])
    pad = 0.1 * (last - first) + 1e-9
    edges = torch.linspace(max(low, first - pad), min(high, last + pad), BINS + 1).double()
    counts, _ = torch.histogram(values.double(), edges, weight=draws.weight)
    density = counts / (edges[1:] - edges[:-1])
    return {"edges": edges.tolist(), "density": density.tolist()}


def _gain(before: Sampled, after: Sampled) -> dict:
    elpd, se, over_folds = gain_of(before.left_out, after.left_out, after.posterior)
    o = before.model.observations
    kinds = {"rmse": o.channels.is_strain, "rmse_volume_ml": o.channels.of_quantity("volume")}
    found = {"elpd": elpd, "elpd_se": se, "elpd_se_folds": over_folds}
    folds = dict(
        zip(
            before.left_out.folds,
            (after.left_out.elpd - before.left_out.elpd).tolist(),
            strict=True,
        )
    )
    for when, model in (("before", before), ("after", after)):
        error = o.y - model.left_out.mean
        for key, mask in kinds.items():
            here = torch.as_tensor(mask) & o.present
            value = float(error[here].square().mean().sqrt()) if here.any() else None
            found[f"{key}_{when}"] = value
        inside = (error.abs() <= Z95 * model.left_out.sd)[o.present]
        found[f"coverage_{when}"] = float(inside.double().mean())
    return found | {"by_segment": {o.group_names[k]: v for k, v in folds.items()}}


def _theta(before: Sampled, after: Sampled) -> list[dict]:
    """Posterior mean and sd of what moves theta, before and after; factors, not logarithms."""
    rows = []
    names = before.model.layout.names
    (m0, s0), (m1, s1) = (
        s.posterior.moments(s.posterior.x[:, : len(names)].exp()) for s in (before, after)
    )
    for i, name in enumerate(names):
        rows.append(
            {
                "parameter": name.removeprefix("log "),
                "before": [float(m0[i]), float(s0[i])],
                "after": [float(m1[i]), float(s1[i])],
                "shift_sd": float((m1[i] - m0[i]) / s0[i]),
            }
        )
    return rows


def _noise(before: Sampled, after: Sampled) -> list[dict]:
    """Inferred noise scales per quantity (in training sd), medians before and after."""
    rows = []
    for i, quantity in enumerate(before.model.observations.noise.groups):
        values = [
            s.posterior.quantile(s.posterior.x[:, s.model.first_sigma + i].exp(), [0.5])[0]
            for s in (before, after)
        ]
        rows.append({"quantity": quantity, "before": values[0], "after": values[1]})
    return rows


def _round(step: Round, level: float) -> dict:
    base = step.base.model
    return {
        "model": list(base.names[len(base.layout.names) : base.first_sigma]),
        "misfit": _misfit(step, level),
        "hypotheses": [_hypothesis(cause) for cause in step.causes],
        "rejected": step.rejected,
        "convincing": step.convincing,
        "candidates": [cause.name for cause in step.candidates],
        "found": step.found.name if step.found else None,
        "found_component": step.found.component if step.found else None,
        "base_weight": step.base_weight,
        "critical_z": step.critical_z,
        "ess": step.base.posterior.ess,
        "outside": _on_bounds(step.base),
    }


def _on_bounds(sampled: Sampled) -> list[str]:
    """Coordinates of the fit that lie on a bound of their range."""
    model, x = sampled.model, sampled.fit.x[0]
    near = 1e-6 * (model.high - model.low)
    at = (x <= model.low + near) | (x >= model.high - near)
    return [name for name, here in zip(model.names, at.tolist(), strict=True) if here]


def _limits(first: Round, channels: Channels) -> list[str]:
    """What the data do not support, in sentences. channels: those that the study observes."""
    o = first.base.model.observations
    said = []
    if not first.misfit.families:
        said.append("no more channels than parameters: they can be fitted whatever is wrong")
    for channel in {c.quantity: c for c in channels if c.quantity != "volume"}.values():
        if channel.quantity not in o.channels.quantities:
            what = f"{channel.quantity} strain" if channel.kind.is_strain else channel.quantity
            said.append(f"no {what} was measured: nothing is said about it")
    for family in ("direction", "level", "wall"):
        if first.misfit.families and family not in first.misfit.families:
            said.append(f"too few channels for the tests by {family}")
    if o.noise.groups:
        said.append(
            "the noise is inferred: a misfit spread evenly over a direction counts as noise, and "
            "the overall test of the size of residuals does not apply"
        )
    for cause in first.causes:
        if cause.coverage < 1:
            said.append(
                f"{cause.name}: {100 * cause.coverage:.0f} % of its simulations converged; "
                "where the others lie, its effect is extrapolated"
            )
    return said
