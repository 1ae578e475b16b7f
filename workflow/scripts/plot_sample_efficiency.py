"""Draw errors against the number of simulations."""

from regional_lv.figures import sample_efficiency
from regional_lv.progress import start_log

start_log(snakemake.log[0])
sample_efficiency.draw(
    snakemake.input.curves,
    snakemake.output.png,
    snakemake.output.csv,
)
