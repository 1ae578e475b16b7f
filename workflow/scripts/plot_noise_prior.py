"""Draw what the prior scale of the noise decides."""

from regional_lv.figures import noise_prior
from regional_lv.progress import start_log

start_log(snakemake.log[0])
noise_prior.draw(
    snakemake.input.noise_prior,
    snakemake.wildcards.subject,
    snakemake.params.source,
    snakemake.output.png,
    snakemake.output.csv,
)
