"""What a criticism found, as plain numbers and sentences: the contract with everything after it."""

import json
import math
from pathlib import Path
from typing import cast

import torch
from statsmodels.stats.weightstats import DescrStatsW

from regional_lv.channels import Channels
from regional_lv.criticism import contract, data_checks, words
from regional_lv.criticism.contract import Findings
from regional_lv.criticism.hypotheses import REGISTRY
from regional_lv.criticism.posterior import gain_of
from regional_lv.criticism.score import Misfit
from regional_lv.criticism.separate import separating_measurement
from regional_lv.criticism.together import Together
from regional_lv.criticism.verdict import PROBABILITY, CauseSet, Criticism, Sampled, Tested
from regional_lv.emulators.base import Emulator
from regional_lv.gaussian import Z95
from regional_lv.measured import shortcomings

BINS = 40
"""Of the posterior of psi."""


LISTED = 20
"""Sets that the findings list, the most probable first."""


def findings_of(
    subject: str,
    criticism: Criticism,
    emulator: Emulator,
    extensions,
    tables,
    strain_exponent: float = 2.0,
) -> Findings:
    """The findings of one subject (or several together, called `subject`), ready for JSON.

    emulator, extensions: for all outputs, to find what measurement would tell causes apart.
    tables: the measured tables, by subject. strain_exponent: of the study's strain measure.
    """
    base, final, searched = criticism.base, criticism.final, criticism.searched
    rivals = [s for s in criticism.sets if s.sampled is not None]
    content: Findings = {
        "subject": subject,
        "subjects": list(criticism.observations.subjects),
        "misfit": _misfit(base, searched.misfit, searched.detected),
        "data_checks": [
            {"subject": name} | check
            for name, table in tables.items()
            for check in data_checks.check(table, strain_exponent)
        ],
        "hypotheses": [_hypothesis(test, criticism) for test in criticism.tests],
        "sets": [_set(one, criticism) for one in criticism.sets[:LISTED]],
        "base_probability": criticism.base_probability,
        "unlisted_probability": criticism.unlisted_probability,
        "named": criticism.named,
        "groups": criticism.groups,
        "acts_like": criticism.acts_like,
        "explained": criticism.explained,
        "outliers": criticism.outliers,
        "confirmation": _confirmation(criticism),
        "separating": separating_measurement(
            rivals if criticism.groups else [],
            *(emulator, extensions, criticism.settings.load_fractions, criticism.simulations),
        ),
        "best": None if criticism.best is None else list(criticism.best.names),
        "gain": _gain(base, final),
        "theta": _theta(base, final),
        "noise": _noise(base, final),
        "remaining": None,
        "level": criticism.settings.level,
        "least_probability": PROBABILITY,
        "critical_z": searched.critical_z,
        "least_p_value": 1 / (1 + criticism.settings.bootstrap),
        "ess": final.posterior.ess,
        "limits": [
            f"{name}: {text}"
            for name, table in tables.items()
            for text in shortcomings(table, len(emulator.parameters))
        ]
        + _limits(criticism, emulator.channels),
        "words": [],
    }
    if criticism.best is not None and criticism.best.misfit is not None:
        content["remaining"] = _misfit(final, criticism.best.misfit, not criticism.adequate)
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
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


# ------------------------------------------------------------------------------------ parts


def _misfit(sampled: Sampled, misfit: Misfit, detected: bool) -> contract.Misfit:
    o, left_out = sampled.model.observations, sampled.left_out
    channels: list[contract.Channel] = []
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
        "detected": detected,
        "p_value": misfit.p_value,
        "families": misfit.families,
        "largest": [
            {"family": family, "what": name, "z": z, "p_value": p}
            for family, name, z, p in misfit.largest
        ],
        "channels": channels,
    }


