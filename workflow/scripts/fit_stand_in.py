"""Fit what stands in for the simulator of finished simulations."""

import torch

from regional_lv.estimates.stand_in import fit_stand_in
from regional_lv.progress import start_log

start_log(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
fit_stand_in(
    snakemake.input.train,
    snakemake.input.test,
    *snakemake.params.bounds,
    snakemake.params.seed,
    snakemake.output[0],
)
