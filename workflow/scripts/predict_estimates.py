"""Pass estimates back through what stands in for the simulator."""

import torch

from regional_lv.estimates.stand_in import predict_estimates
from regional_lv.progress import start_log

start_log(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
predict_estimates(
    snakemake.input.stand_in,
    snakemake.input.estimates,
    snakemake.params.cases,
    snakemake.output[0],
)
