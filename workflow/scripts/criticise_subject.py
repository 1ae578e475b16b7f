"""Criticise the base model on one subject, or on several together."""

import torch

from regional_lv.criticism.study import criticise_files
from regional_lv.progress import start_log

start_log(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
criticise_files(
    snakemake.wildcards.subject,
    snakemake.input.emulator,
    snakemake.input.extensions,
    dict(zip(snakemake.params.subjects, snakemake.input.measured, strict=True)),
    snakemake.input.get("known_theta", []),
    snakemake.params.settings,
    snakemake.params.noise_prior_scale,
    snakemake.params.seed,
    snakemake.output[0],
)
