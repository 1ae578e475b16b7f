"""Sample the posterior of one measured subject."""

import torch

from regional_lv.inference.sampling import sample_subject
from regional_lv.progress import start_log

start_log(snakemake.log[0])
torch.set_num_threads(snakemake.threads)
sample_subject(
    snakemake.input.emulator,
    snakemake.input.measured,
    snakemake.wildcards.subject,
    snakemake.params.sampler,
    snakemake.params.nuts,
    snakemake.params.map,
    snakemake.params.noise_prior_scale,
    snakemake.params.seed,
    snakemake.output.posterior,
    snakemake.output.diagnostics,
)
