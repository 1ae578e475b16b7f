"""Draw errors against element size, and the orders."""

from regional_lv.figures import convergence
from regional_lv.progress import start_log

start_log(snakemake.log[0])
convergence.draw(
    snakemake.input.errors, snakemake.input.orders, snakemake.output.png, snakemake.output.csv
)
