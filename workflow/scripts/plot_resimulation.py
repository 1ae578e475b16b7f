"""Draw the simulator at posterior draws."""

from regional_lv.figures import trust
from regional_lv.progress import start_log

start_log(snakemake.log[0])
trust.draw_resimulation(snakemake.input.resimulated, snakemake.output.png, snakemake.output.csv)
