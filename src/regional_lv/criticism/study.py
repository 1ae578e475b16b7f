"""From the files of a study to the findings of a subject."""

import json
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import torch

from regional_lv.criticism.contract import Findings
from regional_lv.criticism.critic import Critic
from regional_lv.criticism.designs import read_simulated
from regional_lv.criticism.discretisation import load_emulator
from regional_lv.criticism.extension import read_extensions
from regional_lv.criticism.findings import findings_of, write_findings
from regional_lv.criticism.hypotheses import NoiseHypothesis
from regional_lv.criticism.observations import observe
from regional_lv.criticism.verdict import Criticism, Searched, Settings
from regional_lv.emulators.base import Emulator
from regional_lv.errors import InputError
from regional_lv.input_files import reading
from regional_lv.jobs import passes_on
from regional_lv.measured import read_measured
from regional_lv.seeds import derive

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Inputs:
    """Measured tables by subject, the emulators, and how to criticise."""

    name: str
    tables: dict[str, pd.DataFrame]
    emulator: Emulator
    extensions: list
    noises: list
    settings: Settings
    strain_exponent: float
    noise_prior_scale: float
    seed: int
    known_theta: torch.Tensor | None = None

    def critic(self) -> Critic:
        observations = observe(self.tables, self.emulator, self.noise_prior_scale)
        return Critic(
            *(observations, self.emulator, self.extensions, self.noises),
            *(self.settings, self.seed, self.known_theta),
        )

    def findings(self, criticism: Criticism) -> Findings:
        return findings_of(
            *(self.name, criticism, self.emulator, self.extensions, self.tables),
            self.strain_exponent,
        )


def read_critic(
    subject: str,
    emulator: str | Path,
    extensions: Sequence[str | Path],
    subjects: Sequence[str],
    measured: Sequence[str | Path],
    settings: dict,
    strain_exponent: float,
    noise_prior_scale: float,
    seed: int,
    known_theta: Sequence[str | Path] = (),
    discretisation: str | Path | Sequence[str] = (),
) -> Inputs:
    """What all steps of the criticism read.

    subject: name of the subject, or of the joint criticism. subjects, measured: whose files they
    are, and the files. settings: section `criticism` of the config. strain_exponent: of the study's
    strain measure. known_theta: tables (CSV) with `subject` and the parameters, for hearts whose
    theta is known up to a common number for each factor of the material. discretisation: file of
    `discretisation.train_discretisation`, or nothing.

    Raises InputError for files that cannot be used, before anything is fitted.
    """
    tables = {
        name: read_measured(path, strain_exponent=strain_exponent)
        for name, path in zip(subjects, measured, strict=True)
    }
    trained = load_emulator(emulator, discretisation)
    names = trained.parameters.names
    theta = read_known_theta(known_theta, list(subjects), names) if known_theta else None
    changing, noises = split(read_extensions(extensions))
    return Inputs(
        *(subject, tables, trained, changing, noises),
        *(Settings.from_config(settings), strain_exponent, noise_prior_scale),
        *(derive(seed, "criticism", subject), theta),
    )


@passes_on(read_critic)
def search_causes(search: str | Path, **inputs) -> None:
    """Test the base model and search for sets of causes; write what was found (JSON).

    inputs: as of `read_critic`.
    """
    searched = read_critic(**inputs).critic().search()
    Path(search).write_text(json.dumps(searched.content()) + "\n")


@passes_on(read_critic)
def plan_confirmation(
    search: str | Path,
    turn: str,
    design: str | Path,
    simulations: Sequence[str | Path] = (),
    **inputs,
) -> None:
    """Write what a round of the confirmation has to simulate (Parquet).

    turn: number of the round. simulations: of the rounds before. inputs: as of `read_critic`.
    """
    critic = read_critic(**inputs).critic()
    rows = critic.plan(_searched(search), _simulated(simulations), int(turn))
    rows.to_parquet(design, index=False)


@passes_on(read_critic)
def conclude_criticism(
    search: str | Path, simulations: Sequence[str | Path], findings: str | Path, **inputs
) -> None:
    """Decide with the simulations of all rounds, and write the findings (JSON).

    inputs: as of `read_critic`.
    """
    given = read_critic(**inputs)
    criticism = given.critic().conclude(_searched(search), _simulated(simulations))
    content = given.findings(criticism)
    write_findings(content, findings)
    for sentence in content["words"]:
        log.info("%s", sentence)


def criticise(inputs: Inputs, simulate: Callable[[pd.DataFrame], pd.DataFrame] | None) -> Findings:
    """The findings, all steps at once.

    simulate: makes the outputs of a design, as `injection.simulate_design` does; without it nothing
    is confirmed, and nothing named.
    """
    critic = inputs.critic()
    searched = critic.search()
    made: list[pd.DataFrame] = []
    while simulate and len(made) < inputs.settings.turns:
        design = critic.plan(searched, _together(made), len(made))
        if design.empty:
            break
        made.append(simulate(design))
    return inputs.findings(critic.conclude(searched, _together(made)))


def _searched(path: str | Path) -> Searched:
    return Searched.of(json.loads(Path(path).read_text()))


def _simulated(paths: Sequence[str | Path]) -> pd.DataFrame | None:
    return _together([read_simulated(path) for path in paths])


def _together(tables: list[pd.DataFrame]) -> pd.DataFrame | None:
    tables = [table for table in tables if len(table)]
    return pd.concat(tables, ignore_index=True) if tables else None


def split(extensions) -> tuple[list, list]:
    """Extensions that change the outputs, and hypotheses that change the noise."""
    noises = [e.hypothesis for e in extensions if isinstance(e.hypothesis, NoiseHypothesis)]
    changing = [e for e in extensions if not isinstance(e.hypothesis, NoiseHypothesis)]
    return changing, noises


def read_known_theta(
    paths: Sequence[str | Path], subjects: list[str], parameters: Sequence[str]
) -> torch.Tensor:
    """Theta (S, P) of `subjects`, from tables with `subject` and the `parameters` (P names).

    Raises InputError for a missing column or subject, or for a value that is no positive number.
    """
    tables = []
    for path in paths:
        with reading(path, "check the path, and save it as CSV in UTF-8"):
            table = pd.read_csv(path, dtype={"subject": str})
        missing = [c for c in ("subject", *parameters) if c not in table]
        if missing:
            raise InputError(f"{path}: no column {', '.join(missing)}; add what is missing")
        tables.append(table.set_index("subject")[list(parameters)])
    values = pd.concat(tables)
    where = ", ".join(map(str, paths[:3]))
    absent = [s for s in subjects if s not in values.index]
    if absent:
        raise InputError(f"{where}: no row for {', '.join(absent)}; add a row for each subject")
    values = values[~values.index.duplicated()].loc[subjects]
    for subject, row in values.iterrows():
        numbers = pd.to_numeric(row, errors="coerce")
        if not numbers.between(0, float("inf"), inclusive="neither").all():
            raise InputError(
                f"{where}, row {subject}: a parameter is no finite number above zero; correct it"
            )
    return torch.as_tensor(values.to_numpy(float))