def _hypothesis(test: Tested, criticism: Criticism) -> contract.Cause:
    """Estimate and interval are over all probable sets that hold the cause, as probable as they
    are, without those that data refute where the best one fits; of a cause in none of them, one
    step from the base value along its score."""
    h, identified, name = test.hypothesis, test.identified, test.name
    estimate, low, high, posterior = None, h.low, h.high, None
    best = criticism.best
    holding = [s for s in criticism.sets if name in s.names and s.posterior is not None]
    if criticism.adequate:
        holding = [s for s in holding if not s.refuted]
    holding.sort(key=lambda s: s is not best)
    component, bound = test.component, False
    if holding:
        component = dict(holding[0].members)[name]
        same = [s for s in holding if dict(s.members)[name] == component]
        psi, weight = _pooled(same, name, h.scale)
        weighted = DescrStatsW(psi.numpy(), weight.numpy())
        low, estimate, high = weighted.quantile([0.025, 0.5, 0.975], return_pandas=False).tolist()
        posterior = _density(weighted, psi, weight, h.low, h.high)
        bound = same[0].model.tails is None and same[0].at_bound(name)
    elif identified.identifiable and math.isfinite(identified.sd):
        # From the score alone, as far as the range goes.
        middle = h.base + test.z * identified.sd
        estimate, low, high = (
            min(max(v, h.low), h.high)
            for v in (middle, middle - Z95 * identified.sd, middle + Z95 * identified.sd)
        )
    return {
        "name": name,
        "component": component,
        "parameter": h.parameter,
        "description": h.description,
        "source": h.source,
        "base": h.base,
        "range": [h.low, h.high],
        "z": test.z,
        "p_value": test.p_value,
        "p_value_single": test.p_single,
        "probability": criticism.probability(name),
        "component_probability": criticism.share_of(name, component),
        "estimate": estimate,
        "interval95": [low, high],
        "at_bound": bound,
        "unit": h.unit,
        "identifiable": identified.identifiable,
        "why": identified.why,
        "absorbed": identified.absorbed,
        "sd": identified.sd,
        "fitted": bool(holding),
        "fraction_simulated": test.fraction_simulated,
        "posterior": posterior,
    }


def _pooled(sets, name: str, scale) -> tuple[torch.Tensor, torch.Tensor]:
    """Draws (N,) of a cause's psi from several sets, and their weights (N,)."""
    values = [scale.inverse(s.posterior.x[:, s.place(name)]) for s in sets]
    # Of sets that are all but impossible, the shares still add up.
    share = max(sum(s.probability for s in sets), 1e-300)
    weights = [s.posterior.weight * max(s.probability, 1e-300) / share for s in sets]
    return torch.cat(values), torch.cat(weights)


def _set(one: CauseSet, criticism: Criticism) -> contract.Set:
    gain: tuple[float | None, ...] = (None, None, None)
    if one.sampled is not None:
        gain = gain_of(criticism.base.left_out, one.sampled.left_out, one.sampled.posterior)
    found = one.model.psi_of(one.fit.x[0])[0].tolist()
    return {
        "causes": list(one.names),
        "components": [component for _, component in one.members],
        "fit": found,
        "probability": one.probability,
        "log_evidence": one.log_evidence,
        "log_prior": one.log_prior,
        "elpd_gain": gain[0],
        "elpd_gain_se": gain[1],
        "misfit_p_value": one.misfit.p_value if one.misfit else None,
        "confirmed": one.confirmed,
        "simulations": one.simulations,
        "difference_sd": one.difference_sd,
        "beyond_sd": one.beyond_sd,
    }


def _confirmation(criticism: Criticism) -> contract.Confirmation:
    """What stands behind the best set; with what was simulated of all."""
    best = criticism.best
    channels: list[contract.Difference] = []

    def total(holds) -> float:
        physical = (s for s in criticism.sets if s.model.tails is None)
        return sum(s.probability for s in physical if holds(s))

    if best is not None and best.correction is not None:
        o, value, in_sds = criticism.observations, best.correction.value, best.difference_sds
        channels = [
            {
                "subject": subject,
                "output": channel.name,
                "difference": float(value[i, j]),
                "difference_sd": float(in_sds[i, j]),
            }
            for i, subject in enumerate(o.subjects)
            for j, channel in enumerate(o.channels)
            if o.present[i, j]
        ]
    return {
        "simulations": sum(s.simulations for s in criticism.sets),
        "simulations_of_best": best.simulations if best is not None else 0,
        "largest_difference_sd": best.difference_sd if best is not None else math.nan,
        "probability_not_simulated": total(lambda s: s.correction is None and not s.failed),
        "probability_elsewhere": total(lambda s: s.elsewhere),
        "probability_failed": total(lambda s: s.failed),
        "channels": channels,
    }


