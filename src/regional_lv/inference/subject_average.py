"""From a measured file to the posterior averaged over models."""

import logging
from collections.abc import Mapping
from pathlib import Path

import torch

from regional_lv import emulators
from regional_lv.inference.averaging import Averaged, average
from regional_lv.inference.departure import departure_covariance
from regional_lv.inference.emulated import EmulatedInputs
from regional_lv.inference.likelihood import Noise
from regional_lv.inference.potential import Potential
from regional_lv.inference.sampling import write
from regional_lv.inputs.space import Inputs
from regional_lv.measured import read_measured
from regional_lv.seeds import derive

log = logging.getLogger(__name__)

DRAWS = 4000
"""Of the average, in its file."""


def potential_of(
    emulator_file: str | Path,
    measured: str | Path,
    physics: Mapping,
    noise_prior_scale: float,
) -> Potential:
    """The posterior of all models of a measured file.

    emulator_file: over all inputs. physics: what `inputs.space.sections_of` gives.
    noise_prior_scale: as for `sampling.sample_subject`.

    Raises InputError if the measured file cannot be used.
    """
    inputs = Inputs.from_config(physics)
    emulator = emulators.load(emulator_file)
    table = read_measured(measured, emulator.channels, strain_exponent=None).set_index("output")
    names = [name for name in emulator.outputs if name in table.index]
    table, emulator = table.loc[names], emulator.select(names)
    noise = Noise.of_subject(emulator, table["sd"], noise_prior_scale)
    departure = departure_covariance(emulator.channels, emulator.output_sd.numpy())
    y = torch.as_tensor(table["value"].to_numpy(float))
    return Potential(EmulatedInputs(emulator, inputs), inputs, y, noise, departure)


def average_subject(
    emulator_file: str | Path,
    measured: str | Path,
    subject: str,
    physics: Mapping,
    noise_prior_scale: float,
    largest: int,
    seed: int,
    posterior: str | Path,
    table: str | Path,
) -> None:
    """Average the posterior of a measured file over all sets of suspected inputs up to the
    `largest`; write its draws (NetCDF, `Averaged.inference_data`) and `Averaged.table` (CSV).

    seed: the study's. Other arguments and errors as for `potential_of`.
    """
    potential = potential_of(emulator_file, measured, physics, noise_prior_scale)
    own = derive(seed, "average", subject)
    averaged: Averaged = average(potential, largest, own)
    log.info(
        "%s: %d models; the model as it is has the probability %.3g",
        *(subject, len(averaged.models), averaged.probability[averaged.base]),
    )
    write(averaged.inference_data(DRAWS, own), posterior)
    averaged.table().to_csv(table)
