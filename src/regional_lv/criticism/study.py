"""From measured hearts to a verdict: search, confirmation, conclusion."""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import cast

import numpy as np
import pandas as pd
import torch

from regional_lv import emulators
from regional_lv.channels import Channels
from regional_lv.criticism import confirmation, outliers
from regional_lv.criticism.confirmation import Conditionable, Round, conditioned
from regional_lv.criticism.contract import Findings
from regional_lv.criticism.findings import Context, findings_of, write_findings
from regional_lv.criticism.identifiable import absorbed_inputs
from regional_lv.criticism.left_out import left_out
from regional_lv.criticism.linear_model import LinearModel
from regional_lv.criticism.misfit import test
from regional_lv.criticism.verdict import Examined, Verdict
from regional_lv.emulators.base import Emulator
from regional_lv.inference.averaging import DRAWS, Averaged, average
from regional_lv.inference.departure import noise_units
from regional_lv.inference.emulated import EmulatedInputs, InputEmulator
from regional_lv.inference.hearts import potential_of_tables, read_known_theta, stiffness_of
from regional_lv.inference.posteriors import write
from regional_lv.inference.potential import Potential
from regional_lv.inference.sets import fit_base
from regional_lv.inputs.space import Inputs
from regional_lv.measured import read_measured
from regional_lv.quantities.seth_hill import Measure
from regional_lv.seeds import derive
from regional_lv.study.jobs import passes_on

log = logging.getLogger(__name__)

KEPT = 4000
"""Draws of the posterior in its file."""

PLANNING = 500
"""Draws of a round of sampling, of a posterior that says where to simulate."""

EXAMINED = 4
"""Of the leading models, those that are tested in any case."""


@dataclass(frozen=True)
class Settings:
    """bootstrap: replicates of the tests. level: of the test whether anything is wrong.
    largest_set: causes in a set, at most. confirmation: its settings. load_fractions: at which the
    heart could be imaged to tell causes apart. noise_prior_scale: of inferred noise scales.
    strain_exponent, line_share: of the study's strain measure."""

    bootstrap: int
    level: float
    largest_set: int
    confirmation: confirmation.Settings
    load_fractions: tuple[float, ...]
    noise_prior_scale: float
    strain_exponent: float
    line_share: float

    @classmethod
    def from_config(cls, section: Mapping) -> "Settings":
        """From what `settings.settings_of` gives."""
        own = {key: section[key] for key in cls.__dataclass_fields__}
        own["confirmation"] = confirmation.Settings(**section["confirmation"])
        return cls(**own | {"load_fractions": tuple(section["load_fractions"])})


@dataclass(frozen=True)
class Concluded:
    """Verdict and findings, and what was simulated for them, round by round."""

    verdict: Verdict
    findings: Findings
    rounds: Sequence[pd.DataFrame]


