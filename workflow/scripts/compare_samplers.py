"""Sample random test cases by NUTS and compare."""

import torch

from regional_lv.inference.agreement import compare_samplers
from regional_lv.progress import start_log

start_log(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
compare_samplers(
    snakemake.input.emulator,
    snakemake.input.posteriors,
    snakemake.params.cases,
    snakemake.params.nuts,
    snakemake.params.map,
    snakemake.params.seed,
    snakemake.output[0],
)
