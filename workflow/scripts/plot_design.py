"""Draw the outputs over the design, and what did not converge."""

from regional_lv.figures import design
from regional_lv.progress import start_log

start_log(snakemake.log[0])
design.draw(
    snakemake.input.simulations,
    snakemake.input.excluded,
    snakemake.output.png,
    snakemake.output.csv,
)
