"""From a measured file to the posterior averaged over models."""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from regional_lv import emulators
from regional_lv.errors import InputError
from regional_lv.inference.averaging import Averaged, average
from regional_lv.inference.hearts import potential_of_tables, stiffness_of
from regional_lv.inference.potential import Potential
from regional_lv.inference.sampling import write
from regional_lv.input_files import reading
from regional_lv.inputs.space import Inputs
from regional_lv.measured import read_measured
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

DRAWS = 4000
"""Of the average, in its file."""


def potential_of(
    emulator_file: str | Path,
    measured: Sequence[str | Path],
    subjects: Sequence[str],
    physics: Mapping,
    noise_prior_scale: float,
    known_theta: Sequence[str | Path] = (),
) -> Potential:
    """The posterior of all models of measured files, of one heart or of several with the same
    causes.

    emulator_file: over all inputs. measured: files of `subjects`. physics: what
    `inputs.space.sections_of` gives. noise_prior_scale: as for `sampling.sample_subject`.
    known_theta: tables of the stiffness of all subjects (`read_known_theta`), which is known but
    for common factors then.

    Raises InputError if a file cannot be used.
    """
    inputs = Inputs.from_config(physics)
    emulator = emulators.load(emulator_file)
    tables = {
        subject: read_measured(path, emulator.channels, strain_exponent=None)
        for subject, path in zip(subjects, measured, strict=True)
    }
    known = None
    if known_theta:
        names = [each.name for each in stiffness_of(inputs).values()]
        known = read_known_theta(known_theta, subjects, names)
    return potential_of_tables(emulator, inputs, tables, noise_prior_scale, known)


def read_known_theta(
    paths: Sequence[str | Path], subjects: Sequence[str], names: Sequence[str]
) -> pd.DataFrame:
    """Known values by subject and by the `names` of stiffness factors, from tables (CSV) with the
    column `subject` and one for each of them.

    Raises InputError for a missing column or subject, and for a value that is no positive number.
    """
    tables = []
    for path in paths:
        with reading(path, "check the path, and save it as CSV in UTF-8"):
            table = pd.read_csv(path, dtype={"subject": str})
        missing = [column for column in ("subject", *names) if column not in table]
        if missing:
            raise InputError(f"{path}: no column {', '.join(missing)}; add what is missing")
        tables.append(table.set_index("subject")[list(names)])
    values = pd.concat(tables)
    where = ", ".join(map(str, paths[:3]))
    absent = [s for s in subjects if s not in values.index]
    if absent:
        raise InputError(f"{where}: no row for {', '.join(absent)}; add a row for each subject")
    values = values[~values.index.duplicated()].loc[[*subjects]]
    numbers = values.apply(pd.to_numeric, errors="coerce")
    wrong = ~((numbers > 0) & np.isfinite(numbers))
    for subject, column in wrong.stack()[lambda each: each].index:
        raise InputError(
            f"{where}, row {subject}: {column} is {values.loc[subject, column]}, no finite number "
            "above zero; correct it"
        )
    return numbers


def average_subject(
    emulator_file: str | Path,
    measured: str | Path | Sequence[str | Path],
    subject: str,
    physics: Mapping,
    noise_prior_scale: float,
    largest: int,
    seed: int,
    posterior: str | Path,
    table: str | Path,
    subjects: Sequence[str] = (),
    known_theta: Sequence[str | Path] = (),
) -> None:
    """Average the posterior of measured files over all sets of suspected inputs up to the
    `largest`; write its draws (NetCDF, `Averaged.inference_data`) and `Averaged.table` (CSV).

    subject: a heart, or a name for several `subjects`. seed: the study's. Other arguments and
    errors as for `potential_of`.
    """
    files = [measured] if isinstance(measured, str | Path) else measured
    potential = potential_of(
        *(emulator_file, files, subjects or (subject,), physics, noise_prior_scale, known_theta)
    )
    own = derive(seed, "average", subject)
    averaged: Averaged = average(potential, largest, own)
    log.info(
        "%s: %d models; the model as it is has the probability %.3g",
        *(subject, len(averaged.models), averaged.probability[averaged.base]),
    )
    write(averaged.inference_data(DRAWS, own), posterior)
    averaged.table().to_csv(table)