def _density(
    weighted, values: torch.Tensor, weight: torch.Tensor, low: float, high: float
) -> contract.Histogram:
    """Histogram of `values` (N,), over the part of the range that holds nearly all of the mass."""
    first, last = weighted.quantile([0.0005, 0.9995], return_pandas=False).tolist()
    pad = 0.1 * (last - first) + 1e-9
    edges = torch.linspace(max(low, first - pad), min(high, last + pad), BINS + 1).double()
    counts, _ = torch.histogram(values.double(), edges, weight=weight.double())
    density = counts / (edges[1:] - edges[:-1])
    return {"edges": edges.tolist(), "density": density.tolist()}


def _gain(before: Sampled, after: Sampled) -> contract.Gain:
    elpd, se, over_folds = gain_of(before.left_out, after.left_out, after.posterior)
    o = before.model.observations
    kinds = {"rmse": o.channels.is_strain, "rmse_volume_ml": o.channels.of_quantity("volume")}
    found: dict[str, float | None] = {"elpd": elpd, "elpd_se": se, "elpd_se_folds": over_folds}
    found["elpd_before"] = float(before.left_out.elpd.sum())
    for when, model in (("before", before), ("after", after)):
        error = o.y - model.left_out.mean
        for key, mask in kinds.items():
            here = torch.as_tensor(mask) & o.present
            value = float(error[here].square().mean().sqrt()) if here.any() else None
            found[f"{key}_{when}"] = value
        inside = (error.abs() <= Z95 * model.left_out.sd)[o.present]
        found[f"coverage_{when}"] = float(inside.double().mean())
    return cast(contract.Gain, found)


def _theta(before: Sampled, after: Sampled) -> list[contract.Moved]:
    """Posterior mean and sd of what moves theta, before and after; factors, not logarithms."""
    rows: list[contract.Moved] = []
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


def _noise(before: Sampled, after: Sampled) -> list[contract.Noise]:
    """Inferred noise scales per quantity (in training sd), medians before and after."""
    rows: list[contract.Noise] = []
    for i, quantity in enumerate(before.model.observations.noise.groups):
        values = [
            s.posterior.quantile(s.posterior.x[:, s.model.first_sigma + i].exp(), [0.5])[0]
            for s in (before, after)
        ]
        rows.append({"quantity": quantity, "before": values[0], "after": values[1]})
    return rows


def _limits(criticism: Criticism, channels: Channels) -> list[str]:
    """What the data do not support, in sentences. channels: those that the study observes."""
    o, families = criticism.observations, criticism.searched.misfit.families
    limits = []
    if not families:
        limits.append("no more channels than parameters: they can be fitted whatever is wrong")
    for channel in {c.quantity: c for c in channels if c.quantity != "volume"}.values():
        if channel.quantity not in o.channels.quantities:
            what = f"{channel.quantity} strain" if channel.kind.is_strain else channel.quantity
            limits.append(f"no {what} was measured: nothing is concluded about it")
    for family in ("direction", "level", "wall"):
        if families and family not in families:
            limits.append(f"too few channels for the tests by {family}")
    if o.noise.groups:
        limits.append(
            "the noise is inferred: a misfit spread evenly over a direction counts as noise, and "
            "the overall test of the size of residuals does not apply"
        )
    if len(o.subjects) > 1 and not Together.possible(criticism.base.model):
        limits.append(
            "a smooth departure of no listed shape is taken as another one in each heart: one that "
            "is common to them has a larger probability than is stated"
        )
    if criticism.final.posterior.poor:
        limits.append(
            f"the posterior has {criticism.final.posterior.ess:.0f} effective draws only: "
            "estimates and intervals are rough"
        )
    for test in criticism.tests:
        if test.fraction_simulated < 1:
            limits.append(
                f"{test.name}: {100 * test.fraction_simulated:.0f} % of its simulations converged; "
                "where the others lie, its effect is extrapolated"
            )
    searched = {test.name for test in criticism.tests}
    if others := [name for name in REGISTRY if name not in searched]:
        limits.append(
            f"{len(others)} of the catalogue's {len(REGISTRY)} causes were not searched, because "
            "criticism.hypotheses does not name them, the study's model rules them out, or too few "
            "of their simulations converged: "
            f"{', '.join(others)}"
        )
    return limits
