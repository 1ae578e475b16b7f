"""Misfit, causes, extensions, gain and verdict of one subject, round by round.

A round fits the model at hand, tests it against all causes that are left, fits the leading ones in
earnest and decides. What it finds becomes part of the model of the next round.
"""

import logging
import math
from dataclasses import dataclass, field

import arviz as az
import pandas as pd
import torch

from regional_lv.criticism import score
from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.criticism.fit import Fit, fit_best, fit_from_nothing, spread
from regional_lv.criticism.identify import Identified, identify
from regional_lv.criticism.linear import approximate, leave_out_linearly
from regional_lv.criticism.model import Layout, Model
from regional_lv.criticism.observations import Observations
from regional_lv.criticism.posterior import (
    LeftOut,
    Posterior,
    gain_of,
    laplace,
    leave_out,
    sample,
)
from regional_lv.criticism.ratio import likelihood_ratios
from regional_lv.emulators.base import Emulator
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

PROBABILITY = 0.95
"""Of the causes that are named together when none can be named alone."""

ADEQUATE = 0.01
"""Level of the last test: a model that misses the data at this level explains nothing, whatever
it gains."""

PLACES = 3
"""Of a cause with many possible places, those that are fitted in earnest."""

LARGEST_SAMPLED = 20
"""Coordinates up to which posteriors are sampled; beyond, several hearts are too many at once and
the Laplace approximation takes over."""


@dataclass(frozen=True)
class Settings:
    """bootstrap: replicates. level: family-wise level of the tests. leading_p, leading_least: which
    causes are fitted in earnest. draws: per round of the sampler. rounds: at most. load_fractions:
    at which the heart could be imaged to tell causes apart."""

    bootstrap: int
    level: float
    leading_p: float
    leading_least: int
    draws: int
    rounds: int
    load_fractions: tuple[float, ...] = ()

    @classmethod
    def from_config(cls, section: dict) -> "Settings":
        """From the section `criticism` of the config; other keys are ignored."""
        flat = section | {f"leading_{key}": value for key, value in section["leading"].items()}
        return cls(**{key: flat[key] for key in cls.__dataclass_fields__})


@dataclass(frozen=True)
class Sampled:
    """One model fitted in earnest: its fit, posterior and leave-one-segment-out prediction."""

    model: Model
    fit: Fit
    posterior: Posterior
    left_out: LeftOut


@dataclass
class Cause:
    """What a round has to say of one hypothesis.

    candidate: its extension in the leading place, None for the noise. z: score there, signed.
    p_single and p_value: by itself, and over the catalogue. places: component -> extension and
    score. sampled: fitted in earnest. log_evidence: relative to the model of the round.
    """

    hypothesis: object
    candidate: object
    z: float
    p_single: float
    p_value: float
    identified: Identified
    places: dict[str, tuple[object, float]] = field(default_factory=dict)
    sampled: Sampled | None = None
    log_evidence: float = -math.inf
    elpd_gain: float | None = None
    elpd_gain_se: float | None = None
    elpd_gain_se_folds: float | None = None
    probability: float = 0.0
    weight: float = 0.0

    @property
    def name(self) -> str:
        return self.hypothesis.name

    @property
    def component(self) -> str:
        return "" if self.candidate is None else self.candidate.component

    @property
    def coverage(self) -> float:
        """Share of the simulations asked for that converged."""
        return 1.0 if self.candidate is None else float(self.candidate.fraction_simulated)


@dataclass
class Round:
    """One round: the model at hand, its misfit, all causes (best first), and what was decided."""

    base: Sampled
    misfit: score.Misfit
    causes: list[Cause]
    rejected: bool
    candidates: list[Cause]
    convincing: bool
    base_weight: float
    critical_z: float

    @property
    def found(self) -> Cause | None:
        """What the next round's model has: the most probable of the candidates."""
        return self.candidates[0] if self.candidates else None


