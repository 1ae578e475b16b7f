"""Draw one subject's predictions against its observations."""

from regional_lv.figures import posterior_predictive
from regional_lv.progress import start_log

start_log(snakemake.log[0])
posterior_predictive.draw(
    snakemake.input.posterior,
    snakemake.input.diagnostics,
    snakemake.params.source,
    snakemake.output.png,
    snakemake.output.csv,
)
