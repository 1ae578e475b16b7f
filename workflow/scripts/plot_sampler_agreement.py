"""Draw the fast sampler against NUTS."""

from regional_lv.figures import trust
from regional_lv.progress import start_log

start_log(snakemake.log[0])
trust.draw_agreement(snakemake.input.agreement, snakemake.output.png, snakemake.output.csv)