@dataclass
class Criticism:
    """All rounds of one subject (or of several together), and the model in the end."""

    observations: Observations
    rounds: list[Round]
    settings: Settings

    @property
    def found(self) -> list[Cause]:
        return [r.found for r in self.rounds if r.found]

    @property
    def explained(self) -> bool:
        """Whether the last model fits: what was found explains the misfit, not only a part."""
        last = self.rounds[-1]
        heavy = last.found is not None and last.found.sampled.model.tails is not None
        return heavy or last.misfit.p_value > ADEQUATE

    @property
    def named(self) -> Cause | None:
        first = self.rounds[0]
        alone = len(first.candidates) == 1 and first.convincing
        return first.candidates[0] if alone and self.explained else None

    @property
    def indistinguishable(self) -> list[Cause]:
        """Causes of the first round of which the data cannot say which it is."""
        if self.named or not self.explained:
            return []
        return self.rounds[0].candidates


def criticise(
    observations: Observations,
    emulator: Emulator,
    extensions,
    noises,
    settings: Settings,
    seed: int,
    known_theta: torch.Tensor | None = None,
) -> Criticism:
    """Find out what is wrong with `emulator` as a model of the observations.

    extensions: of all causes that change the outputs, for the emulator's outputs; noises:
    hypotheses that change the noise. known_theta: (S, P), for hearts whose theta is known up to
    a common number for each factor of the material.
    """
    outputs, subjects = observations.outputs, observations.subjects
    extensions = [extension.select(outputs) for extension in extensions]
    if known_theta is None:
        layout = Layout.inferred(subjects, emulator.parameters)
    else:
        layout = Layout.known(known_theta, emulator.parameters)
    extended = ExtendedEmulator(emulator.select(outputs))
    model = Model(observations, extended, layout)
    best = fit_from_nothing(model, derive(seed, "starts"))
    base = _in_earnest(model, best, settings, derive(seed, "base"))
    rounds: list[Round] = []
    while True:
        own = derive(seed, "round", len(rounds))
        step = _round(base, extensions, noises, settings, own, first=not rounds)
        rounds.append(step)
        found = step.found
        if found is None or len(rounds) == settings.rounds:
            break
        base = found.sampled
        if base.model.tails is not None:
            # Whatever is left is within reach of such tails: there is nothing to test.
            break
        # One hypothesis may be at work in one place only, or this would go on through all of them.
        extensions = [e for e in extensions if e.hypothesis.name != found.name]
    if rounds[-1].found is not None and rounds[-1].found.sampled.model.tails is None:
        # The last model has not been tested yet.
        rounds.append(_round(rounds[-1].found.sampled, [], [], settings, derive(seed, "last")))
    return Criticism(observations, rounds, settings)


def _in_earnest(model: Model, best: Fit, settings: Settings, seed: int) -> Sampled:
    centre, covariance = laplace(model, best)
    if len(centre) > LARGEST_SAMPLED:
        posterior = approximate(model, best, settings.draws, derive(seed, "posterior"))
        left_out = leave_out_linearly(model, best)
    else:
        posterior = sample(model, centre, covariance, settings.draws, derive(seed, "posterior"))
        left_out = leave_out(posterior, settings.draws, derive(seed, "left out"))
    log.info(
        "%s: log evidence %.2f, %.0f effective draws, elpd %.2f, %.0f %% of folds sampled anew",
        " + ".join(model.names[len(model.layout.names) : model.first_sigma]) or "base model",
        *(posterior.log_evidence, posterior.ess, left_out.elpd.sum(), 100 * left_out.repeated),
    )
    return Sampled(model, best, posterior, left_out)


def _round(
    base: Sampled, extensions, noises, settings: Settings, seed: int, first: bool = False
) -> Round:
    """One round. What fits best of all that is not rejected is told in the first one only."""
    model, best = base.model, base.fit
    observed = score.statistics(model, best, extensions)
    null = score.bootstrap(model, best, extensions, settings.bootstrap, derive(seed, "bootstrap"))
    testable = int(model.observations.present.sum()) > len(model.low)
    # With as many coordinates as channels every residual is round-off.
    misfit = score.judge_misfit(observed, null) if testable else score.Misfit(1.0, {}, [])
    # Of several hearts together the noise is known well enough for scores.
    observations = model.observations
    both = testable and bool(observations.noise.groups) and len(observations.subjects) == 1
    level = settings.level / 2 if both else settings.level
    causes, critical = _rank(model, best, extensions, noises, observed, null, level)
    if both:
        causes = _fit_all(model, best, extensions, causes, misfit.p_value, settings.level, seed)
    rejected = testable and bool(causes) and min(c.p_value for c in causes) <= settings.level
    if rejected or first:
        _fit_leading(base, causes, settings, seed)
    base_weight = _weigh(base, causes)
    candidates: list[Cause] = []
    convincing = False
    if rejected:
        total = 0.0
        for cause in sorted(causes, key=lambda c: -c.probability):
            if total >= PROBABILITY or cause.sampled is None:
                break
            candidates.append(cause)
            total += cause.probability
        # The gain of the best; of a set, no single member needs to be sure by itself.
        convincing = bool(candidates) and (candidates[0].elpd_gain > 2 * candidates[0].elpd_gain_se)
    log.info(
        "misfit p %.3f; causes: %s",
        misfit.p_value,
        ", ".join(
            f"{c.name} p {c.p_value:.3f} probability {c.probability:.2f}" for c in causes[:4]
        ),
    )
    return Round(base, misfit, causes, rejected, candidates, convincing, base_weight, critical)


