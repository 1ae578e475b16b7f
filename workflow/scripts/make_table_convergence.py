"""Write one subject's table of convergence."""

from regional_lv.progress import start_log
from regional_lv.tables.subjects import convergence
from regional_lv.tables.writing import save

start_log(snakemake.log[0])
table = convergence(snakemake.input.posterior, snakemake.input.diagnostics)
save(table, snakemake.output.csv, snakemake.output.tex)
