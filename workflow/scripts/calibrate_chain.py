"""Simulation-based calibration of the inference."""

import torch

from regional_lv.inference.calibration import calibrate_chain
from regional_lv.progress import start_log

start_log(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
calibrate_chain(
    snakemake.input.emulator,
    snakemake.input.simulations,
    snakemake.params.cases,
    snakemake.params.sampler,
    snakemake.params.nuts,
    snakemake.params.map,
    snakemake.params.seed,
    snakemake.output.ranks,
    snakemake.output.histogram,
    snakemake.output.tests,
)
