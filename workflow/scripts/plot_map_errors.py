"""Draw the error of the MAP by zone and severity."""

from regional_lv.figures import map_errors
from regional_lv.progress import start_log

start_log(snakemake.log[0])
map_errors.draw(
    snakemake.input.recovery,
    snakemake.input.noisy,
    snakemake.params.labels,
    snakemake.output.png,
    snakemake.output.csv,
)
