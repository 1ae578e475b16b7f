"""From measured hearts to a verdict on sets of causes: search, confirmation, conclusion.

`Critic.search` tests the base model and looks for sets of causes with the emulators; `Critic.plan`
says what has to be simulated to confirm the leading ones; `Critic.conclude` takes these simulations
and decides.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import asdict

import pandas as pd
import torch

from regional_lv.criticism import outliers, score
from regional_lv.criticism.confirmation import correct
from regional_lv.criticism.designs import design_columns, design_rows, label
from regional_lv.criticism.discrepancy import (
    AMPLITUDES,
    unlisted_covariance,
    unlisted_pattern,
)
from regional_lv.criticism.extended import ExtendedEmulator
from regional_lv.criticism.fit import Fit, fit_best, fit_from_nothing
from regional_lv.criticism.gains import Gains
from regional_lv.criticism.identify import Identified, identify
from regional_lv.criticism.linear import approximate, leave_out_linearly
from regional_lv.criticism.model import Layout, Model
from regional_lv.criticism.observations import Observations
from regional_lv.criticism.posterior import Posterior, laplace, leave_out, sample
from regional_lv.criticism.ratio import likelihood_ratios
from regional_lv.criticism.rivals import elsewhere, of_each_size, rivals, without_each
from regional_lv.criticism.search import Search, log_evidence, log_prior
from regional_lv.criticism.together import Together
from regional_lv.criticism.verdict import (
    LEAST_PROBABILITY,
    PROBABILITY,
    CauseSet,
    Criticism,
    Member,
    Sampled,
    Searched,
    Settings,
    Tested,
)
from regional_lv.emulators.base import Emulator
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

LEADERS, LEADING_MARGIN = 24, 10.0
"""Sets that are fitted with the covariance of their own emulators: at most so many, and only those
whose log posterior probability comes so near to the best one's."""

EVIDENCES = 4000
"""Draws of the log evidence of sets that were not simulated."""

MOST_SAMPLED = 3
"""Sets whose posterior is sampled for their evidence; more where none of them fits."""

LARGEST_SAMPLED = 20
"""Coordinates of the largest set up to which posteriors are sampled; beyond, several hearts are too
many at once and the Laplace approximation takes over, for all sets alike."""


