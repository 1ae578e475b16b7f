"""Fit one emulator to the training simulations."""

import torch

from regional_lv.emulators import train_emulator
from regional_lv.progress import start_log

start_log(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
train_emulator(
    snakemake.params.name,
    snakemake.params.settings,
    snakemake.input.train,
    *snakemake.params.bounds,
    snakemake.params.seed,
    snakemake.output.emulator,
    snakemake.output.report,
)
