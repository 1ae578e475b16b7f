"""Hearts whose truth is known: drawn at random, simulated in full, measured with noise, truth
apart."""

import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import special

from regional_lv.channels import Channels
from regional_lv.errors import InputError
from regional_lv.hidden_effects.discrepancies import DISCREPANCIES
from regional_lv.hidden_effects.groups import EFFECTS
from regional_lv.inputs.base import Input
from regional_lv.inputs.closed_forms import HeavyTails
from regional_lv.inputs.shape import EndocardialRadius, SegmentThickness
from regional_lv.inputs.space import Inputs, Role, catalogue
from regional_lv.measured import synthetic_subject
from regional_lv.measured.synthetic import unit_noise
from regional_lv.mechanics.dolfinx_api import release_unused
from regional_lv.seeds import derive
from regional_lv.simulation.ventricles import Ventricles
from regional_lv.study.progress import Progress

log = logging.getLogger(__name__)

LEFT_OUT = "left_out"
"""The discrepancy of hearts with a cause of the catalogue that their criticism does not search."""

PHYSIOLOGICAL = (0.5, 2.0)
"""Where hearts have their stiffness, as far as its range allows."""

LEAST_SHARE = 0.2
"""Effects are at least this share of the way from the nominal value to an end of the range."""

MISREAD: dict[type[Input], float] = {SegmentThickness: 0.10, EndocardialRadius: 0.03}
"""Relative sd of what is read off images, in hearts whose table was misread."""

ATTEMPTS = 5
"""Draws of one heart, if those before cannot be inflated."""


@dataclass(frozen=True)
class PlannedHeart:
    """What a heart is, before its values are drawn.

    causes: whose inputs are not at their nominal values. discrepancy: a name of `DISCREPANCIES`,
    `LEFT_OUT` or nothing. left_out: names of inputs that its criticism may not know.
    """

    subject: str
    group: str
    causes: tuple[str, ...]
    discrepancy: str
    left_out: tuple[str, ...]
    seed: int


# ------------------------------------------------------------------------------------- drawing


def plan_hearts(counts: Mapping[str, int], inputs: Inputs, seed: int) -> list[PlannedHeart]:
    """Hearts of all groups, in an order that tells nothing.

    counts: how many of each of `EFFECTS`. Of hearts with one cause each cause takes its turn after
    a shuffle, and so do the `DISCREPANCIES` with `LEFT_OUT`; of several causes all combinations are
    equally likely. What changes the noise stands alone. Raises InputError if the study suspects
    fewer causes than a heart has, or if a group does not fit it.
    """
    rng = np.random.default_rng(derive(seed, "benchmark"))
    suspected = inputs.subset(inputs.of_role("suspected"))
    every = list(dict.fromkeys(each.cause for each in suspected))
    physical = list(dict.fromkeys(e.cause for e in suspected if not isinstance(e, HeavyTails)))
    _check(counts, inputs, physical)
    drawn: list[tuple[str, tuple[str, ...], str]] = []
    for group, size in EFFECTS.items():
        count = counts[group]
        if group == "unlisted":
            hidden = _in_turn(physical, count, rng)
            discrepancies = _in_turn([*DISCREPANCIES, *[LEFT_OUT] * bool(physical)], count, rng)
            causes = [
                (c,) if d == LEFT_OUT else () for c, d in zip(hidden, discrepancies, strict=False)
            ]
            pairs = zip(causes or [()] * count, discrepancies, strict=True)
            drawn += [(group, *pair) for pair in pairs]
        elif size == 1:
            drawn += [(group, (cause,), "") for cause in _in_turn(every, count, rng)]
        else:
            drawn += [(group, tuple(_shuffled(physical, rng)[:size]), "") for _ in range(count)]
    hearts = []
    for number, place in enumerate(rng.permutation(len(drawn))):
        group, causes, discrepancy = drawn[place]
        left_out = [e.name for e in suspected if discrepancy == LEFT_OUT and e.cause in causes]
        own = derive(seed, "benchmark", number)
        name = f"subject-{number:04d}"
        hearts.append(PlannedHeart(name, group, causes, discrepancy, tuple(left_out), own))
    return hearts