class Critic:
    """Criticises the base model on some observations.

    Parameters
    ----------
    observations: of one heart, or of several together.
    emulator: the base model's.
    extensions: of all causes that change the outputs, for the emulator's outputs.
    noises: hypotheses that change the noise.
    known_theta: (S, P), for hearts whose theta is known up to a common number for each factor of
        the material.
    """

    def __init__(
        self,
        observations: Observations,
        emulator: Emulator,
        extensions: Sequence,
        noises: Sequence,
        settings: Settings,
        seed: int,
        known_theta: torch.Tensor | None = None,
    ):
        outputs, subjects = observations.outputs, observations.subjects
        self.emulator = emulator.select(outputs)
        if known_theta is None:
            observations = observations.blurred(self.emulator)
        self.observations, self.settings, self.seed = observations, settings, seed
        self.noises = list(noises)
        chosen = [extension.select(outputs) for extension in extensions]
        self._extensions = {(e.hypothesis.name, e.component): e for e in chosen}
        if known_theta is None:
            self.layout = Layout.inferred(subjects, emulator.parameters)
        else:
            self.layout = Layout.known(known_theta, emulator.parameters)
        base = len(self._model(()).low)
        largest = min(settings.largest_set, len({name for name, _ in self._extensions}))
        self._sampling = base + largest <= LARGEST_SAMPLED
        self.testable = int(observations.present.sum()) > base

    # --------------------------------------------------------------------------------- search

    def search(self) -> Searched:
        """Test the base model, and look for the sets of causes that explain the data."""
        model = self._model(())
        best = fit_from_nothing(model, derive(self.seed, "starts"))
        identified = {at: identify(model, best, e) for at, e in self._extensions.items()}
        usable = [at for at, found in identified.items() if found.identifiable]
        tried = [self._extensions[at] for at in usable]
        observed = score.statistics(model, best, tried)
        null = score.bootstrap(
            model, best, tried, self.settings.bootstrap, derive(self.seed, "bootstrap")
        )
        tails = bool(self.noises) and observed.tails is not None
        misfit = score.Misfit(1.0, {}, [])
        if self.testable:  # otherwise every residual is round-off
            misfit = score.judge_misfit(observed, null, tails)
        level = self.settings.level
        if self.testable and self.observations.noise.groups and tried:
            # A larger noise hides what a score sees; then every cause is fitted.
            p_values = [misfit.p_value]
            if 2 * misfit.p_value > level:
                ratios = likelihood_ratios(model, best, tried, derive(self.seed, "ratios"))
                p_values += ratios.values()
            both = min(1.0, 2 * min(p_values))
            misfit = score.Misfit(both, misfit.families, misfit.largest)
        detected = self.testable and misfit.p_value <= level
        tests, critical = self._tests(observed, null, usable, identified, tails)
        sets, searched, prior, reference = [], [], -math.inf, math.nan
        unlisted = approximated = -math.inf
        if self.testable:
            reference = float(log_evidence(model, best)[0])
            searched = [at for at, found in identified.items() if found.relevant]
            sets, prior = self._sets(model, best, reference, searched, detected)
            unlisted, approximated = self._unlisted(model, best, reference, detected)
        log.info(
            "misfit p %.3f; sets: %s",
            misfit.p_value,
            "; ".join(f"{label(s['members'])} {s['log_evidence']:.1f}" for s in sets[:5]),
        )
        return Searched(
            *(best.x[0].tolist(), reference, misfit, detected, tests, sets),
            *(len({name for name, _ in searched}), unlisted, approximated, prior, critical),
        )

    def _tests(self, observed, null, usable, identified, tails) -> tuple[list[dict], float]:
        """What the scores say of every hypothesis, the most conspicuous first; and the score that
        the test over the catalogue asks for."""
        columns = [null.causes.abs()] + ([null.tails[:, None]] if tails else [])
        largest = torch.cat(columns, dim=1)
        largest = largest.amax(1) if largest.shape[1] else torch.zeros(1).double()
        rows = []
        for name in dict.fromkeys(name for name, _ in self._extensions):
            places = [i for i, at in enumerate(usable) if at[0] == name]
            if places:
                lead = max(places, key=lambda i: abs(float(observed.causes[0, i])))
                z, at = float(observed.causes[0, lead]), usable[lead]
                own = null.causes[:, places].abs().amax(1)
                p = score.share_beyond(abs(z), own), score.share_beyond(abs(z), largest)
            else:
                z, p = 0.0, (1.0, 1.0)
                at = next(at for at in self._extensions if at[0] == name)
            rows.append(_row(at, z, p, identified[at]))
        for hypothesis in self.noises:
            if not tails:
                few = "too few channels to see tails of noise"
                known = Identified(False, math.nan, math.nan, few)
                rows.append(_row((hypothesis.name, ""), 0.0, (1.0, 1.0), known))
                continue
            z = float(observed.tails[0])
            why = "theta cannot imitate the distribution of noise"
            p = score.share_beyond(z, null.tails), score.share_beyond(z, largest)
            known = Identified(True, math.nan, 0.0, why)
            rows.append(_row((hypothesis.name, ""), z, p, known))
        rows.sort(key=lambda r: (not r["identified"]["identifiable"], r["p_value"], -abs(r["z"])))
        return rows, float(largest.quantile(1 - self.settings.level))

    def _sets(
        self, model: Model, best: Fit, reference: float, searched: list[Member], detected: bool
    ):
        """The leading sets of the causes `searched`, each fitted with its own emulators'
        covariance, the most probable one first; and the log prior of a discrepancy that is not
        listed."""
        causes: dict[str, list[int]] = {}
        for place, (name, _) in enumerate(searched):
            causes.setdefault(name, []).append(place)
        everything = Model(
            self.observations,
            ExtendedEmulator(self.emulator, [self._extensions[at] for at in searched]),
            self.layout,
        )
        everything.error = model.error
        # Where nothing seems wrong, only what single causes could still be is told.
        largest = min(self.settings.largest_set if detected else 1, len(causes))
        found = Search(everything, best, causes, largest).run()

        def prior(members) -> float:
            places = [len(causes[name]) for name, _ in members]
            # A discrepancy that is not listed counts as one size more.
            return log_prior(len(members), largest + 1, len(causes), places)

        named = {tuple(searched[place] for place in c.members): c for c in found if c.members}
        ranked = sorted(named, key=lambda m: -named[m].log_evidence - prior(m))
        if ranked:
            limit = named[ranked[0]].log_evidence + prior(ranked[0]) - LEADING_MARGIN
            leading = [m for m in ranked[:LEADERS] if named[m].log_evidence + prior(m) >= limit]
            # What a larger set is for is seen beside the smaller ones that it holds.
            for whole in ranked[:MOST_SAMPLED]:
                leading += [m for m in named if set(m) < set(whole)]
            leading += [*without_each(ranked[0], ranked), *of_each_size(ranked)]
            if not detected:
                leading = ranked
        else:
            leading = []
        at, sets = everything.psi.start, []
        for members in dict.fromkeys(leading):
            candidate = named[members]
            psi = candidate.x[[at + place for place in candidate.members]]
            x = torch.cat([candidate.x[:at], psi, candidate.x[everything.psi.stop :]])
            one = self._fitted(members, x, prior(members), reference)
            sets.append(
                {
                    "members": members,
                    "x": one.fit.x[0].tolist(),
                    "log_prior": one.log_prior,
                    "log_evidence": one.log_evidence,
                }
            )
        sets.sort(key=lambda s: -s["log_evidence"] - s["log_prior"])
        return sets, log_prior(0, largest + 1, len(causes))

    def _unlisted(
        self, model: Model, best: Fit, reference: float, detected: bool
    ) -> tuple[float, float]:
        """Log evidence, relative to the base model, of a discrepancy of unknown size: by sampling,
        as that of sets on which something depends, and by Laplace's approximation, as that of sets
        that are not sampled. Where the discrepancy leaves nothing to an inferred noise, the two
        differ by far. A discrepancy that is common to several hearts has the latter alone, and what
        the two differ by where it is another one in each.
        """
        of_each = unlisted_covariance(self.observations, self.emulator)
        of_all = unlisted_pattern(self.observations, self.emulator)
        hearts = Model(self.observations, model.emulator, self.layout)
        sampled, approximated = [], []
        for amplitude in AMPLITUDES:
            other = Model(
                *(self.observations, model.emulator, self.layout),
                discrepancy=amplitude**2 * of_each,
            )
            found, missed = fit_best(other, best.x), 0.0
            logs = [float(log_evidence(other, found)[0])]
            if detected:
                posterior = self._draws(other, found, derive(self.seed, "unlisted", amplitude))
                if not posterior.poor:
                    missed = posterior.log_evidence - logs[0]
            if Together.possible(hearts):
                common = Together(hearts, amplitude**2 * of_all)
                logs.append(float(log_evidence(common, fit_best(common, best.x))[0]))
            approximated += logs
            sampled += [value + missed for value in logs]
        return _mean_of_logs(sampled) - reference, _mean_of_logs(approximated) - reference

    def _model(self, members: Sequence[Member], tails=None, correction=None) -> Model:
        extensions = [self._extensions[at] for at in members]
        emulator = ExtendedEmulator(self.emulator, extensions, correction)
        return Model(self.observations, emulator, self.layout, tails)

    def _fitted(self, members, x, prior: float, reference: float, correction=None) -> CauseSet:
        """A set fitted from `x` (P,), with the covariance of its own emulators.

        reference: log evidence of the base model.
        """
        model = self._model(members, correction=correction)
        found = fit_best(model, x[None])
        evidence = float(log_evidence(model, found)[0]) - reference
        return CauseSet(tuple(members), model, found, evidence, prior)

    # --------------------------------------------------------------------------- confirmation

    def plan(self, searched: Searched, simulations: pd.DataFrame | None, turn: int) -> pd.DataFrame:
        """What to simulate in a round of the confirmation: draws of the leading sets.

        simulations: of the rounds before. A frame without rows if there is nothing to confirm.
        """
        columns = design_columns(self.emulator.parameters.names)
        if not (searched.detected and searched.sets):
            return pd.DataFrame(columns=columns)
        sets = self._weighed(searched, simulations)[0]
        chosen = rivals(sets) if turn < self.settings.rounds else elsewhere(sets)
        rows: list[dict] = []
        for one in chosen[: self.settings.sets]:
            seed = derive(self.seed, "confirmation", turn, label(one.members))
            draws = approximate(one.model, one.fit, self.settings.simulations, seed).x
            rows += design_rows(one.members, one.model, draws)
        return pd.DataFrame(rows, columns=columns)

    def _weighed(self, searched: Searched, simulations: pd.DataFrame | None):
        """The leading sets, corrected by what was simulated of them, with their probabilities, the
        most probable first; and the probabilities of the base model and of what is not listed."""
        sets, reference = [], searched.base_evidence
        tried = set() if simulations is None else set(simulations["set"])
        for row in searched.sets:
            members, x = row["members"], torch.tensor(row["x"], dtype=torch.float64)
            correction = None
            if label(members) in tried:
                correction = correct(self._model(members), members, simulations)
            one = self._fitted(members, x, row["log_prior"], reference, correction)
            one.failed = label(members) in tried and correction is None
            sets.append(one)
        self._expect(sets, [row["log_evidence"] for row in searched.sets])
        return self._probabilities(searched, sets)

    def _expect(self, sets: list[CauseSet], emulated: list[float]) -> None:
        """Give sets without simulations the log evidence that they would have with them, going by
        those that have some. emulated: log evidence of all sets by the emulators."""
        pairs = list(zip(sets, emulated, strict=True))
        simulated = [(s, value) for s, value in pairs if s.correction is not None]
        known = [(s, value) for s, value in simulated if s.confirmed] or simulated
        unknown = [(s, value) for s, value in pairs if s.correction is None]
        if not known:
            return
        best = max(emulated)

        def traits(some: list[tuple[CauseSet, float]]) -> tuple[list[float], list[int]]:
            return [value - best for _, value in some], [len(s.members) for s, _ in some]

        changes = [s.log_evidence - value for s, value in known]
        for (one, _), change in zip(known, changes, strict=True):
            log.info("simulations change %s by %+.1f", label(one.members), change)
        found, asked = Gains.fit(*traits(known), changes), traits(unknown)
        draws = found.draws(*asked, EVIDENCES, derive(self.seed, "evidence"))
        for (one, _), expected, own in zip(unknown, found.expected(*asked), draws.T, strict=True):
            one.log_evidence += float(expected)
            one.uncertain = torch.as_tensor(own)

    def _probabilities(
        self, searched: Searched, sets: list[CauseSet], sampled_base: float | None = None
    ):
        """In the mean over what simulations may say of the sets that have none: a set that is far
        behind by its emulators is not impossible before it is simulated.

        sampled_base: log evidence of the base model, relative to that of the search, if evidence is
        by sampling; None if it is by Laplace's approximation.
        """
        if sampled_base is None:
            others = [0.0, searched.unlisted_approximated]
        else:
            others = [sampled_base, searched.unlisted]
        rest = [evidence + searched.unlisted_prior for evidence in others]
        logs = torch.tensor([*(s.log_posterior for s in sets), *rest], dtype=torch.float64)
        known = torch.zeros(EVIDENCES, dtype=torch.float64)
        changes = [known if s.uncertain is None else s.uncertain for s in sets]
        together = logs + torch.stack([*changes, known, known], dim=1)
        weights = torch.softmax(together, dim=1).mean(0).tolist()
        for one, weight in zip(sets, weights, strict=False):
            one.probability = weight
        # Probabilities next to nothing are all the same.
        sets = sorted(sets, key=lambda s: (-s.probability, -s.log_posterior))
        return sets, weights[-2], weights[-1]

    def _base(self, searched: Searched) -> tuple[Model, Fit]:
        """The base model and its fit."""
        model = self._model(())
        return model, fit_best(model, torch.tensor([searched.base_x], dtype=torch.float64))

    # ----------------------------------------------------------------------------- conclusion

    def conclude(self, searched: Searched, simulations: pd.DataFrame | None = None) -> Criticism:
        """Decide, with the simulations of the leading sets."""
        model, best = self._base(searched)
        base = self._in_earnest(model, best, "base")
        tests = [self._tested(row) for row in searched.tests]
        if not self.testable:
            return Criticism(
                *(self.observations, self.settings, base, searched, tests, []),
                *(math.nan, math.nan),
            )
        sets, nothing, unlisted = self._weighed(searched, simulations)
        if not searched.detected:
            return Criticism(
                *(self.observations, self.settings, base, searched, tests, sets, nothing, unlisted)
            )
        confirmed = [s for s in sets if s.confirmed]
        likely = [s for s in confirmed if s.probability >= LEAST_PROBABILITY] or confirmed[:1]
        for one in likely[:MOST_SAMPLED]:
            one.sampled = self._in_earnest(one.model, one.fit, label(one.members))
        of_base = _by_sampling(searched, sets, base)
        sets, nothing, unlisted = self._probabilities(searched, sets, of_base)
        found = Criticism(
            *(self.observations, self.settings, base, searched, tests, sets, nothing, unlisted),
            simulations=simulations,
        )
        found.best = self._best([s for s in sets if s.confirmed])
        self._sample_others(sets)
        self._last_resort(found, of_base)
        if found.best is not None and found.best.model.tails is None:
            found.name_causes(found.best)
        return found

    def _best(self, confirmed: list[CauseSet]) -> CauseSet | None:
        """The most probable one that fits; if none does that could replace the first, the first."""
        for one in confirmed:
            if one.probability < confirmed[0].probability / 19:
                break
            if one.sampled is None:
                one.sampled = self._in_earnest(one.model, one.fit, label(one.members))
            one.misfit = self._misfit_of(one.sampled, "best")
            if one.fits:
                return one
        return confirmed[0] if confirmed else None

    def _sample_others(self, sets: list[CauseSet]) -> None:
        """Draws of the other probable sets: what an estimate is depends on which causes are there
        beside it."""
        for one in sets:
            if one.sampled is None and one.probability >= LEAST_PROBABILITY:
                seed = derive(self.seed, "sampled", label(one.members))
                one.draws = self._draws(one.model, one.fit, seed)

    def _draws(self, model: Model, best: Fit, seed: int) -> Posterior:
        if not self._sampling:
            return approximate(model, best, self.settings.draws, seed)
        return sample(model, *laplace(model, best), self.settings.draws, seed)

    def _in_earnest(self, model: Model, best: Fit, name: str) -> Sampled:
        seed, draws = derive(self.seed, "sampled", name), self.settings.draws
        posterior = self._draws(model, best, seed)
        if self._sampling:
            left_out = leave_out(posterior, draws, derive(seed, "left out"))
        else:
            left_out = leave_out_linearly(model, best)
        log.info(
            "%s: log evidence %.2f, %.0f effective draws, elpd %.2f, %.0f %% of folds sampled anew",
            name,
            *(posterior.log_evidence, posterior.ess, left_out.elpd.sum(), 100 * left_out.repeated),
        )
        return Sampled(model, best, posterior, left_out)

    def _misfit_of(self, sampled: Sampled, name: str) -> score.Misfit | None:
        """The test of a set's model; None where there are too few channels for one."""
        if int(self.observations.present.sum()) <= len(sampled.model.low):
            return None
        observed = score.statistics(sampled.model, sampled.fit, [])
        null = score.bootstrap(
            *(sampled.model, sampled.fit, [], self.settings.bootstrap),
            derive(self.seed, "misfit", name),
        )
        return score.judge_misfit(observed, null)

    def _last_resort(self, found: Criticism, of_base: float | None) -> None:
        """Heavy tails explain anything: they are taken only where no set of physical causes fits,
        where few channels stand alone far off, and where they are as certain, beside everything
        else, as any cause that is named.

        of_base: as of `_by_sampling`.
        """
        # The tails are one coordinate more, and have to be sampled.
        if found.adequate or not self._sampling:
            return
        searched, base = found.searched, found.base
        testable = {t.name for t in found.tests if t.identified.identifiable}
        for hypothesis in self.noises:
            if hypothesis.name not in testable:
                continue
            model, old = self._model((), hypothesis), base.fit
            model.settle(old.x[0])
            at = model.tail
            middle = (model.low[at] + model.high[at])[None] / 2
            x = torch.cat([old.x[0, :at], middle, old.x[0, at:]])[None]
            start = Fit(x, old.objective, old.residual, old.jacobian, old.whitening)
            sampled = self._in_earnest(model, start, hypothesis.name)
            found.outliers = outliers.why_not(sampled)
            if found.outliers or sampled.posterior.poor:
                continue
            evidence = sampled.posterior.log_evidence - base.posterior.log_evidence
            prior = searched.unlisted_prior - math.log(max(searched.causes, 1))
            tails = CauseSet(
                *(((hypothesis.name, ""),), model, start, evidence + (of_base or 0.0), prior),
                sampled=sampled,
            )
            found.sets, found.base_probability, found.unlisted_probability = self._probabilities(
                searched, [*found.sets, tails], of_base
            )
            if tails.probability >= PROBABILITY:
                found.best, found.named = tails, [hypothesis.name]

    def _tested(self, row: dict) -> Tested:
        at = (row["name"], row["component"])
        known = self._extensions.get(at)
        hypothesis = known.hypothesis if known else _by_name(self.noises, row["name"])
        share = float(known.fraction_simulated) if known else 1.0
        own = Identified(**row["identified"])
        return Tested(
            *(hypothesis, row["component"], row["z"], row["p_single"], row["p_value"], own, share)
        )


