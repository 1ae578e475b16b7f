"""Time one emulator."""

import torch

from regional_lv.estimates.estimate import measure_cost
from regional_lv.progress import start_log

start_log(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
measure_cost(snakemake.input.emulator, snakemake.input.test, snakemake.output[0])
