"""Write one subject's table of convergence."""

from regional_lv import tables
from regional_lv.progress import start_log

start_log(snakemake.log[0])
table = tables.convergence(snakemake.input.posterior, snakemake.input.diagnostics)
tables.save(table, snakemake.output.csv, snakemake.output.tex)