def _rank(model, best, extensions, noises, observed, null, level) -> tuple[list[Cause], float]:
    """All causes, the component with the largest score for each, most conspicuous first; and the
    score that the test over the catalogue asks for."""
    identified = [identify(model, best, e) for e in extensions]
    family = torch.tensor([i.identifiable for i in identified], dtype=torch.bool)
    extreme = null.causes[:, family].abs()
    use_tails = observed.tails is not None and len(noises) > 0
    columns = [extreme] + ([null.tails[:, None]] if use_tails else [])
    pooled = torch.cat(columns, dim=1)
    largest = pooled.amax(1) if pooled.shape[1] else None

    def over_catalogue(z: float) -> float:
        return 1.0 if largest is None else score.share_beyond(abs(z), largest)

    causes = []
    for name in dict.fromkeys(e.hypothesis.name for e in extensions):
        places = [i for i, e in enumerate(extensions) if e.hypothesis.name == name]
        usable = [i for i in places if identified[i].identifiable] or places
        z = observed.causes[0]
        lead = max(usable, key=lambda i: abs(float(z[i])))
        own = null.causes[:, usable].abs().amax(1)
        causes.append(
            Cause(
                extensions[lead].hypothesis,
                extensions[lead],
                float(z[lead]),
                score.share_beyond(abs(float(z[lead])), own),
                over_catalogue(float(z[lead])) if identified[lead].identifiable else 1.0,
                identified[lead],
                {extensions[i].component: (extensions[i], float(z[i])) for i in places},
            )
        )
        causes[-1].log_evidence = _mean_evidence(
            [_laplace_gain(extensions[i], identified[i], float(z[i])) for i in places]
        )
    for hypothesis in noises:
        if observed.tails is None:
            few = Identified(False, math.nan, math.nan, "too few channels to see tails of noise")
            causes.append(Cause(hypothesis, None, 0.0, 1.0, 1.0, few))
            continue
        z = float(observed.tails[0])
        known = Identified(True, math.nan, 0.0, "theta cannot imitate the distribution of noise")
        p = score.share_beyond(z, null.tails)
        causes.append(Cause(hypothesis, None, z, p, over_catalogue(z), known))
        causes[-1].log_evidence = float(observed.tail_evidence[0])
    critical = math.nan if largest is None else float(largest.quantile(1 - level))
    return sorted(causes, key=_conspicuous), critical


def _fit_all(model, best, extensions, causes, misfit: float, level: float, seed: int):
    """Causes with the p-values of two tests where the noise is inferred, most conspicuous first.

    Where the model is wrong and no score says why, every cause is fitted. Each test has half the
    level.
    """
    ratios: dict[str, float] = {}
    if misfit <= level and causes and 2 * min(c.p_value for c in causes) > level:
        shown = {c.name for c in causes if c.identified.identifiable}
        tested = [e for e in extensions if e.hypothesis.name in shown]
        ratios = likelihood_ratios(model, best, tested, derive(seed, "ratios")) if tested else {}
    for cause in causes:
        cause.p_value = min(1.0, 2 * min(cause.p_value, ratios.get(cause.name, 1.0)))
    return sorted(causes, key=_conspicuous)


def _conspicuous(cause: Cause) -> tuple:
    return cause.p_value, cause.p_single, -abs(cause.z)


