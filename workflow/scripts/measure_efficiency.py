"""Errors of one emulator against the number of simulations."""

import torch

from regional_lv.estimates.efficiency import measure_efficiency
from regional_lv.progress import start_log

start_log(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
measure_efficiency(
    snakemake.wildcards.emulator,
    snakemake.params.settings | {"input_transform": snakemake.wildcards.transform},
    snakemake.input.train,
    snakemake.input.test,
    snakemake.params.sizes,
    snakemake.params.most_with_sensitivities,
    snakemake.params.bounds,
    snakemake.params.map,
    snakemake.params.seed,
    snakemake.output[0],
)
