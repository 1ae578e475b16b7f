"""Sample the posteriors of one batch of simulated cases."""

import torch

from regional_lv.inference.sampling import sample_set_batch
from regional_lv.progress import start_log

start_log(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
sample_set_batch(
    snakemake.input.emulator,
    snakemake.input.simulations,
    snakemake.wildcards.set,
    int(snakemake.wildcards.batch),
    snakemake.params.batches,
    snakemake.params.cases,
    snakemake.params.noise,
    snakemake.params.sampler,
    snakemake.params.nuts,
    snakemake.params.map,
    snakemake.params.seed,
    snakemake.output[0],
)
