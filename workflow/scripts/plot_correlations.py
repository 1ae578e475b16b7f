"""Draw the posterior correlations of the ten parameters."""

from regional_lv.figures import correlations
from regional_lv.progress import start_log

start_log(snakemake.log[0])
correlations.draw_parameters(
    snakemake.input.correlations,
    snakemake.input.recovery,
    snakemake.params.label,
    snakemake.output.png,
    snakemake.output.csv,
)
