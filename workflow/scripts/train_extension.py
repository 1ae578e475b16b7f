"""Learn what one hypothesis changes."""

import torch

from regional_lv.criticism.extension import train_extension
from regional_lv.criticism.hypotheses import REGISTRY
from regional_lv.progress import start_log

start_log(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
train_extension(
    REGISTRY[snakemake.wildcards.hypothesis].for_study(snakemake.params.physics),
    snakemake.input.batches,
    snakemake.params.bounds,
    snakemake.params.seed,
    snakemake.output.extension,
    snakemake.output.report,
)
