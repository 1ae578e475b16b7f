"""Compare one emulator with the simulator on the test set."""

import torch

from regional_lv.emulators import predict_test_set
from regional_lv.progress import start_log

start_log(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
predict_test_set(
    snakemake.input.emulator,
    snakemake.input.test,
    snakemake.output.predictions,
    snakemake.output.errors,
)
