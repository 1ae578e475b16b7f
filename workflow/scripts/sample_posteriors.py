"""Sample the posteriors of one batch of test cases."""

import torch

from regional_lv.inference import sample_test_batch
from regional_lv.progress import start_log

start_log(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
sample_test_batch(
    snakemake.input.emulator,
    snakemake.input.test,
    snakemake.params.first,
    snakemake.params.last,
    snakemake.params.sampler,
    snakemake.params.nuts,
    snakemake.params.map,
    snakemake.params.seed,
    snakemake.output[0],
)
