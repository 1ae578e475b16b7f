"""What the prior of the noise does to a subject's posterior."""

from regional_lv.inference.noise_prior import compare_noise_priors
from regional_lv.progress import start_log

start_log(snakemake.log[0])
compare_noise_priors(snakemake.input.posteriors, snakemake.params.scales, snakemake.output[0])