def _check(counts: Mapping[str, int], inputs: Inputs, physical: Sequence[str]) -> None:
    for group, size in EFFECTS.items():
        if counts[group] and len(physical) < size:
            raise InputError(
                f"criticism.benchmark.hearts.{group}: such a heart has {size} of the causes that "
                f"`inputs` suspects and that are not of the noise, which are {len(physical)}; "
                "write 0, or suspect more"
            )
    channels = Channels.from_config(inputs.base)
    for name, discrepancy in DISCREPANCIES.items():
        if counts["unlisted"] and (reason := discrepancy.why_not(channels)):
            raise InputError(
                f"criticism.benchmark.hearts.unlisted: {reason} (observables.quantities), so that "
                f"no heart can have {name}; write 0"
            )
    if counts["misread"] and SegmentThickness.why_not(inputs.base):
        raise InputError(
            f"criticism.benchmark.hearts.misread: {SegmentThickness.why_not(inputs.base)}, which "
            "could be misread; write 0"
        )


def _shuffled(names: Sequence[str], rng: np.random.Generator) -> list[str]:
    return [str(name) for name in rng.permutation(list(names))]


def _in_turn(names: Sequence[str], count: int, rng: np.random.Generator) -> list[str]:
    """`count` names, each as often as the others."""
    turns: list[str] = []
    while names and len(turns) < count:
        turns += _shuffled(names, rng)
    return turns[:count]


def draw_values(heart: PlannedHeart, inputs: Inputs, rng: np.random.Generator) -> np.ndarray:
    """Values (K,) of the inputs of one heart.

    Inferred ones are uniform over their ranges, stiffness as far as it is `PHYSIOLOGICAL`; measured
    ones have their priors, but for the table of a misread heart (`MISREAD`). Of each cause one
    place is on, all equally likely; its value is uniform on its scale in what the range has to
    either side, but for what is close to the nominal one (`LEAST_SHARE`).
    """
    x = inputs.nominal.copy()
    places: dict[str, list[int]] = {cause: [] for cause in heart.causes}
    for k, (each, role) in enumerate(zip(inputs, inputs.roles, strict=True)):
        if role.kind == "inferred":
            x[k] = _inferred(each, rng)
        elif heart.group == "misread" and type(each) in MISREAD:
            x[k] = _about(each, x[k], MISREAD[type(each)] * x[k], rng)
        elif role.kind == "measured":
            x[k] = _about(each, x[k], float(role.sd or 0.0), rng)
        elif each.cause in places:
            places[each.cause].append(k)
    for members in places.values():
        k = int(rng.choice(members))
        x[k] = _effect(inputs[k], x[k], rng)
    return x


def _inferred(each: Input, rng: np.random.Generator) -> float:
    low, high = each.low, each.high
    if each.nominal is None:
        low, high = max(low, PHYSIOLOGICAL[0]), min(high, PHYSIOLOGICAL[1])
    # A range that has nothing physiological is taken as it is.
    return float(rng.uniform(low, high) if low < high else rng.uniform(each.low, each.high))


def _about(each: Input, mean: float, sd: float, rng: np.random.Generator) -> float:
    """A normal value, cut at the ends of the range."""
    ends = special.ndtr((np.array([each.low, each.high]) - mean) / sd)
    return float(mean + sd * special.ndtri(rng.uniform(*ends)))


def _effect(each: Input, nominal: float, rng: np.random.Generator) -> float:
    base, low, high = (each.scale(float(value)) for value in (nominal, each.low, each.high))
    end = low if rng.uniform() < (base - low) / (high - low) else high
    return float(each.scale.inverse(base + rng.uniform(LEAST_SHARE, 1.0) * (end - base)))


# ---------------------------------------------------------------------------------- simulation


@dataclass(frozen=True)
class Simulated:
    """A heart with its values by input, whether these are the study's inferred ones, its outputs
    (D,) without noise, and its discrepancy in words."""

    values: dict[str, float]
    has_stiffness: bool
    outputs: np.ndarray
    detail: str


class Injection:
    """Simulates and measures hearts.

    Parameters
    ----------
    ventricles: of the study. noise: scales by the quantities' `noise`, in their units.
    """

    def __init__(self, ventricles: Ventricles, noise: Mapping[str, float]):
        self.ventricles, self.noise = ventricles, noise
        self.misread = ventricles.altered(with_table(ventricles.inputs))

    def simulate(self, heart: PlannedHeart) -> Simulated:
        """The heart as its values are drawn; drawn again if it cannot be inflated.

        Raises ArithmeticError, with the last reason, after `ATTEMPTS` draws.
        """
        for attempt in range(ATTEMPTS):
            rng = np.random.default_rng(derive(heart.seed, "values", attempt))
            try:
                return self._simulated(heart, rng)
            except ArithmeticError as error:
                log.warning("%s, draw %d: %s", heart.subject, attempt, error)
                reason = error
        raise reason

    def _simulated(self, heart: PlannedHeart, rng: np.random.Generator) -> Simulated:
        ventricles = self.misread if heart.group == "misread" else self.ventricles
        x = draw_values(heart, ventricles.inputs, rng)
        values = dict(zip(ventricles.inputs.names, x.tolist(), strict=True))
        if heart.discrepancy not in DISCREPANCIES:
            return Simulated(values, True, ventricles.outputs(x), " ".join(heart.left_out))
        discrepancy = DISCREPANCIES[heart.discrepancy]
        outputs, detail = discrepancy.outputs(ventricles, x, rng)
        release_unused()  # of a simulator of its own
        return Simulated(values, discrepancy.has_stiffness, outputs, detail)

    def measure(self, heart: PlannedHeart, found: Simulated) -> pd.DataFrame:
        """Its measured table (`measured.synthetic_subject`)."""
        channels = self.ventricles.channels
        rng = np.random.default_rng(derive(heart.seed, "noise"))
        unit = unit_noise(found.values.get(HeavyTails.name, 0.0), len(channels), rng)
        return synthetic_subject(found.outputs, channels, self.noise, unit)