class Critic:
    """Criticises one heart, or several together.

    Parameters
    ----------
    name: of the subject, or of the joint criticism. tables: measured, by heart (`read_measured`).
    emulator: over all inputs and all that the study observes; `Conditionable`, if anything is
        simulated. physics: what `inputs.space.sections_of` gives. seed: the study's.
    known_theta: by heart and factor, of hearts whose factors are known but for a common number
        each. left_out: names of inputs at their nominal values in every model. observed: channels
        of the study, if the emulator has those alone that were measured.
    """

    def __init__(
        self,
        name: str,
        tables: Mapping[str, pd.DataFrame],
        emulator: InputEmulator,
        physics: Mapping,
        settings: Settings,
        seed: int,
        known_theta: pd.DataFrame | None = None,
        left_out: Sequence[str] = (),
        observed: Channels | None = None,
    ):
        self.name, self.tables, self.emulator = name, dict(tables), emulator
        self.observed = observed or emulator.channels
        self.inputs = Inputs.from_config(physics).fixing(left_out)
        self.settings, self.known_theta = settings, known_theta
        self.seed = derive(seed, "criticism", name)

    def potential(self, emulator: InputEmulator) -> Potential:
        """The posterior of all models, by an emulator."""
        return potential_of_tables(
            emulator, self.inputs, self.tables, self.settings.noise_prior_scale, self.known_theta
        )

    @cached_property
    def _outputs(self) -> list[str]:
        """Measured in any of the hearts."""
        measured = set().union(*(table["output"] for table in self.tables.values()))
        return [name for name in self.emulator.outputs if name in measured]

    @cached_property
    def _noise_sd(self) -> np.ndarray:
        """Of the measured outputs, the least of all hearts; a good measurement's where none of them
        says."""
        emulator = self.emulator.select(self._outputs)
        good = pd.Series(
            noise_units(emulator.channels, emulator.output_sd.numpy()), index=self._outputs
        )
        sds = pd.concat([table.set_index("output")["sd"] for table in self.tables.values()])
        known = sds.groupby(level=0).min().reindex(self._outputs)
        return known.fillna(good).to_numpy(float)

    def _knowing(self, rounds: Sequence[pd.DataFrame]) -> tuple[InputEmulator, list[Round]]:
        """`conditioned` on the simulations of some rounds."""
        if not rounds:
            return self.emulator, []
        return conditioned(cast(Conditionable, self.emulator), rounds, self._outputs)

    def plan(self, rounds: Sequence[pd.DataFrame]) -> pd.DataFrame:
        """What to simulate after some rounds; no rows where that was enough."""
        emulator, found = self._knowing(rounds)
        if found and found[-1].agrees(self._noise_sd):
            return pd.DataFrame(columns=["sample", "set", *emulator.coordinates.names])
        return self.plan_of(self._average(self.potential(emulator), PLANNING), len(rounds))

    def plan_of(self, averaged: Averaged, number: int) -> pd.DataFrame:
        """What to simulate in a round, of the models that lead an average."""
        seed = derive(self.seed, "round", number)
        return confirmation.plan(averaged, self.settings.confirmation, seed)

    def conclude(self, rounds: Sequence[pd.DataFrame], has_simulator: bool = True) -> Concluded:
        """Decide with the simulations of all rounds."""
        emulator, found = self._knowing(rounds)
        potential = self.potential(emulator)
        averaged = self._average(potential, DRAWS)
        confirmed = _confirmed(averaged, found, self._noise_sd) if has_simulator else None
        verdict = Verdict.of(averaged, self._examine(averaged), self.settings.level, confirmed)
        context = Context(
            subject=self.name,
            tables=self.tables,
            emulated=EmulatedInputs(emulator, self.inputs),
            observed=self.observed,
            rounds=found,
            outputs=self._outputs,
            noise_sd=self._noise_sd,
            bootstrap=self.settings.bootstrap,
            load_fractions=self.settings.load_fractions,
            measure=Measure(self.settings.strain_exponent, self.settings.line_share),
        )
        return Concluded(verdict, findings_of(verdict, context), rounds)

    def _average(self, potential: Potential, draws: int) -> Averaged:
        """Over what the data can tell of."""
        base = fit_base(potential, self.seed)
        identifiable = potential.without(absorbed_inputs(LinearModel.of(potential, base)))
        return average(identifiable, self.settings.largest_set, self.seed, draws, base)

    def _examine(self, averaged: Averaged) -> dict[int, Examined]:
        """The model as it is and the most probable others, as many of these until one fits."""
        first = next((n for n in averaged.drawn if averaged.models[n].members), None)
        chosen = [averaged.base, *averaged.leading[:EXAMINED], *([] if first is None else [first])]
        found = {n: self._examined(averaged, n) for n in sorted(set(chosen))}
        for n in averaged.leading:
            if any(map(Verdict(averaged, found, self.settings.level, None).passes, found)):
                break
            if n not in found:
                found[n] = self._examined(averaged, n)
        return dict(sorted(found.items()))

    def _examined(self, averaged: Averaged, number: int) -> Examined:
        fitted = averaged.models[number].fit
        assert fitted is not None
        potential = averaged.potential
        linear = LinearModel.of(potential, fitted)
        model = averaged.models[number]
        tested = test(
            linear,
            potential.suspected if number == averaged.base else (),
            self.settings.bootstrap,
            derive(self.seed, "bootstrap", averaged.names[number]),
        )
        why_not = ""
        if potential.tails in model.members:
            why_not = outliers.why_not(outliers.standardised(potential, fitted), potential.observed)
        return Examined(linear, tested, left_out(linear), why_not)


def _confirmed(averaged: Averaged, rounds: Sequence[Round], noise_sd) -> frozenset[int]:
    """Models of which there are enough simulations, if those of the last round agree."""
    known = [r for r in rounds if len(r.simulations)]
    if not known or not known[-1].agrees(noise_sd):
        return frozenset()
    counts = pd.concat([r.simulations["set"] for r in known]).value_counts()
    return frozenset(
        n for n, name in enumerate(averaged.names) if counts.get(name, 0) >= confirmation.FEWEST
    )


