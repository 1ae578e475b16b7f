"""Criticise a batch of hearts with hidden effects."""

import torch

from regional_lv.criticism.benchmark import criticise_benchmark
from regional_lv.progress import start_log

start_log(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
criticise_benchmark(
    snakemake.input.subjects,
    snakemake.params.first,
    snakemake.params.last,
    snakemake.input.emulator,
    snakemake.input.extensions,
    snakemake.params.settings,
    snakemake.params.noise_prior_scale,
    snakemake.params.seed,
    snakemake.output[0],
)
