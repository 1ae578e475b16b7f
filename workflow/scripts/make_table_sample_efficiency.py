"""Write errors against the number of simulations."""

from regional_lv import tables
from regional_lv.progress import start_log

start_log(snakemake.log[0])
table = tables.sample_efficiency(snakemake.input.curves)
tables.save(table, snakemake.output.csv, snakemake.output.tex)