def _laplace_gain(extension, identified: Identified, z: float) -> float:
    """Log evidence of an extension that was not sampled, relative to the model without it: of a
    normal likelihood in psi under a uniform prior on the range. From the score alone."""
    if not identified.identifiable:
        return -math.inf
    h = extension.hypothesis
    return 0.5 * z**2 + math.log(
        min(1.0, math.sqrt(2 * math.pi) * identified.sd / (h.high - h.low))
    )


def _mean_evidence(logs: list[float]) -> float:
    values = torch.tensor(logs, dtype=torch.float64)
    return float(torch.logsumexp(values, 0) - math.log(len(logs)))


def _fit_leading(base: Sampled, causes: list[Cause], settings: Settings, seed: int) -> None:
    """Fit the leading causes in earnest, and put their numbers in place."""
    usable = [c for c in causes if c.identified.identifiable]
    leading = [
        c
        for i, c in enumerate(usable)
        if i < settings.leading_least or c.p_single < settings.leading_p
    ]
    for cause in leading:
        own = derive(seed, "cause", cause.name)
        places = sorted(cause.places, key=lambda c: -abs(cause.places[c][1]))[:PLACES] or [""]
        fitted = {}
        for place in places:
            extension = cause.places[place][0] if cause.places else None
            tails = None if cause.places else cause.hypothesis
            fitted[place] = _extend(base, extension, tails, settings, derive(own, place))
        at = max(fitted, key=lambda place: fitted[place].posterior.log_evidence)
        cause.sampled = fitted[at]
        if cause.places:
            cause.candidate, cause.z = cause.places[at]
        evidence = {p: s.posterior.log_evidence for p, s in fitted.items()}
        reference = base.posterior.log_evidence
        # Places that were not sampled are as likely as the least likely one that was, at most.
        rest = min(evidence.values())
        count = max(len(cause.places), 1)
        logs = [*evidence.values(), *[rest] * (count - len(evidence))]
        cause.log_evidence = _mean_evidence([value - reference for value in logs])
        cause.elpd_gain, cause.elpd_gain_se, cause.elpd_gain_se_folds = gain_of(
            base.left_out, cause.sampled.left_out, cause.sampled.posterior
        )


def _extend(base: Sampled, extension, tails, settings: Settings, seed: int) -> Sampled:
    before = base.model
    emulator = before.emulator if extension is None else before.emulator.with_extension(extension)
    model = Model(before.observations, emulator, before.layout, tails)
    at = before.psi.stop
    starts = spread(base.fit.x[0], model, at)
    if tails is None:
        best = fit_best(model, starts)
    else:
        # Least squares say nothing about the tails; the sampler finds them.
        model.settle(starts[0])
        old = base.fit
        best = Fit(starts[2:3], old.objective, old.residual, old.jacobian, old.whitening)
    return _in_earnest(model, best, settings, seed)


def _weigh(base: Sampled, causes: list[Cause]) -> float:
    """Set probabilities (among the causes) and stacking weights (with the base model, whose weight
    is returned)."""
    logs = torch.tensor([c.log_evidence for c in causes], dtype=torch.float64)
    if len(causes) and torch.isfinite(logs).any():
        for cause, p in zip(causes, torch.softmax(logs, 0).tolist(), strict=True):
            cause.probability = p
    fitted = [c for c in causes if c.sampled is not None]
    elpd = torch.stack([base.left_out.elpd, *(c.sampled.left_out.elpd for c in fitted)])
    weights = stack(elpd)
    for cause, weight in zip(fitted, weights[1:].tolist(), strict=True):
        cause.weight = weight
    return float(weights[0])


def stack(elpd: torch.Tensor) -> torch.Tensor:
    """Weights (K,) of K predictive densities, log (K, F) per fold, whose mixture predicts best
    (stacking, Yao et al. 2018, doi 10.1214/17-BA1091)."""
    # Only differences within a fold count; without the rest no density underflows.
    logs = (elpd - elpd.amax(0)).numpy()
    models = {
        name: az.ELPDData(
            {
                **{"elpd_loo": row.sum(), "se": math.nan, "p_loo": math.nan, "warning": False},
                **{"scale": "log", "loo_i": pd.Series(row)},
            }
        )
        for name, row in enumerate(logs)
    }
    weights = az.compare(models, method="stacking")["weight"]
    return torch.as_tensor(weights.sort_index().to_numpy(float))
