"""Draw one subject's regional stiffness."""

from regional_lv.figures import bullseye_posterior
from regional_lv.progress import start_log

start_log(snakemake.log[0])
bullseye_posterior.draw(
    snakemake.input.posterior,
    snakemake.input.diagnostics,
    snakemake.params.source,
    snakemake.output.png,
    snakemake.output.csv,
    truth=snakemake.input.truth or None,
)