def with_table(inputs: Inputs) -> Inputs:
    """The inputs, and those of the segment table that are not among them."""
    roles = dict(zip(inputs.names, inputs.roles, strict=True))
    own = dict(zip(inputs.names, inputs, strict=True))  # with the ranges that the study gives
    every = [
        own.get(e.name, e) for e in catalogue(inputs.base) if e.name in own or type(e) in MISREAD
    ]
    return Inputs(inputs.base, every, {e.name: roles.get(e.name, Role("fixed")) for e in every})


# ---------------------------------------------------------------------------------------- files


def inject_batch(
    mesh: str | Path,
    physics: Mapping,
    hearts: Mapping[str, int],
    noise: Mapping[str, float],
    seed: int,
    batch: str,
    batch_size: int,
    subjects: str | Path,
    truth: str | Path,
    predictor: str | Path | Sequence[str] = (),
) -> None:
    """Simulate and measure one batch of `plan_hearts`; write the subjects and the truth.

    mesh: finer than the study's, so that nothing rests on errors that both share. physics: what
    `inputs.space.sections_of` gives. hearts: how many of each group; noise: its scales. seed: the
    study's. predictor: of the mesh, or nothing.

    Subjects (Parquet): `subject`, the D outputs with noise, their `sd_<output>`, and `left_out`,
    names of the inputs that their criticism may not know. Truth (Parquet), which no inference
    reads: `subject`, `group`, `unlisted`, `detail`, `has_stiffness`, `causes` (names, JSON),
    `values` (by input, JSON), `status` and `reason`; a heart that could not be inflated is in the
    truth alone.
    """
    inputs = Inputs.from_config(physics)
    first = int(batch) * batch_size
    planned = plan_hearts(hearts, inputs, seed)[first : first + batch_size]
    injection = Injection(Ventricles(mesh, inputs, str(predictor) if predictor else None), noise)
    tables = inject(injection, planned, f"hidden effects batch {batch}")
    for table, path in zip(tables, (subjects, truth), strict=True):
        table.to_parquet(path, index=False)


def inject(
    injection: Injection, hearts: Sequence[PlannedHeart], name: str
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Subjects and truth of some hearts, as `inject_batch` writes them."""
    progress, subjects, truths = Progress(name, len(hearts)), [], []
    for heart in hearts:
        truth: dict[str, object] = {
            "subject": heart.subject,
            "group": heart.group,
            "unlisted": heart.discrepancy,
        }
        truth |= {"causes": json.dumps(heart.causes), "status": "converged", "reason": ""}
        truth |= {"detail": "", "has_stiffness": False, "values": "{}"}
        try:
            found = injection.simulate(heart)
        except ArithmeticError as error:
            truth |= {"status": "failed", "reason": str(error)}
        else:
            table = injection.measure(heart, found).set_index("output")
            row = table["value"].to_dict() | table["sd"].add_prefix("sd_").to_dict()
            row |= {"subject": heart.subject, "left_out": " ".join(heart.left_out)}
            subjects.append(row)
            truth |= {"detail": found.detail, "has_stiffness": found.has_stiffness}
            truth |= {"values": json.dumps(found.values)}
        truths.append(truth)
        progress.step(failed=truth["status"] == "failed")
    columns = _columns(injection.ventricles.channels, injection.noise)
    return pd.DataFrame(subjects, columns=columns), pd.DataFrame(truths)


def _columns(channels: Channels, noise: Mapping[str, float]) -> list[str]:
    """Of the table of subjects."""
    measured = [c.name for c in channels if noise.get(c.kind.noise) is not None]
    return ["subject", "left_out", *measured, *(f"sd_{name}" for name in measured)]
