"""Draw the posterior correlations between zones."""

from regional_lv.figures import correlations
from regional_lv.progress import start_log

start_log(snakemake.log[0])
correlations.draw_zones(
    snakemake.input.correlations,
    snakemake.input.recovery,
    snakemake.params.labels,
    snakemake.params.title,
    snakemake.output.png,
    snakemake.output.csv,
)
