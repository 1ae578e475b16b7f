"""Estimate the parameters of the test set by one emulator."""

import torch

from regional_lv.estimates.estimate import estimate_parameters
from regional_lv.progress import start_log

start_log(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
estimate_parameters(
    snakemake.input.emulator,
    snakemake.input.test,
    **snakemake.params.map,
    **snakemake.params.estimates,
    seed=snakemake.params.seed,
    estimates=snakemake.output[0],
)
