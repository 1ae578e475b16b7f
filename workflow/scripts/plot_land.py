"""Draw the benchmark's results beside the published ones."""

from regional_lv.figures import land
from regional_lv.progress import start_log

start_log(snakemake.log[0])
land.draw(
    snakemake.input.results,
    snakemake.input.published,
    snakemake.output.png,
    snakemake.output.csv,
)
