"""Compare emulator and simulator at posterior draws."""

import torch

from regional_lv.inference.resimulation import compare_resimulated
from regional_lv.progress import start_log

start_log(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
compare_resimulated(
    snakemake.input.emulator,
    snakemake.input.simulations,
    snakemake.input.test,
    snakemake.output.table,
    snakemake.output.summary,
)