def criticise(critic: Critic, simulate: Callable[[pd.DataFrame], pd.DataFrame] | None) -> Concluded:
    """All steps at once.

    simulate: makes what a plan asks for, as `confirmation.Simulate` does; without it nothing is
    confirmed.
    """
    rounds: list[pd.DataFrame] = []
    most = critic.settings.confirmation.rounds
    while True:
        while simulate and len(rounds) < most:
            design = critic.plan(rounds)
            if design.empty:
                break
            rounds.append(simulate(design))
        concluded = critic.conclude(rounds, simulate is not None)
        # What was simulated can bring forward a set that was not.
        if not simulate or len(rounds) >= most or not concluded.verdict.leads_unconfirmed:
            return concluded
        rounds.append(simulate(critic.plan_of(concluded.verdict.averaged, len(rounds))))


# ---------------------------------------------------------------------------------- from files


def read_critic(
    subject: str,
    emulator_file: str | Path,
    subjects: Sequence[str],
    measured: Sequence[str | Path],
    physics: Mapping,
    settings: Mapping,
    seed: int,
    known_theta: Sequence[str | Path] = (),
) -> Critic:
    """What all steps of the criticism read.

    subject: name of the subject, or of the joint criticism. emulator_file: of the inputs that are
    simulated. subjects, measured: whose files they are, and the files. settings: as of
    `Settings.from_config`. known_theta: tables (CSV) with `subject` and the parameters. Raises
    InputError for files that cannot be used.
    """
    emulator = emulators.load(emulator_file)
    return critic_of(emulator, subject, subjects, measured, physics, settings, seed, known_theta)


def critic_of(
    emulator: InputEmulator,
    subject: str,
    subjects: Sequence[str],
    measured: Sequence[str | Path],
    physics: Mapping,
    settings: Mapping,
    seed: int,
    known_theta: Sequence[str | Path] = (),
) -> Critic:
    """As `read_critic`, with an emulator."""
    given = Settings.from_config(settings)
    tables = {
        name: read_measured(path, emulator.channels, strain_exponent=given.strain_exponent)
        for name, path in zip(subjects, measured, strict=True)
    }
    observed = emulator.channels
    if isinstance(emulator, Emulator) and len(tables) == 1:
        emulator = _trained_near(emulator, *tables.values())
    known = None
    if known_theta:
        names = [each.name for each in stiffness_of(Inputs.from_config(physics)).values()]
        known = read_known_theta(known_theta, subjects, names)
    return Critic(subject, tables, emulator, physics, given, seed, known, observed=observed)


def _trained_near(emulator: Emulator, table: pd.DataFrame) -> Emulator:
    """The emulator, or what one that trains anew for every observation makes of this one, for what
    was measured alone."""
    y = table.set_index("output")["value"]
    names = [name for name in emulator.outputs if name in y.index]
    selected = emulator.select(names)
    trained = selected.localise(torch.as_tensor(y.loc[names].to_numpy(float)))
    return emulator if trained is selected else trained


@passes_on(read_critic)
def criticise_subject(
    mesh: str | Path,
    predictor: str | Path,
    simulations: str | Path,
    findings: str | Path,
    posterior: str | Path,
    **inputs,
) -> None:
    """`write_criticism` of `read_critic`."""
    made = simulations, findings, posterior
    write_criticism(read_critic(**inputs), mesh, predictor, inputs["physics"], *made)


@passes_on(read_critic)
def criticise_by_emulator(findings: str | Path, posterior: str | Path, **inputs) -> None:
    """The same without a simulator: nothing is confirmed."""
    critic = read_critic(**inputs)
    write_concluded(critic, criticise(critic, None), findings, posterior)


def write_criticism(
    critic: Critic,
    mesh: str | Path,
    predictor: str | Path,
    physics: Mapping,
    simulations: str | Path,
    findings: str | Path,
    posterior: str | Path,
) -> None:
    """Confirm by simulations and conclude; write these, the findings and the posterior.

    mesh, predictor: the study's, of all inputs. physics: what `inputs.space.sections_of` gives.
    simulations: those of all rounds (Parquet, `batches.tabulate`, and their `round`). findings,
    posterior: of `write_concluded`.
    """
    concluded = criticise(critic, confirmation.Simulate(mesh, physics, predictor))
    made = [table.assign(round=number) for number, table in enumerate(concluded.rounds)]
    pd.concat(made).to_parquet(simulations, index=False)
    write_concluded(critic, concluded, findings, posterior)


def write_concluded(
    critic: Critic, concluded: Concluded, findings: str | Path, posterior: str | Path
) -> None:
    """Write the findings (JSON) and the posterior averaged over models (NetCDF,
    `Averaged.to_datatree`)."""
    write(concluded.verdict.averaged.to_datatree(KEPT, critic.seed), posterior)
    write_findings(concluded.findings, findings)
    for sentence in concluded.findings["words"]:
        log.info("%s", sentence)
