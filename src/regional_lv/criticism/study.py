"""From the files of a study to the findings of a subject."""

import logging
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import torch

from regional_lv import emulators
from regional_lv.criticism.extension import read_extensions
from regional_lv.criticism.findings import findings_of, write_findings
from regional_lv.criticism.hypotheses import NoiseHypothesis
from regional_lv.criticism.observations import observe
from regional_lv.criticism.verdict import Criticism, Settings, criticise
from regional_lv.errors import InputError
from regional_lv.measured import read_measured
from regional_lv.seeds import derive

log = logging.getLogger(__name__)


def criticise_files(
    subject: str,
    emulator: str | Path,
    extensions: Sequence[str | Path],
    subjects: Sequence[str],
    measured: Sequence[str | Path],
    settings: dict,
    strain_exponent: float,
    noise_prior_scale: float,
    seed: int,
    findings: str | Path,
    known_theta: Sequence[str | Path] = (),
) -> None:
    """Criticise the base model on one measured file, or on several together; write the findings.

    subject: name of the subject, or of the joint criticism. subjects, measured: whose files they
    are, and the files. settings: section `criticism` of the config. strain_exponent: of the study's
    strain measure. known_theta: tables (CSV) with `subject` and the parameters, for hearts whose
    theta is known up to a common number for each factor of the material.

    Raises InputError for files that cannot be used, before anything is fitted.
    """
    tables = {
        name: read_measured(path, strain_exponent=strain_exponent)
        for name, path in zip(subjects, measured, strict=True)
    }
    trained = emulators.load(emulator)
    names = trained.parameters.names
    theta = read_known_theta(known_theta, list(subjects), names) if known_theta else None
    changing, noises = split(read_extensions(extensions))
    content, _ = criticise_tables(
        *(subject, tables, trained, changing, noises),
        Settings.from_config(settings),
        *(noise_prior_scale, derive(seed, "criticism", subject), theta),
    )
    write_findings(content, findings)
    for sentence in content["words"]:
        log.info("%s", sentence)


def criticise_tables(
    name: str,
    tables: dict[str, pd.DataFrame],
    emulator,
    extensions,
    noises,
    settings: Settings,
    noise_prior_scale: float,
    seed: int,
    known_theta: torch.Tensor | None = None,
) -> tuple[dict, Criticism]:
    """Findings, and the criticism they come from, of measured tables by subject."""
    observations = observe(tables, emulator, noise_prior_scale)
    criticism = criticise(observations, emulator, extensions, noises, settings, seed, known_theta)
    return findings_of(name, criticism, emulator, extensions, tables), criticism


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
        try:
            table = pd.read_csv(path, dtype={"subject": str})
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: cannot be read ({error}); check the path") from error
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
        if not (pd.to_numeric(row, errors="coerce") > 0).all():
            raise InputError(f"{where}, row {subject}: a parameter is not above zero; correct it")
    return torch.as_tensor(values.to_numpy(float))