def _by_sampling(searched: Searched, sets: list[CauseSet], base: Sampled) -> float | None:
    """Give all sets the log evidence by sampling, and return that of the base model; None where no
    set has been sampled well, so that all evidence is by Laplace's approximation."""
    found = {
        s.members: s.sampled.posterior.log_evidence - searched.base_evidence - s.log_evidence
        for s in sets
        if s.sampled is not None and not s.sampled.posterior.poor
    }
    if not found:
        return None
    # What sampling finds and Laplace's approximation misses is much the same in all sets.
    mean = sum(found.values()) / len(found)
    for one in sets:
        one.log_evidence += found.get(one.members, mean)
    if base.posterior.poor:
        return mean
    return base.posterior.log_evidence - searched.base_evidence


def _row(at: Member, z: float, p: tuple[float, float], identified: Identified) -> dict:
    return {
        "name": at[0],
        "component": at[1],
        "z": z,
        "p_single": p[0],
        "p_value": p[1],
        "identified": asdict(identified),
    }


def _by_name(hypotheses, name: str):
    return next(h for h in hypotheses if h.name == name)


def _mean_of_logs(logs: list[float]) -> float:
    values = torch.tensor(logs, dtype=torch.float64)
    return float(torch.logsumexp(values, 0) - math.log(len(logs)))
